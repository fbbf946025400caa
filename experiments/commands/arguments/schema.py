"""Arguments of `sinan schema`."""

from __future__ import annotations

from typing import Annotated

import typer


def schema(
    name: Annotated[
        str | None, typer.Argument(help="of a schema; without one, all are listed", metavar="[NAME]")
    ] = None,
) -> None:
    """Print the JSON Schema of what a command writes as JSON, or of a file that is read."""
    import json

    from sinan.experiments.schemas import schema, titles

    if name is None:
        typer.echo("\n".join(f"{known:26}{title}" for known, title in titles().items()))
    else:
        typer.echo(json.dumps(schema(name), indent=1, ensure_ascii=False))
