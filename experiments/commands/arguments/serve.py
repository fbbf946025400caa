"""Arguments of `sinan serve`."""

from __future__ import annotations

from typing import Annotated

import typer

from sinan.experiments.commands.arguments.saying import show
from sinan.experiments.commands.arguments.shared import LongestWork, MostMemory


def serve(
    port: Annotated[int, typer.Option(help="on 127.0.0.1; 0: any that is free", min=0, max=65535)] = 8014,
    open_page: Annotated[bool, typer.Option("--open", help="open the page in the browser")] = False,
    size: Annotated[float, typer.Option(help="the largest log, MB", min=0.001, max=1e5)] = 500.0,
    time: LongestWork = 900.0,
    memory: MostMemory = 4096.0,
) -> None:
    """Trace in the browser: drop logs into a page that only this machine can reach, and read the verdicts."""
    from sinan.experiments.commands.serve import run
    from sinan.experiments.serve.jobs import Limits

    run(port, Limits(int(size * 2**20), time, int(memory * 2**20)), open_page, show)
