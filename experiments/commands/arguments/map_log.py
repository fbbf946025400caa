"""Arguments of `sinan map`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sinan.experiments.commands.arguments.saying import choice_of, require_place_for, say
from sinan.experiments.commands.arguments.shared import Baro, From, Gps, Imu, Input, Json, Mag, Map, Raw, To


def map_log(
    input: Input,
    out: Annotated[Path, typer.Option("--out", help="folder for the cloud, the grids and the page")],
    cell: Annotated[float, typer.Option(help="side of a cell of the grids, m", min=0.01, max=1000.0)] = 0.5,
    declared: Annotated[
        bool, typer.Option("--declared", help="the mounting as the recording declares it, not as the strips show it")
    ] = False,
    map: Map = None,
    start: From = None,
    stop: To = None,
    imu: Imu = 0,
    mag: Mag = 0,
    baro: Baro = 0,
    gps: Gps = 0,
    raw: Raw = False,
    json: Json = None,
) -> None:
    """Make a map from a flight with a scanning laser: point cloud, terrain, objects, error budget, strips compared."""
    from sinan.experiments.commands.map import run

    require_place_for(out)
    choice = choice_of(imu, mag, baro, gps, raw)
    say(lambda: run(input, out, cell, not declared, map, json, (start, stop), choice), json, None)
