"""`sinan observability`: a scenario or a recording -> which biases it shows, as text, JSON and a page."""

from __future__ import annotations

from pathlib import Path

from sinan.experiments.answers.observability import Observability, case_of
from sinan.experiments.bias_observability.study import study
from sinan.experiments.report.console import working
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.window import WHOLE, Span


def run(
    input: str,
    map_file: Path | None,
    json: Path | None,
    html: Path | None,
    span: Span = WHOLE,
    choice: Choice = FIRST,
) -> str:
    """Study a scenario or a recording, write what is asked for, return the summary for the terminal."""
    with working("following what every set of sensors shows", flies=True):
        answer = Observability(study(case_of(input, map_file, span, choice)))
    if json is not None:
        answer.to_json(json)
    if html is not None:
        with working("drawing"):
            answer.to_html(html)
    return answer.summary()
