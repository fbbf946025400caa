"""Arguments of `sinan gnss`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from sinan.experiments.commands.arguments.saying import say
from sinan.experiments.commands.arguments.shared import Html, Json


class Code(StrEnum):
    """Of pseudoranges."""

    ca = "ca"
    p = "p"
    p_two = "p_two"


def gnss(
    observation: Annotated[Path, typer.Argument(help="RINEX observation file", metavar="OBS")],
    navigation: Annotated[list[Path], typer.Argument(help="RINEX navigation files", metavar="NAV...")],
    systems: Annotated[str, typer.Option(help="G GPS, E Galileo, J QZSS, C BeiDou, R GLONASS")] = "G,E,J,C",
    mask: Annotated[float, typer.Option(help="lowest elevation, deg", min=-90.0, max=90.0)] = 10.0,
    position: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="known position of a receiver at rest, ECEF, m", metavar="X Y Z"),
    ] = None,
    reference: Annotated[Path | None, typer.Option(help="known positions of a moving receiver")] = None,
    base: Annotated[Path | None, typer.Option(help="RINEX observation file of a base receiver")] = None,
    base_position: Annotated[
        tuple[float, float, float] | None, typer.Option(help="known position of the base, ECEF, m", metavar="X Y Z")
    ] = None,
    code: Annotated[
        Code, typer.Option(help="C/A and its like; P; P of both frequencies, without ionosphere")
    ] = Code.ca,
    link: Annotated[
        str | None,
        typer.Option(
            help="data link from the base, such as delay=5,interval=2,loss=0.1,run=3,content=raw (docs/gnss.md)"
        ),
    ] = None,
    solution: Annotated[Path | None, typer.Option(help="file for the fixes, as CSV", metavar="FILE")] = None,
    json: Json = None,
    html: Html = None,
) -> None:
    """Compute positions from pseudoranges (RINEX), and find which effects the ranges call for."""
    from sinan.experiments.commands.gnss import run

    places = position, reference, base, base_position
    say(
        lambda: run(observation, navigation, systems, mask, *places, code.value, link, solution, json, html),
        json,
        html,
        fixes=solution,
    )
