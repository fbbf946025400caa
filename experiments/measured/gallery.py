"""The loop on every measured log that bears it, written as a page of the documentation.

python -m sinan.experiments.measured.gallery OUT.md [NAME ...]    (with names: those alone, the rest of the page stays)
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.evidence.source import Source
from sinan.experiments.datasets import resolve
from sinan.experiments.measured.arguments import usage
from sinan.experiments.measured.gallery_page import block, blocks_of, page
from sinan.experiments.measured.logs import LOGS, Entry
from sinan.experiments.measured.published import PARAMETERS, SETTINGS, published
from sinan.experiments.measured.scoring import withheld_errors
from sinan.experiments.measured.traced_log import TracedLog
from sinan.experiments.reference import gyro_error, reference_of
from sinan.experiments.report.trace_words import seen_up_to
from sinan.experiments.report.words import number, reference_words
from sinan.experiments.residual_loop.open_source import triad_readings
from sinan.experiments.residual_loop.report import report
from sinan.experiments.residual_loop.run import trace_recording
from sinan.experiments.residual_loop.trace import Trace
from sinan.sensors.effects import CATALOGUE
from sinan.sensors.errors import InputError
from sinan.sensors.files import write_text
from sinan.sensors.recording import Recording


def find(name: str) -> TracedLog:
    """Trace one log and score it; what goes wrong is part of what is found."""
    entry = LOGS[name]
    recording, start = resolve(entry.input), process_time()
    try:
        traced = trace_recording(recording, entry.sensor)
        source, result = traced.parts[0].source, traced.parts[0].trace
        seconds = process_time() - start
        document = report(traced)
        references = references_of(entry, recording, source, result)
    except (InputError, ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        return TracedLog(entry, name, seconds=process_time() - start, failure=f"{type(error).__name__}: {error}")
    notes = getattr(source, "recording", recording).notes[len(recording.notes) :]
    undecided = undecided_of(document, notes, recording)
    known_otherwise = published_words(entry, document) or settings_words(entry, document) or gyro_words(source)
    return TracedLog(
        entry, name, document, notes, references, undecided, known_otherwise, seconds, not_finite(document)
    )


def gyro_words(source: Source) -> str:
    """What the rates of a reference on the same body say of the gyroscope."""
    target = reference_of(source.recording) if isinstance(source, FlightSource) else None
    if target is None or not target.knows_heading or not isinstance(source, FlightSource):
        return ""
    found = gyro_error(source.recording, target)
    scale, cross = (", ".join(f"{value:.3f}" for value in part) for part in (found.scale, found.cross_axis))
    return f"gyro.scale {scale} and crookedness {cross}, by the rates of the reference to {number(found.rms)} rad/s"


def published_words(entry: Entry, document: Mapping[str, Any]) -> str:
    """Published parameters of an effect, and how many sigmas what was found is from them."""
    if (entry.input, entry.sensor) not in PARAMETERS:
        return ""
    name, values, whose = PARAMETERS[entry.input, entry.sensor or ""]
    shown = ", ".join(number(value) for value in values)
    for effect in document["effects"]:
        if effect["name"] == name:
            apart = (np.array(effect["beta"]) - values) / np.array(effect["std"], dtype=float)
            sizes = ", ".join(f"{a:+.1f}" if np.isfinite(a) else "undetermined" for a in apart)
            return f"{name} {shown} ({whose}): found {sizes} sigma from it"
    return f"{name} {shown} ({whose}): not found"


def settings_words(entry: Entry, document: Mapping[str, Any]) -> str:
    """Delays to which an author set his own filter, and what was found."""
    found = {effect["name"]: number(effect["beta"][0]) for effect in document["effects"]}
    settings = SETTINGS.get(entry.input, {})
    sizes = [f"{name} {number(value)} s (found: {found.get(name, 'none')})" for name, value in settings.items()]
    return f"delays that the log's author had set in his own filter: {', '.join(sizes)}" if sizes else ""


def not_finite(document: Mapping[str, Any]) -> str:
    """Says so where a report holds a number that is none."""
    import json

    try:
        json.dumps(document, allow_nan=False)
    except ValueError:
        return "a number of the report is not finite"
    return ""


def references_of(
    entry: Entry, recording: Recording, source: Source, result: Trace
) -> list[tuple[str, float, float, str]]:
    """Errors against what the loop was not shown, of the plain model and of the final one."""
    if not isinstance(source, FlightSource):
        return list(_published(entry, recording, source, result))
    found: list[tuple[str, float, float, str]] = []
    whose = reference_words(recording.truth.kind if recording.truth else None)
    for pair, words in ((result.verdict.truth, "all data"), (result.verdict.truth_held_out, "last third")):
        before, after = pair or ({}, {})
        for name in ("attitude", "tilt", "heading"):
            key = f"{name}_rms"
            if key in before and key in after:
                first, last = (float(np.rad2deg(errors[key])) for errors in (before, after))
                found.append((f"{name} against {whose}, {words}", first, last, "deg"))
    if "gps" in source.recording.streams:
        fits = result.verdict.proof.fits
        before_by_age, after_by_age = (withheld_errors(source, fit, True, fits[-1]) for fit in fits)
        found += [(f"position, {age:g} s after the last fix, last third", miss, after_by_age[age], "m")
                  for age, miss in before_by_age.items() if age in after_by_age]  # fmt: skip
    return found


def _published(
    entry: Entry, recording: Recording, source: Source, result: Trace
) -> Sequence[tuple[str, float, float, str]]:
    """The spread of the norm, and that which a published calibration leaves: in place of an error of ours."""
    sensor = entry.sensor or ("mag" if "mag" in entry.input.lower() else "accel")
    rows = []
    for one in published(entry.input, sensor):
        readings = triad_readings(recording, sensor)
        ours = next(r for r in source.residuals(result.final)).rms / readings.norm
        spread = one.spread(readings.reading * readings.normalised_by)
        rows.append((f"spread of the norm, published calibration ({one.source}) and this one", spread, ours, ""))
    return rows


def undecided_of(document: Mapping[str, Any], notes: Sequence[str], recording: Recording) -> list[str]:
    """What a log cannot decide: effects that could not be seen, classes, levels that do not fit."""
    lines = []
    asked = [c for c in document["candidates"] if "interval" not in c]
    blind = [c["name"] for c in asked if not any(s is not None for s in c["detectable_from"])]
    large = [c["name"] for c in asked if c["name"] not in blind and _implausible(c)]
    if blind:
        lines.append(f"not visible at any size: {', '.join(blind)}")
    if large:
        lines.append(f"visible only if several times larger than instruments have it: {', '.join(large)}")
    for effect in document["effects"]:
        if effect["confused_with"]:
            lines.append(f"{effect['name']} or {', '.join(effect['confused_with'])}")
    lines += [note for note in notes if "far from 1" in note]
    lines += [note for note in recording.notes if "no independent" in note]
    return lines


#: Sizes beyond this many of the plausible 1-sigma do not occur.
_OCCURS = 3.0


def _implausible(candidate: Mapping[str, Any]) -> bool:
    """Whether no parameter of a candidate would have been seen at a size that occurs."""
    return not CATALOGUE[candidate["name"]].in_field_units and not seen_up_to(candidate, _OCCURS)


def main(arguments: Sequence[str]) -> int:
    """Write the page after every log, so that an interruption leaves what was done.

    With names, the sections of all other logs that the page has already stay as they are.
    """
    if not arguments or arguments[0].startswith("-") or any(name not in LOGS for name in arguments[1:]):
        return usage(LOGS, "OUT.md ")
    out, failed = Path(arguments[0]), False
    blocks = blocks_of(out.read_text(encoding="utf-8")) if arguments[1:] and out.is_file() else {}
    for name in arguments[1:] or LOGS:
        found = find(name)
        blocks[name] = block(found)
        write_text(out, page(blocks[known] for known in LOGS if known in blocks))
        sys.stderr.write(f"{name}: {found.failure or found.document['verdict']}, {found.seconds:.0f} s\n")
        failed = failed or bool(found.failure)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
