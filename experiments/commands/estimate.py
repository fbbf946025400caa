"""`sinan estimate`: a flight -> states, biases and their consistency, as text, JSON and a page."""

from __future__ import annotations

from pathlib import Path

from sinan.experiments.answers.asked import Asked
from sinan.experiments.answers.estimates import estimate
from sinan.experiments.datasets import called, resolve
from sinan.experiments.report.console import tell_notes, working
from sinan.experiments.report.made import checksums
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.window import WHOLE, Span


def run(
    input: str,
    engine: str,
    states: Path | None,
    map_file: Path | None,
    json: Path | None,
    html: Path | None,
    relinearise: bool = False,
    span: Span = WHOLE,
    choice: Choice = FIRST,
    smoothed: bool = False,
) -> str:
    """Run the filter, and the smoother behind it if asked for; write what is asked for, return the summary for the
    terminal.
    """
    recording = resolve(input, map_file, span, choice)
    tell_notes(recording)
    asked = Asked(called(input, recording, span), input, map_file, span, choice)
    with working("running the filter", flies=True):
        answer = estimate(recording, smooth=smoothed, relinearise=relinearise, engine=engine, asked=asked)
    answer.document["logs"] = checksums([input]) if json is not None or html is not None else []
    if states is not None:
        answer.to_csv(states)
    if json is not None:
        answer.to_json(json)
    if html is not None:
        with working("drawing"):
            answer.to_html(html)
    return answer.summary()
