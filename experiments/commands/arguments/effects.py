"""Arguments of `sinan effects`."""

from __future__ import annotations

from typing import Annotated

import typer

from sinan.experiments.commands.arguments.saying import know
from sinan.experiments.commands.arguments.shared import OwnEffects


def effects(
    name: Annotated[
        str | None, typer.Argument(help="of an effect or a sensor; without one, all", metavar="[NAME]")
    ] = None,
    own_effects: OwnEffects = None,
) -> None:
    """List the effects that can be found, or explain one of them."""
    from sinan.experiments.commands.effects import run

    know(own_effects)
    typer.echo(run(name))
