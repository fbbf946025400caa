"""docs/effects.md, made from the declarations of the catalogue: `python -m sinan.experiments.effects_page [OUT.md]`."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from itertools import groupby
from pathlib import Path
from types import FunctionType

from sinan.experiments.residual_loop.manoeuvre import (
    CLASS_BOUND,
    alike,
    apart,
    deciding,
    in_digits,
    most_alike,
    scenes,
)
from sinan.sensors.effects import CATALOGUE, Effect
from sinan.sensors.effects.shipped import is_shipped
from sinan.sensors.files import write_text

PAGE = Path(__file__).parents[1] / "docs" / "effects.md"
SOURCE_FOLDER = "../sensors/effects"

#: What a declaration needs, in words.
NEEDS = {
    "f_b": "specific force",
    "w_ib_b": "angular rate",
    "dw_b": "angular acceleration",
    "m_b": "field in the body",
    "m_n": "field in NED",
    "q_nb": "attitude",
    "p_n": "position",
    "v_n": "velocity",
    "temperature": "temperature of the sensor (a magnetometer without a thermometer: the IMU's)",
    "current": "supply current, or the motors' commands",
    "throttle": "the motors' commands",
    "airspeed": "airspeed, or wind and velocity",
    "wind": "the wind",
    "voltage": "supply voltage",
    "vibration": "a full-rate IMU",
    "rotor_drag": "a declared `motion.rotor_drag`",
    "satellite_position": "positions of the satellites",
    "satellite_velocity": "velocities of the satellites",
    "receiver_position": "position of the receiver",
    "satellite_clock": "broadcast clocks of the satellites",
    "group_delay": "broadcast group delays",
    "elevation": "elevations of the satellites",
    "azimuth": "azimuths of the satellites",
    "latitude": "latitude",
    "longitude": "longitude",
    "frequency": "carrier frequency",
    "faulty": "which satellite is searched",
    "elapsed": "time",
    "point_n": "places of the points that are seen",
    "camera": "intrinsics and mounting of the camera",
}
KINDS = {"flight": "flights", "poses": "poses", "pseudoranges": "pseudoranges"}

HEAD = """# Effects

The catalogue: physical causes of sensor errors that the textbook (plain) sensor model does not contain. This page is
made from the declarations in `sensors/effects/` by `python -m sinan.experiments.effects_page`; `sinan effects` lists
the same in the terminal. Simulator, calibration, filter and tracer use these declarations and nothing else; [how to
add one](how_to_add_an_effect.md).

**Notation.** The plain model is reading = truth + bias (random walk) + white noise, beta = 0. f is the specific
force, w the angular rate and B the magnetic field as an ideal sensor would measure them in body axes (x forward, y
right, z down); h is the height above the ground, R the rotation from body to NED, tilt the angle between the body's z
axis and the vertical. Rotations are active and right-handed. Several effects on one stream add up, each evaluated at
the plain reading. The magnetic field is in units of its norm.

**Columns and lines.** *beta*: the number of parameters. *Plausible*: the standard deviation of a parameter among
instruments on the market; it is the prior of the parameter, and an estimate beyond ten times this size is not
accepted. *Seen from*: the smallest size that would be detected if nothing else were wrong, in plausible sizes, the
median over the components. *Looks like*: effects whose signatures have a squared correlation r² above {bound} in some
scenario, the scenario in which they are most alike, and the one that separates them ([the whole
table](notes/separation.md)).
"""
FAMILIES = {
    "step": "A step at an unknown instant",
    "transient": "An offset within an unknown interval",
    "outliers": "Wrong readings",
    "time_offset": "Late time stamps",
}


def facts(effect: Effect) -> list[tuple[str, str]]:
    """What the declaration and the table of separation say about one effect: labels and texts."""
    rows = [
        ("enters", f"`{effect.enters}`"),
        ("form", _form(effect)),
        ("beta", parameters(effect)),
        ("needs", ", ".join(dict.fromkeys(NEEDS[name] for name in effect.needs)) or "nothing besides the reading"),
        ("candidate in", " and ".join(KINDS[kind] for kind in sorted(effect.kinds))),
    ]
    if effect.scenario:
        rows.append(("shown by", f"scenario `{effect.scenario}`{_seen_from(effect)}"))
    if effect.separates:
        rows.append(("told apart by", effect.separates))
    likes = looks_like(effect.name)
    if likes:
        rows.append(("looks like", "; ".join(likes)))
    return [*rows, ("source", effect.source)]


def parameters(effect: Effect) -> str:
    """Names, units and plausible sizes, and which are positive; parameters that share all that together."""
    groups = groupby(effect.parameters, key=lambda p: (p.unit, p.plausible, p.positive))
    field = ", with the field in units of its norm" if effect.in_field_units else ""
    return "; ".join(
        f"{', '.join(p.name for p in members)} [{unit}], plausible {plausible:g}{field}{', positive' * positive}"
        for (unit, plausible, positive), members in groups
    )


def looks_like(name: str) -> list[str]:
    """The effects that look like it somewhere, where most, and what decides."""
    found = []
    for pair in alike():
        if name not in pair:
            continue
        other = pair[1] if pair[0] == name else pair[0]
        worst = most_alike(name, other)
        found.append(f"`{other}` (r² {in_digits(worst.r2)} in `{worst.scene.key}`; {_decides(name, other)})")
    return found


def _decides(name: str, other: str) -> str:
    best = deciding(name, other)
    if best:
        return f"`{best[0].scene.key}` decides: {in_digits(best[0].r2)}"
    alone = apart(name, other)
    return f"`{alone[0].key}` shows `{alone[1]}` alone" if alone else "no scenario decides"


def _form(effect: Effect) -> str:
    if effect.name.endswith(".outliers"):
        return "the mean reading stays; found by its scatter"
    if effect.exact is None:
        return "linear in beta, exact as it stands"
    return "exact form, re-linearised as beta grows" + (
        "; reads the motion at other instants than that of the reading" if effect.other_instants else ""
    )


def _seen_from(effect: Effect) -> str:
    scene = scenes().get(effect.scenario)
    size = None if scene is None else scene.sees.get(effect.name)
    return "" if size is None else f", seen from {size:.2g} plausible sizes on"


def page() -> str:
    """The page: an overview, then one section an effect, one a time-localised family."""
    single = [e for e in CATALOGUE.values() if family(e) is None]
    lines = [HEAD.format(bound=f"{CLASS_BOUND:g}"), *_overview(CATALOGUE.values())]
    for effect in single:
        lines += ["", f"## `{effect.name}`", "", f"{effect.summary} {effect.physics}", "", *_bullets(effect)]
    for suffix, title in FAMILIES.items():
        lines += ["", *_family(title, [e for e in CATALOGUE.values() if family(e) == suffix])]
    return "\n".join(lines) + "\n"


def family(effect: Effect) -> str | None:
    """Which of the families that every stream has; None: an effect of its own."""
    suffix = effect.name.split(".")[1]
    return suffix if suffix in FAMILIES else None


def source_file(effect: Effect) -> str:
    """The file of its declaration."""
    maker = effect.localised or effect.regressor  # a transient has the regressor of a step
    return maker.__module__.rsplit(".", 1)[-1] + ".py"


def declared_in(effect: Effect) -> str:
    """Where the declaration is: a file of the project, or one of the user's own."""
    if is_shipped(effect.name):
        return f"sensors/effects/{source_file(effect)}"
    return effect.regressor.__code__.co_filename if isinstance(effect.regressor, FunctionType) else "a package"


def _overview(effects: Iterable[Effect]) -> list[str]:
    lines = ["| name | what is wrong | how it enters | beta |", "| --- | --- | --- | --- |"]
    for effect in effects:
        enters = effect.enters.replace("|", "\\|")
        lines.append(f"| `{effect.name}` | {effect.summary} | `{enters}` | {effect.size} |")
    return lines


def _bullets(effect: Effect) -> list[str]:
    return [f"- **{label}**: {text}" for label, text in facts(effect)] + [_file(effect)]


def _file(effect: Effect) -> str:
    name = source_file(effect)
    return f"- **file**: [`sensors/effects/{name}`]({SOURCE_FOLDER}/{name})"


def _family(title: str, effects: list[Effect]) -> list[str]:
    """One section for the same effect on several streams."""
    one = effects[0]
    names = ", ".join(f"`{effect.name}`" for effect in effects)
    shared = [(label, text) for label, text in facts(one) if label in ("enters", "form", "told apart by", "source")]
    return [
        f"## {title}: `<stream>.{family(one)}`",
        "",
        f"{names}. {one.physics}",
        "",
        *(f"- **{label}**: {text}" for label, text in shared),
        _file(one),
        "",
        "| name | beta | needs | candidate in | shown by |",
        "| --- | --- | --- | --- | --- |",
        *(f"| `{effect.name}` | {_row(effect)} |" for effect in effects),
    ]


def _row(effect: Effect) -> str:
    found = dict(facts(effect))
    return " | ".join(found.get(label, "no scenario") for label in ("beta", "needs", "candidate in", "shown by"))


def main(arguments: list[str]) -> None:
    """Write the page, by default where it is kept."""
    out = Path(arguments[0]) if arguments else PAGE
    write_text(out, page())
    sys.stdout.write(f"{out}\n")


if __name__ == "__main__":
    main(sys.argv[1:])
