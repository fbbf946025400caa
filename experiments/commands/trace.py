"""`sinan trace`: a recording -> the effect that its plain model lacks, as text, JSON and a page."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sinan.experiments.commands.refused import doubted_shares, refused
from sinan.experiments.datasets import called, resolve
from sinan.experiments.report.console import note, tell_notes, working
from sinan.experiments.report.files import write_json
from sinan.experiments.report.verdict_words import Log, trace_summary, worded
from sinan.experiments.residual_loop.flight import FlightSource
from sinan.experiments.residual_loop.report import report
from sinan.experiments.residual_loop.run import trace_recording
from sinan.experiments.residual_loop.source import Source
from sinan.experiments.residual_loop.traced import Traced
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.joining import joined
from sinan.sensors.recording import Recording
from sinan.sensors.window import WHOLE, Span


def run(
    inputs: Sequence[str],
    sensor: str | None,
    alpha: float,
    gravity: float | None,
    map_file: Path | None,
    json: Path | None,
    html: Path | None,
    span: Span = WHOLE,
    choice: Choice = FIRST,
) -> str:
    """Trace one log, or several of one vehicle together; write what is asked for, return the summary for the terminal.

    Raises
    ------
    InputError : logs that cannot be of one vehicle (`sensors.joining.joined`)
    """
    recording, traced, document = trace_log(inputs, sensor, alpha, gravity, map_file, span, choice)
    document["autopilot"], said_of_autopilot = in_its_terms(document, recording, inputs)
    if json is not None:
        write_json(json, document)
    if html is not None:
        from sinan.experiments.report.trace_page import trace_page

        with working("drawing"):
            trace_page(html, traced, document)
    said = [f"warning: {warning}" for warning in document["warnings"]]
    notes = [f"  note: {note}" for note in document["notes"]]
    return "\n".join([*said, trace_summary(document), *notes, *said_of_autopilot])


def trace_log(
    inputs: Sequence[str],
    sensor: str | None,
    alpha: float,
    gravity: float | None,
    map_file: Path | None,
    span: Span = WHOLE,
    choice: Choice = FIRST,
) -> tuple[Recording, Traced, dict[str, Any]]:
    """One log traced, or several of one vehicle: their recording, what was found, and the report with its words."""
    if len(inputs) > 1 and span != WHOLE:
        raise InputError("--from and --to", f"{len(inputs)} logs", "one log; `sinan convert` makes a log of a part")
    recording = joined([resolve(one, map_file, span, choice) for one in inputs])
    tell_notes(recording)
    if recording.kind == "flight" and sensor is not None:
        note(f"--sensor {sensor} is for poses: of a flight all sensors are traced together")
    with working(_what(recording), flies=recording.kind == "flight"):
        traced = trace_recording(recording, sensor, alpha, gravity)
    return recording, traced, document_of(recording, traced, inputs, map_file, span, choice)


def document_of(
    recording: Recording,
    traced: Traced,
    inputs: Sequence[str],
    map_file: Path | None = None,
    span: Span = WHOLE,
    choice: Choice = FIRST,
) -> dict[str, Any]:
    """The report of a trace with its words."""
    input = inputs[0]
    name = called(input, recording, span) if len(inputs) == 1 else recording.name
    document = worded(report(traced), name, Log(input, map_file, choice))
    document["window"] = None if span == WHOLE else list(span)
    document["notes"] = [note for part in traced.parts for note in taken_from_the_log(recording, part.source)]
    document["warnings"] = [warning for part in traced.parts for warning in _not_believed(part.source)]
    document["choice"], document["magnetic_field"] = asdict(choice), _field_of(traced)
    return document


def _field_of(traced: Traced) -> list[float] | None:
    """The Earth's field that a flight's filter knew, NED; None: none."""
    used = getattr(traced.parts[0].source, "recording", None)
    field_n = None if used is None else used.environment.magnetic_field
    return None if field_n is None else [float(one) for one in field_n]


def in_its_terms(
    document: Mapping[str, Any], recording: Recording, inputs: Sequence[str]
) -> tuple[dict[str, Any] | None, list[str]]:
    """The parameters that take out what was found, and lines that say so; None: nothing, of no autopilot's log, or of
    logs that were flown with different ones.
    """
    from sinan.experiments.autopilots.parameters import autopilot_of, facts_beside, lines_of, terms_of_document

    logs = [Path(one) for one in inputs]
    if not document["effects"] or not all(log.is_file() for log in logs):
        return None, []
    facts = [facts_beside(log) for log in logs]
    name = autopilot_of(facts[0])
    if not name:
        return None, []
    terms = terms_of_document(document, name, recording, logs[0])
    for one in terms.settings:
        if any(own is None or own.parameters.get(one.name) != one.was for own in facts[1:]):
            return None, [f"  the logs were flown with different {one.name}: trace one for its parameters"]
    file = f"sinan params {shlex.quote(inputs[0])} --out FILE"
    how = [f"  `{file}` writes them for the ground station"] if terms.settings and len(inputs) == 1 else []
    return terms.as_table(), [*(f"  {line}" for line in lines_of(terms)), *how]


def _not_believed(source: Source) -> list[str]:
    """A sentence for each stream that the gated filter refuses; none of poses, or where that filter has no answer."""
    if not isinstance(source, FlightSource):
        return []
    try:
        return list(refused(doubted_shares(source.gated())).values())
    except InputError:
        return []


def _what(recording: Recording) -> str:
    """What is being done: how long the flight is tells how long that takes."""
    if recording.kind != "flight" or "imu" not in recording.streams:
        return "tracing"
    t = recording.streams["imu"].t
    return f"tracing {t[-1] - t[0]:.0f} s of flight, {len(t)} IMU samples"


def taken_from_the_log(recording: Recording, source: Source) -> list[str]:
    """What a flight's preparation took from the log where the recording declares nothing, one line each."""
    used = getattr(source, "recording", recording)
    return [*used.notes[len(recording.notes) :], *_stretches(source)]


def _stretches(source: Source) -> list[str]:
    """Which stretches a flight has, where gaps that nothing bridges cut it into several."""
    found = source.stretches if isinstance(source, FlightSource) else []
    if len(found) < 2:
        return []
    spans = ", ".join(f"{start:.4g} to {end:.4g} s" for start, end in found)
    return [f"{len(found)} stretches, each with a first state and states of its own: {spans}"]
