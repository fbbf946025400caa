"""Arguments of `sinan params`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from sinan.experiments.commands.arguments.saying import choice_of, say
from sinan.experiments.commands.arguments.shared import Baro, From, Gps, Imu, Input, Mag, Map, Raw, To


class Autopilot(StrEnum):
    """Whose parameters are written."""

    px4 = "px4"
    ardupilot = "ardupilot"


def params(
    input: Input,
    autopilot: Annotated[
        Autopilot | None, typer.Option("--for", help="whose parameters; default: of the autopilot that wrote the log")
    ] = None,
    report: Annotated[
        Path | None, typer.Option("--trace", help="what `sinan trace --json` wrote of this log", metavar="REPORT.json")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="file for the ground station; default: shown", metavar="FILE")
    ] = None,
    map: Map = None,
    start: From = None,
    stop: To = None,
    imu: Imu = 0,
    mag: Mag = 0,
    baro: Baro = 0,
    gps: Gps = 0,
    raw: Raw = False,
) -> None:
    """Write what a trace finds as parameters to load into the flight controller (PX4, ArduPilot)."""
    from sinan.experiments.commands.params import run

    name, span, choice = autopilot.value if autopilot else None, (start, stop), choice_of(imu, mag, baro, gps, raw)
    say(lambda: run(input, name, report, out, map, span, choice), None, None, parameters=out)
