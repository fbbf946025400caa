"""A page an effect, from its declaration and from the figures that `effect_figures.py` has kept."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

from effect_figures import CAMERA, NUMBERS, WITH_CAMERA
from residual_figures import FAULT, FAULTY, RANGES

from sinan.experiments.effects_page import FAMILIES, facts, family, source_file
from sinan.sensors.effects import CATALOGUE, Effect

Known = dict[str, Any]  # what `effect_figures.py` has kept of one figure
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
    lines += [*_facts(effect), "", *_figure(effect.name), "", "## Try it", "", *_commands(effect), ""]
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
def _numbers() -> dict[str, Known]:
    return dict(json.loads(NUMBERS.read_text(encoding="utf-8")))


def _figure(name: str) -> list[str]:
    """The figure with its caption."""
    known = _numbers()[name]
    drawn, caption = _caption(CATALOGUE[name], known)
    made = f"Made by `python docs/make/effect_figures.py {name}`."
    return [f"![{drawn} of {name}](../../figures/effects/{name}.png)", "", f"*{caption} {made}*"]


def _caption(effect: Effect, known: Known) -> tuple[str, str]:
    """What is drawn, and the caption."""
    simulated = f"Simulated: scenario `{known['scenario']}`, seed 1, beta = {_beta(known, ', ')}."
    if "rms" not in known:
        nis = [f"{value:g}" for value in known["nis_per_dof"]]
        after = f"{nis[0]} without the effect in the model, {nis[1]} with it" if len(nis) > 1 else nis[0]
        return "whitened innovations with and without the effect in the model", (
            f"{simulated} Whitened innovations of `{known['stream']}`, component {known['component']}; the band is two "
            f"sigma. NIS a degree of freedom of that stream: {after}."
        )
    before, after = known["rms"]
    unit = "pixels" if known["unit"] == "pixel" else known["unit"]
    rms = f"RMS: {before:g} {unit} without the effect in the model, {after:g} {unit} with it."
    return _CAPTIONS[effect.stream](effect.name, known, simulated, rms)


def _of_camera(name: str, known: Known, simulated: str, rms: str) -> tuple[str, str]:
    late = name == "camera.time_offset"
    before, after = known["nis_per_dof"]
    shown = "which follow the turns of the flight" if late else "magnified, as arrows in the picture"
    return "reprojection residuals with and without the effect in the model", (
        f"{simulated} Reprojection residuals, place read less place predicted from the true pose, {shown}. {rms} A "
        "filter does not know the pose, and turns and shifts it to make them smaller: its NIS a degree of freedom is "
        f"{before:g} without the effect, {after:g} with it."
    )


def _of_ranges(name: str, known: Known, simulated: str, rms: str) -> tuple[str, str]:
    found = (
        f"Found by the trace: satellite {known['satellite']}, beta = {_beta(known, ', ')}. "
        if "satellite" in known
        else ""
    )
    return "range residuals with and without the effect in the model", (
        f"Simulated: the scenario below, seed 1, a receiver at rest on a known place. {found}Pseudoranges less what "
        "the model says there, with all other effects in it, and less the mean of their epoch, which is the receiver's "
        f"clock and jumps when a satellite rises or sets. {rms}"
    )


def _of_specific_force(name: str, known: Known, simulated: str, rms: str) -> tuple[str, str]:
    lacking = "zero" if name == "motion.rotor_drag" else "the declared drag in calm air"
    return "horizontal specific force with and without the effect in the model", (
        f"{simulated} Specific force along body x, less the true bias, means over 0.1 s, less what the model says of "
        f"the true motion: {lacking} without the effect. {rms} Innovations do not show it, so no trace asks for it: "
        "`level` is on only where there is no GPS, and then nothing tells the speed that goes with the drag; and it "
        "allows true accelerations of 1 m/s^2."
    )


def _of_wrong_samples(name: str, known: Known, simulated: str, rms: str) -> tuple[str, str]:
    before, after = (f"{value:g} {known['unit']}" for value in known["rms"])
    return "samples of the IMU, and without the wrong ones", (
        f"{simulated} Samples along x less the median of the seven about each, ten seconds of the flight; crosses are "
        "called wrong, along any axis, by the law of `estimator/evidence/intervals/outliers.py`: of the whole flight "
        f"{known['called']} of {known['samples']} samples, {known['both']} of the {known['wrong']} that are wrong "
        f"among them. RMS: {before} with them, {after} without. In a flight the tracer does not look for them, because "
        "the IMU drives the filter: a wrong sample acts for one sampling interval, and leaves no mark on another "
        "sensor's innovations."
    )


_CAPTIONS = {
    "camera": _of_camera, "pseudorange": _of_ranges, "level": _of_specific_force, "accel": _of_wrong_samples,
    "gyro": _of_wrong_samples,
}  # fmt: skip


def _beta(known: Known, between: str) -> str:
    return between.join(f"{b:g}" for b in known["beta"])


def _commands(effect: Effect) -> list[str]:
    """What to type, and what goes into a file before."""
    known = _numbers()[effect.name]
    if effect.stream == "pseudorange":
        text = RANGES + (FAULTY if effect.name == FAULT.name else "")
        return [
            "Put this into `rover.toml`:", "", "```", *text.splitlines(), "```", "", "```",
            "sinan ranges rover.toml --out run --seed 1",
            "sinan gnss run/rover.obs run/broadcast.nav --code p --reference run/reference.csv --html ranges.html",
            "```",
        ]  # fmt: skip
    sensors = f" --sensors {','.join(WITH_CAMERA)}" if effect.stream == CAMERA else ""
    flown = f"sinan simulate {known['scenario']} flight{sensors} --effect {effect.name}={_beta(known, ',')} --seed 1"
    last = f"sinan effects {effect.name}" if effect.stream == "level" else "sinan trace flight --html flight.html"
    return ["```", flown, last, "```"]
