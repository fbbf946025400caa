"""Arguments of `sinan batch`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sinan.experiments.commands.arguments.saying import know, require_place_for, show
from sinan.experiments.commands.arguments.shared import MOST_WORKERS, LongestWork, MostMemory, OwnEffects


def batch(
    inputs: Annotated[list[str], typer.Argument(help="logs, recordings, or folders that hold them", metavar="LOG...")],
    out: Annotated[Path, typer.Option("--out", help="folder for pages and reports; what it holds is not done again")],
    own_effects: OwnEffects = None,
    workers: Annotated[int | None, typer.Option(help="processes; default one a core", min=1, max=MOST_WORKERS)] = None,
    dask: Annotated[str | None, typer.Option(help="address of a running Dask scheduler")] = None,
    time: LongestWork = 900.0,
    memory: MostMemory = 4096.0,
) -> None:
    """Trace many logs: a page for each, and one that ranks the vehicles by effect and shows what changed."""
    know(own_effects)
    from sinan.experiments.commands.batch import run
    from sinan.experiments.workers.alone import Limits

    require_place_for(out)
    show(run(inputs, out, workers, dask, Limits(time, int(memory * 2**20))))
    show(f"page: {out / 'index.html'}")
