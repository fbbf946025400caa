"""Arguments of `sinan calibrate`."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from sinan.experiments.commands.arguments.saying import choice_of, say
from sinan.experiments.commands.arguments.shared import (
    AxesForm,
    From,
    Gravity,
    Html,
    Imu,
    Input,
    Json,
    Mag,
    Map,
    Raw,
    To,
)


class Calibrand(StrEnum):
    """What can be calibrated."""

    accel = "accel"
    gyro = "gyro"
    mag = "mag"
    all = "all"


def calibrate(
    sensor: Annotated[Calibrand, typer.Argument(help="which sensor of the log, or all")],
    input: Input,
    axes: Annotated[
        AxesForm | None, typer.Option(help="form of T, which turns and skews the axes; default none, gyro full")
    ] = None,
    gravity: Gravity = None,
    map: Map = None,
    start: From = None,
    stop: To = None,
    poses: Annotated[
        bool, typer.Option("--poses", help="an autopilot's log of a board turned by hand: its rests are the poses")
    ] = False,
    imu: Imu = 0,
    mag: Mag = 0,
    raw: Raw = False,
    json: Json = None,
    html: Html = None,
) -> None:
    """Calibrate a three-axis sensor from poses, or all that there are: T K (reading + b)."""
    from sinan.experiments.commands.calibrate import run
    from sinan.experiments.report.console import working

    def work() -> str:
        with working("calibrating"):
            form, choice = axes.value if axes else None, choice_of(imu, mag, 0, 0, raw)
            return run(sensor.value, input, form, gravity, map, json, html, (start, stop), poses, choice)

    say(work, json, html)
