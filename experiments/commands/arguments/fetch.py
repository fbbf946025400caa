"""Arguments of `sinan fetch`."""

from __future__ import annotations

from typing import Annotated

import typer


def fetch(
    names: Annotated[
        list[str] | None, typer.Argument(help="data sets; all if none is named", metavar="[NAME]...")
    ] = None,
) -> None:
    """Download measured data sets and check their checksums; with SINAN_DATA=DIR, check a local mirror of them."""
    from sinan.experiments.datasets.fetch import fetch as fetch_sets
    from sinan.experiments.report.console import progress

    with progress("fetching") as step:
        folders = fetch_sets(names or [], lambda name, file, done, total: step(f"{name}/{file}", done, total))
    for name, folder in folders.items():
        typer.echo(f"{name}: {folder}")
