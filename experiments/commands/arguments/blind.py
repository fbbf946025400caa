"""Arguments of `sinan blind`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from sinan.experiments.commands.arguments.saying import require_place_for, say_as_kept
from sinan.experiments.commands.arguments.shared import MOST_RUNS, MOST_WORKERS, Html, Seed


class World(StrEnum):
    """How much of a blind recording's noise is as it declares."""

    declared = "declared"
    rough = "rough"
    mixed = "mixed"


def blind(
    out: Annotated[Path, typer.Argument(help="folder for recordings, answers, reports and rates", metavar="OUT")],
    runs: Annotated[int, typer.Option(help="number of recordings", min=1, max=MOST_RUNS)] = 100,
    seed: Seed = 0,
    world: Annotated[World, typer.Option(help="noise as declared, rough, or each half of the time")] = World.mixed,
    workers: Annotated[int, typer.Option(help="processes", min=1, max=MOST_WORKERS)] = 1,
    html: Html = None,
    camera: Annotated[bool, typer.Option("--camera", help="flights with a camera that sees known points")] = False,
    measured: Annotated[bool, typer.Option("--measured", help="put effects into minutes of measured logs")] = False,
    logs: Annotated[
        list[str] | None, typer.Option(help="measured: one log, by its name or DATASET/FILE; may be given again")
    ] = None,
    table: Annotated[Path | None, typer.Option(help="measured: file for the page, Markdown", metavar="FILE")] = None,
) -> None:
    """Measure how often traces are right: recordings with hidden effects, answers opened afterwards."""
    require_place_for(out)
    if measured:
        from sinan.experiments.blind.measured.command import run as run_measured

        say_as_kept(lambda: run_measured(out, runs, seed, logs or [], workers, table), None, None, table=table)
        return
    from sinan.experiments.commands.blind import run

    say_as_kept(lambda: run(out, runs, seed, world.value, workers, html, camera), None, html)
