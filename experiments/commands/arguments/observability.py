"""Arguments of `sinan observability`."""

from __future__ import annotations

from typing import Annotated

import typer

from sinan.experiments.commands.arguments.saying import choice_of, say
from sinan.experiments.commands.arguments.shared import Baro, From, Gps, Html, Imu, Json, Mag, Map, Raw, To


def observability(
    input: Annotated[str, typer.Argument(help="recording, log, DATASET/FILE or scenario", metavar="INPUT|SCENARIO")],
    map: Map = None,
    start: From = None,
    stop: To = None,
    imu: Imu = 0,
    mag: Mag = 0,
    baro: Baro = 0,
    gps: Gps = 0,
    raw: Raw = False,
    json: Json = None,
    html: Html = None,
) -> None:
    """Say which biases a flight's motion and sensors can determine, and which manoeuvre would help."""
    from sinan.experiments.commands.observability import run

    say(lambda: run(input, map, json, html, (start, stop), choice_of(imu, mag, baro, gps, raw)), json, html)
