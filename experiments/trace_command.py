"""`sinan trace`: a recording -> the effect that its plain model lacks, as text, JSON and a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from experiments.datasets import called, resolve
from experiments.refused import doubted_shares, refused
from experiments.report.console import note, tell_notes, working
from experiments.report.files import write_json
from experiments.report.verdict_words import Log, trace_summary, worded
from experiments.residual_loop.flight import FlightSource
from experiments.residual_loop.report import report
from experiments.residual_loop.run import trace_recording
from experiments.residual_loop.source import Source
from sensors.errors import InputError
from sensors.formats.choice import FIRST, Choice
from sensors.joining import joined
from sensors.recording import Recording
from sensors.window import WHOLE, Span


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
    if len(inputs) > 1 and span != WHOLE:
        raise InputError("--from and --to", f"{len(inputs)} logs", "one log; `sinan convert` makes a log of a part")
    recording = joined([resolve(one, map_file, span, choice) for one in inputs])
    input = inputs[0]
    tell_notes(recording)
    if recording.kind == "flight" and sensor is not None:
        note(f"--sensor {sensor} is for poses: of a flight all sensors are traced together")
    with working(_what(recording), flies=recording.kind == "flight"):
        traced = trace_recording(recording, sensor, alpha, gravity)
    document = worded(
        report(traced),
        called(input, recording, span) if len(inputs) == 1 else recording.name,
        Log(input, map_file, choice),
    )
    notes = [note for part in traced.parts for note in taken_from_the_log(recording, part.source)]
    document["window"], document["notes"] = None if span == WHOLE else list(span), notes
    warnings = [warning for part in traced.parts for warning in _not_believed(part.source)]
    document["warnings"] = warnings
    if json is not None:
        write_json(json, document)
    if html is not None:
        from experiments.report.trace_page import trace_page

        with working("drawing"):
            trace_page(html, traced, document)
    said = [f"warning: {warning}" for warning in warnings]
    return "\n".join([*said, trace_summary(document), *(f"  note: {note}" for note in notes)])


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
    return list(used.notes[len(recording.notes) :])
