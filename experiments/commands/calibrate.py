"""`sinan calibrate`: a recording of poses -> T, K, b of one sensor or of all, as text, JSON and a page."""

from __future__ import annotations

from pathlib import Path

from sinan.calibration.poses.triad import Calibration
from sinan.experiments.answers.asked import Asked
from sinan.experiments.answers.calibrations import Calibrations, calibrate
from sinan.experiments.autopilots.calibrated import params_of_log
from sinan.experiments.autopilots.parameters import lines_of
from sinan.experiments.datasets import called, log_of, resolve
from sinan.experiments.report.console import tell_notes
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.window import WHOLE, Span


def run(
    sensor: str,
    input: str,
    axes: str | None,
    gravity: float | None,
    map_file: Path | None,
    json: Path | None,
    html: Path | None,
    span: Span = WHOLE,
    poses: bool = False,
    choice: Choice = FIRST,
) -> str:
    """Calibrate, write what is asked for, return the summary for the terminal.

    Parameters
    ----------
    poses : a log that says of itself that it is a flight was turned by hand: its rests are found
    """
    recording = resolve(input, map_file, span, choice)
    tell_notes(recording)
    if poses:
        recording = recording.replace(kind="poses")
    asked = Asked(called(input, recording, span), input, map_file, span, choice)
    answer = calibrate(recording, sensor, axes=axes, gravity=gravity, asked=asked)
    if json is not None:
        answer.to_json(json)
    if html is not None:
        answer.to_html(html)
    return "\n".join([answer.summary(), *_parameters(answer, log_of(input), choice)])


def _parameters(answer: Calibrations, log: Path, choice: Choice) -> list[str]:
    """What to type into the autopilot that wrote the log; nothing where none did."""
    lines: list[str] = []
    for sensor, one in answer.items():
        if isinstance(one.result, Calibration) and log.is_file():
            try:
                params = params_of_log(sensor, one.result, log, choice)
            except InputError as error:
                lines.append(f"{sensor}: no parameters: {error}")
            else:
                lines += [] if params is None else lines_of(params)
    return lines
