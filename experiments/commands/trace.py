"""`sinan trace`: a recording -> the effect that its plain model lacks, as text, JSON and a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sinan.experiments.answers.asked import Asked
from sinan.experiments.answers.traces import Trace, tell_in_its_terms, trace, what_is_done
from sinan.experiments.datasets import called, resolve
from sinan.experiments.report.console import note, tell_notes, working
from sinan.experiments.report.made import checksums
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.joining import joined
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
    answer = trace_log(inputs, sensor, alpha, gravity, map_file, span, choice)
    said_of_autopilot = tell_in_its_terms(answer.document, answer.recording, inputs)
    answer.document["logs"] = checksums(inputs) if json is not None or html is not None else []
    if json is not None:
        answer.to_json(json)
    if html is not None:
        with working("drawing"):
            answer.to_html(html)
    return "\n".join([answer.summary(), *said_of_autopilot])


def trace_log(
    inputs: Sequence[str],
    sensor: str | None,
    alpha: float,
    gravity: float | None,
    map_file: Path | None,
    span: Span = WHOLE,
    choice: Choice = FIRST,
) -> Trace:
    """One log traced, or several of one vehicle."""
    if len(inputs) > 1 and span != WHOLE:
        raise InputError("--from and --to", f"{len(inputs)} logs", "one log; `sinan convert` makes a log of a part")
    recording = joined([resolve(one, map_file, span, choice) for one in inputs])
    tell_notes(recording)
    if recording.kind == "flight" and sensor is not None:
        note(f"--sensor {sensor} is for poses: of a flight all sensors are traced together")
    name = called(inputs[0], recording, span) if len(inputs) == 1 else recording.name
    asked = Asked(name, inputs[0], map_file, span, choice)
    with working(what_is_done(recording), flies=recording.kind == "flight"):
        return trace(recording, sensor=sensor, alpha=alpha, gravity=gravity, asked=asked)
