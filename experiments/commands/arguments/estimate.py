"""Arguments of `sinan estimate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sinan.experiments.commands.arguments.saying import choice_of, know, say
from sinan.experiments.commands.arguments.shared import (
    Baro,
    From,
    Gps,
    Html,
    Imu,
    Input,
    Json,
    Mag,
    Map,
    OwnEffects,
    Raw,
    Relinearise,
    To,
)


def estimate(
    input: Input,
    engine: Annotated[str, typer.Option(help="numba (compiled), filterpy (readable, slow) or auto")] = "auto",
    states: Annotated[Path | None, typer.Option(help="file for the states over time, as CSV", metavar="FILE")] = None,
    map: Map = None,
    start: From = None,
    stop: To = None,
    imu: Imu = 0,
    mag: Mag = 0,
    baro: Baro = 0,
    gps: Gps = 0,
    raw: Raw = False,
    relinearise: Relinearise = False,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="also the fixed-interval smoother: states and errors given all readings")
    ] = False,
    own_effects: OwnEffects = None,
    json: Json = None,
    html: Html = None,
) -> None:
    """Run the filter on a flight: motion, biases with their uncertainty, consistency, errors against a reference."""
    know(own_effects)
    from sinan.experiments.commands.estimate import run

    span, choice = (start, stop), choice_of(imu, mag, baro, gps, raw)
    files = states, map, json, html
    say(lambda: run(input, engine, *files, relinearise, span, choice, smooth), json, html, states=states)
