"""A page an effect, from its declaration and from the figures that `effect_figures.py` has kept."""

from __future__ import annotations

import json
from functools import cache

from effect_figures import FOLDER, NUMBERS

from sinan.experiments.effects_page import FAMILIES, facts, family, source_file
from sinan.sensors.effects import CATALOGUE, Effect

SENSOR_PAGES = {
    "accel": "accelerometer", "gyro": "gyroscope", "mag": "magnetometer", "baro": "barometer", "sonar": "sonar",
    "laser": "laser", "gps": "gps", "base": "gps", "camera": "camera", "pseudorange": "pseudoranges",
}  # fmt: skip


def pages() -> dict[str, str]:
    """By the name of the page: one an effect of its own, one for each family that many streams have."""
    own = {f"effects/{e.name}": _page(e) for e in CATALOGUE.values() if family(e) is None}
    shared = {f"effects/{suffix}": _family(suffix, title) for suffix, title in FAMILIES.items()}
    return own | shared | {"effects/index": _index()}


def _index() -> str:
    """All of them, sensor after sensor."""
    text = ["# An effect a page\n", "How they are declared, and all in one table: [effects](../../effects.md).\n"]
    for stream in dict.fromkeys(e.stream for e in CATALOGUE.values() if family(e) is None):
        mine = [e for e in CATALOGUE.values() if e.stream == stream and family(e) is None]
        text += [*(f"- [`{e.name}`]({e.name}.md): {e.summary}" for e in mine), ""]
    text += [f"- [{title}: `<stream>.{suffix}`]({suffix}.md)" for suffix, title in FAMILIES.items()]
    names = [e.name for e in CATALOGUE.values() if family(e) is None] + list(FAMILIES)
    return "\n".join([*text, "", "```{toctree}", ":hidden:", *names, "```", ""])


def _page(effect: Effect) -> str:
    lines = [f"# `{effect.name}`", "", effect.summary, "", "    " + effect.enters, "", effect.physics, ""]
    lines += [*_facts(effect), "", *_figure(effect.name), "", "## Try it", "", "```", *_commands(effect), "```", ""]
    sensor = SENSOR_PAGES.get(effect.stream)
    return "\n".join([*lines, f"The sensor: [{sensor}](../../sensors/{sensor}.md)." if sensor else "", ""])


def _family(suffix: str, title: str) -> str:
    members = [e for e in CATALOGUE.values() if family(e) == suffix]
    names = ", ".join(f"`{e.name}`" for e in members)
    lines = [f"# {title}: `<stream>.{suffix}`", "", f"{names}. {members[0].physics}", "", "    " + members[0].enters]
    lines += ["", *_facts(members[0])]
    for effect in members:
        lines += ["", f"## `{effect.name}`", "", effect.summary, "", *_figure(effect.name)]
    return "\n".join(lines) + "\n"


def _facts(effect: Effect) -> list[str]:
    rows = [f"- **{label}**: {text}" for label, text in facts(effect) if label != "enters"]
    file = source_file(effect)
    return [*rows, f"- **declared in**: {{download}}`sensors/effects/{file} <../../../sensors/effects/{file}>`"]


@cache
def _numbers() -> dict[str, dict[str, object]]:
    return dict(json.loads(NUMBERS.read_text(encoding="utf-8")))


def _figure(name: str) -> list[str]:
    """The figure with its caption; why there is none, where there is none."""
    known = _numbers().get(name)
    if known is None or not (FOLDER / f"{name}.png").exists():
        return ["Of this one there is no figure: no scenario of a flight shows it by its innovations alone."]
    beta = ", ".join(f"{b:g}" for b in known["beta"])  # type: ignore[attr-defined]
    nis = [f"{value:g}" for value in known["nis_per_dof"]]  # type: ignore[attr-defined]
    after = f"{nis[0]} without the effect in the model, {nis[1]} with it" if len(nis) > 1 else nis[0]
    return [
        f"![whitened innovations with and without {name} in the model](../../figures/effects/{name}.png)", "",
        f"*Simulated: scenario `{known['scenario']}`, seed 1, beta = {beta}. Whitened innovations of "
        f"`{known['stream']}`, component {known['component']}; the band is two sigma. NIS a degree of freedom "
        f"of that stream: {after}. Made by "
        f"`python docs/make/effect_figures.py {name}`.*",
    ]  # fmt: skip


def _commands(effect: Effect) -> list[str]:
    known = _numbers().get(effect.name)
    if known is None:
        return [f"sinan effects {effect.name}"]
    beta = ",".join(f"{b:g}" for b in known["beta"])  # type: ignore[attr-defined]
    return [
        f"sinan simulate {known['scenario']} flight --effect {effect.name}={beta} --seed 1",
        "sinan trace flight --html flight.html",
    ]
