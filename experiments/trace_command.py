"""`sinan trace`: a recording -> the effect that its plain model lacks, as text, JSON and a page."""

from __future__ import annotations

from pathlib import Path

from experiments.datasets import reference_of, resolve
from experiments.report.console import tell_notes
from experiments.report.files import write_json
from experiments.report.words import trace_summary
from experiments.residual_loop.open_source import pose_source
from experiments.residual_loop.source import Source
from experiments.residual_loop.trace import Trace, report, trace
from sensors.recording import Recording, Stream


def run(
    input: str,
    sensor: str | None,
    alpha: float,
    gravity: float | None,
    map_file: Path | None,
    json: Path | None,
    html: Path | None,
) -> str:
    """Trace, write what is asked for, return the summary for the terminal."""
    recording = resolve(input, map_file)
    tell_notes(recording)
    reference = reference_of(input, map_file) if recording.kind == "flight" else None
    source, result = trace_recording(recording, sensor, alpha, gravity, reference)
    document = report(source, result)
    notes = taken_from_the_log(recording, source)
    document["notes"] = notes
    if json is not None:
        write_json(json, document)
    if html is not None:
        from experiments.report.trace_page import trace_page

        trace_page(html, source, result, document)
    return "\n".join([trace_summary(document), *(f"  note: {note}" for note in notes)])


def trace_recording(
    recording: Recording,
    sensor: str | None = None,
    alpha: float = 0.01,
    gravity: float | None = None,
    reference: Stream | None = None,
) -> tuple[Source, Trace]:
    """The loop on a recording of either kind.

    Parameters
    ----------
    reference : what a flight is scored against, after the decision; columns as in `truth.csv`
    """
    if recording.kind == "poses":
        source = pose_source(recording, sensor, gravity)
        return source, trace(source, alpha)
    from experiments.residual_loop.open_flight import flight_source
    from experiments.residual_loop.reference import score_against

    flight = flight_source(recording)
    return flight, trace(flight, alpha, None if reference is None else score_against(reference, flight))


def taken_from_the_log(recording: Recording, source: Source) -> list[str]:
    """What a flight's preparation took from the log where the recording declares nothing, one line each."""
    used = getattr(source, "recording", recording)
    return list(used.notes[len(recording.notes) :])
