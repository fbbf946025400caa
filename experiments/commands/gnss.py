"""`sinan gnss`: RINEX files -> positions and traced ranges, as text, JSON and a page."""

from __future__ import annotations

from pathlib import Path

from sinan.experiments.answers.fixes import positions
from sinan.experiments.report.console import working


def run(
    observation: Path,
    navigation: list[Path],
    systems: str,
    mask: float,
    position: tuple[float, float, float] | None,
    reference: Path | None,
    base: Path | None,
    base_position: tuple[float, float, float] | None,
    code: str,
    link: str | None,
    solution: Path | None,
    json: Path | None,
    html: Path | None,
) -> str:
    """Solve and trace, write what is asked for, return the summary for the terminal."""
    with working("solving and tracing the ranges"):
        answer = positions(
            observation, navigation, systems=systems, mask=mask, position=position, reference=reference, base=base,
            base_position=base_position, code=code, link=link,
        )  # fmt: skip
    if solution is not None:
        answer.to_csv(solution)
    if json is not None:
        answer.to_json(json)
    if html is not None:
        answer.to_html(html)
    return answer.summary()
