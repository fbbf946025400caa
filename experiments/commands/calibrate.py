"""`sinan calibrate`: a recording of poses -> T, K, b of one sensor or of all, as text, JSON and a page."""

from __future__ import annotations

from pathlib import Path

from sinan.experiments.answers.asked import Asked
from sinan.experiments.answers.calibrations import calibrate
from sinan.experiments.datasets import called, resolve
from sinan.experiments.report.console import tell_notes
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
) -> str:
    """Calibrate, write what is asked for, return the summary for the terminal."""
    recording = resolve(input, map_file, span)
    tell_notes(recording)
    asked = Asked(called(input, recording, span), input, map_file, span)
    answer = calibrate(recording, sensor, axes=axes, gravity=gravity, asked=asked)
    if json is not None:
        answer.to_json(json)
    if html is not None:
        answer.to_html(html)
    return answer.summary()
