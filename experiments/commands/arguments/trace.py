"""Arguments of `sinan trace`."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from sinan.estimator.evidence.alpha import ALPHA
from sinan.experiments.commands.arguments.saying import choice_of, know, say
from sinan.experiments.commands.arguments.shared import (
    Baro,
    From,
    Gps,
    Gravity,
    Html,
    Imu,
    Inputs,
    Json,
    Mag,
    Map,
    OwnEffects,
    Raw,
    To,
)


class Sensor(StrEnum):
    """The three-axis sensors."""

    accel = "accel"
    gyro = "gyro"
    mag = "mag"


def trace(
    inputs: Inputs,
    sensor: Annotated[Sensor | None, typer.Option(help="only this one, of a poses recording with several")] = None,
    alpha: Annotated[
        float, typer.Option(help="risk of any false alarm, over all candidates together", min=1e-6, max=0.5)
    ] = ALPHA,
    gravity: Gravity = None,
    map: Map = None,
    start: From = None,
    stop: To = None,
    imu: Imu = 0,
    mag: Mag = 0,
    baro: Baro = 0,
    gps: Gps = 0,
    raw: Raw = False,
    own_effects: OwnEffects = None,
    json: Json = None,
    html: Html = None,
) -> None:
    """Find what is wrong with the sensors of a log: each effect with its size, and the error with and without it."""
    know(own_effects)
    from sinan.experiments.commands.trace import run

    only, span, choice = sensor.value if sensor else None, (start, stop), choice_of(imu, mag, baro, gps, raw)
    say(lambda: run(inputs, only, alpha, gravity, map, json, html, span, choice), json, html)
