"""`sinan montecarlo`: many flights of one scenario -> NEES, NIS, coverage, as text, JSON and a page."""

from __future__ import annotations

from pathlib import Path

from sinan.experiments.answers.consistency import monte_carlo
from sinan.experiments.report.console import progress
from sinan.sensors.files import together


def run(
    scenario: str,
    runs: int,
    workers: int | None,
    dask: str | None,
    resume: Path | None,
    seed: int,
    json: Path | None,
    html: Path | None,
    relinearise: bool = False,
) -> str:
    """Run, write what is asked for, return the summary for the terminal."""
    with progress("flying", flies=True) as step:
        answer = monte_carlo(
            scenario,
            runs,
            seed=seed,
            workers=workers,
            dask=dask,
            resume=resume,
            progress=lambda done, total: step("", done, total),
            relinearise=relinearise,
        )
    with together():
        if json is not None:
            answer.to_json(json)
        if html is not None:
            answer.to_html(html)
    return answer.summary()
