"""`sinan heights`: heights of sonar, laser, barometer and GPS against each other and the filter: text, JSON, a page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sinan.experiments.datasets import called, resolve
from sinan.experiments.heights import Heights, SonarFailure, heights_of
from sinan.experiments.report.console import tell_notes, working
from sinan.experiments.report.files import write_json
from sinan.experiments.report.heights_words import summary
from sinan.sensors.arrays import finite_or_none
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.window import WHOLE, Span, start_of


def run(
    input: str, map_file: Path | None, json: Path | None, html: Path | None, span: Span = WHOLE, choice: Choice = FIRST
) -> str:
    """Compare, write what is asked for, return the summary for the terminal."""
    recording = resolve(input, map_file, span, choice)
    tell_notes(recording)
    with working("running the filter", flies=True):
        found = heights_of(recording)
    document = as_json(found, start_of(recording))
    document["called"] = called(input, recording, span)
    if json is not None:
        write_json(json, document)
    if html is not None:
        from sinan.experiments.report.heights_page import heights_page

        heights_page(html, document["called"], found, document)
    return summary(document)


def as_json(found: Heights, begin: float = 0.0) -> dict[str, Any]:
    """Differences and failures; times from the recording's start.

    Parameters
    ----------
    begin : what the recording's clock shows at its start [s]
    """

    def three(values: tuple[float, float, float] | None) -> dict[str, float | None] | None:
        names = ("offset", "scatter", "slope")
        return None if values is None else {n: finite_or_none(v) for n, v in zip(names, values, strict=True)}

    sonar = None
    if "sonar" in found.courses:
        low, high, tilt = (finite_or_none(value) for value in found.heard)
        sonar = {
            "readings": len(found.courses["sonar"].t),
            "heard": {"from": low, "to": high, "tilt": tilt},
            "failures": [_failure(failure, begin) for failure in found.failures],
        }
    return {
        "format": 1,
        "tilt_compensated": found.motion is not None,
        "sensors": {
            name: {"readings": len(course.t), "against_filter": three(course.against_filter)}
            for name, course in found.courses.items()
        },
        "pairs": [{"sensors": list(pair), **(three(values) or {})} for pair, values in found.pairs.items()],
        "sonar": sonar,
    }


def _failure(failure: SonarFailure, begin: float) -> dict[str, Any]:
    return {
        "from": failure.start - begin,
        "to": failure.stop - begin,
        "readings": failure.lost,
        "kind": failure.kind,
        "cause": failure.cause,
    }
