"""Arguments of `sinan info`."""

from __future__ import annotations

from sinan.experiments.commands.arguments.saying import choice_of, say
from sinan.experiments.commands.arguments.shared import Baro, From, Gps, Html, Imu, Input, Json, Mag, Map, Raw, To


def info(
    input: Input,
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
    """Say what is in a log: sensors, rates, gaps, units, firmware, parameters, and what a trace could find in it."""
    from sinan.experiments.commands.info import run

    span, choice = (start, stop), choice_of(imu, mag, baro, gps, raw)
    say(lambda: run(input, map, json, span, choice, html), json, html)
