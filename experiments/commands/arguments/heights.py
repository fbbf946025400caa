"""Arguments of `sinan heights`."""

from __future__ import annotations

from sinan.experiments.commands.arguments.saying import choice_of, say
from sinan.experiments.commands.arguments.shared import Baro, From, Gps, Html, Imu, Input, Json, Mag, Map, Raw, To


def heights(
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
    """Compare heights of sonar, laser, barometer and GPS with each other and the filter; missing sonar echoes."""
    from sinan.experiments.commands.heights import run

    say(lambda: run(input, map, json, html, (start, stop), choice_of(imu, mag, baro, gps, raw)), json, html)
