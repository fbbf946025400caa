"""Arguments of `sinan montecarlo`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sinan.experiments.commands.arguments.saying import require_place_for, say_as_kept
from sinan.experiments.commands.arguments.shared import (
    MOST_RUNS,
    MOST_WORKERS,
    SCENARIOS,
    Html,
    Json,
    Relinearise,
    Seed,
)


def montecarlo(
    scenario: Annotated[str, typer.Argument(help=SCENARIOS)],
    runs: Annotated[int, typer.Option(help="number of flights", min=1, max=MOST_RUNS)] = 100,
    workers: Annotated[int | None, typer.Option(help="processes; default one a core", min=1, max=MOST_WORKERS)] = None,
    dask: Annotated[str | None, typer.Option(help="address of a running Dask scheduler")] = None,
    resume: Annotated[Path | None, typer.Option(help="folder that keeps finished runs")] = None,
    seed: Seed = 0,
    relinearise: Relinearise = False,
    json: Json = None,
    html: Html = None,
) -> None:
    """Fly a scenario many times and check the filter's errors against its own prediction."""
    from sinan.experiments.commands.monte_carlo import run

    require_place_for(resume)
    say_as_kept(lambda: run(scenario, runs, workers, dask, resume, seed, json, html, relinearise), json, html)
