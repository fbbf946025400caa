"""`sinan demo`: the whole loop on an embedded recording with an effect that it does not declare, and a page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sinan.experiments.answers.asked import Asked
from sinan.experiments.answers.traces import document_of
from sinan.experiments.calibrate import as_json, calibrate_triad
from sinan.experiments.report.calibration_words import summary, warnings_of
from sinan.experiments.report.files import write_json
from sinan.experiments.report.page import png
from sinan.experiments.report.trace_page import trace_figures, trace_page
from sinan.experiments.report.trace_words import parameter_rows
from sinan.experiments.report.verdict_words import trace_summary
from sinan.experiments.report.words import trace_call
from sinan.experiments.residual_loop.open_source import pose_source, triad_readings
from sinan.experiments.residual_loop.trace import trace
from sinan.experiments.residual_loop.traced import Traced
from sinan.experiments.review.drawing import drawn
from sinan.experiments.review.of_answers import review_of_trace
from sinan.experiments.scenarios.loader import load_scenario
from sinan.sensors.effects import CATALOGUE
from sinan.sensors.errors import InputError
from sinan.sensors.files import write_bytes
from sinan.sensors.formats.plain import write_recording
from sinan.sensors.recording import Recording
from sinan.sensors.simulate import simulate

SCENARIO, SEED = "mag_poses", 7
#: What the demonstration hides: soft iron and a current loop, in the sizes of a hobby quadrotor.
HIDDEN: Mapping[str, tuple[float, ...]] = {"mag.cross_axis": (0.04, -0.015, 0.02), "mag.current": (0.0015, 0.0, -0.001)}
MEASURED = "rfly_course/MagRaw.mat"


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """Simulate, calibrate, trace, draw; then the same on the course's measured magnetometer where it is at hand."""
    recording, _ = simulate(load_scenario(SCENARIO), np.random.default_rng(SEED), HIDDEN)
    write_recording(recording, out / "recording")
    hidden = "; ".join(f"{name} = {', '.join(f'{b:g}' for b in beta)}" for name, beta in HIDDEN.items())
    say(f"1. A recording, simulated: {recording.name}. Its own files do not say what is hidden in it:\n   {hidden}")
    document = demonstrate(recording, out, "simulated", say, HIDDEN)
    say("\nHidden against found:\n" + hidden_and_found(HIDDEN, document))
    measured = measured_recording()
    if measured is None:
        say("\nThe course's measured magnetometer: `sinan fetch rfly_course`, then run the demonstration again.")
    else:
        say("\n2. The course's own magnetometer, measured.")
        demonstrate(measured, out, "measured", say)
    say(f"\nPages and figures: {out.resolve()}; begin with {(out / 'simulated.html').resolve()}")


def demonstrate(
    recording: Recording,
    out: Path,
    name: str,
    say: Callable[[str], None],
    hidden: Mapping[str, Sequence[float]] | None = None,
) -> Mapping[str, Any]:
    """Calibrate with the plain model, trace its residual, write page, figures and report."""
    readings = triad_readings(recording, "mag")
    say("\nThe textbook's model, a scale and an offset on each axis:")
    calibration = calibrate_triad(recording, readings, "none")
    log = MEASURED if hidden is None else str(out / "recording")
    said = {
        "warnings": warnings_of(calibration, readings, trace_call(log)),
        "read_in": recording.environment.field_unit,
    }
    say(summary("mag", {**as_json("mag", calibration), **said}))
    source = pose_source(recording, "mag")
    traced = Traced.alone(source, trace(source))
    document = document_of(recording, traced, Asked(input=log))
    say("\nIts residual, traced:")
    say(trace_summary(document))
    trace_page(out / f"{name}.html", traced, document, hidden, drawn(review_of_trace(recording, traced, document)))
    for figure, (drawing, _) in trace_figures(traced, document).items():
        write_bytes(out / f"{name}_{figure}.png", png(drawing))
    write_json(out / f"{name}.json", document)
    return document


def hidden_and_found(hidden: Mapping[str, Sequence[float]], document: Mapping[str, Any]) -> str:
    """A table: each parameter that was hidden, its value, and what was found; then what was found but not hidden."""
    found = {effect["name"]: effect for effect in document["effects"]}
    rows = [("effect", "hidden", "found ± 1 sigma", "unit")]
    for name, values in hidden.items():
        effect = found.get(name)
        cells = parameter_rows(effect) if effect else [(p.name, "not found", "") for p in CATALOGUE[name].parameters]
        rows += [(f"{name} {p}", f"{v:g}", c, unit) for v, (p, c, unit) in zip(values, cells, strict=True)]
    rows += [(name, "nothing", "found", "") for name in found if name not in hidden]
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    return "\n".join(f"  {a:{widths[0]}}  {b:>{widths[1]}}  {c:>{widths[2]}}  {d}".rstrip() for a, b, c, d in rows)


def measured_recording() -> Recording | None:
    """The course's magnetometer readings, if the data set is on this machine; nothing is downloaded."""
    from sinan.experiments.datasets import resolve

    try:
        return resolve(MEASURED)
    except InputError:
        return None
