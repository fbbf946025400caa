"""Barometer: from pressure to height above the standard sea level, from there to the height above the start."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sinan.experiments.datasets import resolve
from sinan.experiments.labs.course_flight import rms
from sinan.experiments.report.lab_figures import Panel, panels
from sinan.experiments.report.page import Page
from sinan.sensors.atmosphere import height_from_pressure

LOG = "px4_quad_64a"
START = 1.0  # s whose mean is the zero of both heights: the log begins on the ground and climbs from then on


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """A measured flight: pressure, absolute height, relative height, that of GPS, and what is between them."""
    recording = resolve(LOG)
    baro, gps = recording.streams["baro"], recording.streams["gps"]
    absolute = height_from_pressure(baro["pressure"])
    relative = absolute - np.mean(absolute[baro.t < baro.t[0] + START])
    up = -gps["down"] - np.mean(-gps["down"][gps.t < gps.t[0] + START])
    between = np.interp(gps.t, baro.t, relative) - up
    slope, _ = np.polyfit(gps.t, between, 1)
    weather = float(height_from_pressure(np.array(101225.0)) - height_from_pressure(np.array(101325.0)))
    assert recording.origin is not None
    place = recording.origin[2]
    off = float(np.mean(absolute[baro.t < baro.t[0] + START])) - place
    say(f"absolute height at the start: {off + place:.0f} m where GPS says {place:.0f} m: weather and zero of heights")
    say(f"relative height against GPS: {rms(between):.2f} m RMS, wandering by {60.0 * slope:+.2f} m a minute")
    say(f"1 hPa less of weather is read as {weather:.1f} m more")
    page = Page(
        "From pressure to height",
        "The barometer measures a pressure; the standard atmosphere makes an absolute height of it. That is off by the "
        "weather, so what a vehicle flies by is the height above its start, and even that wanders.",
    )
    page.numbers(
        [
            (f"{off:+.0f} m", "absolute height off at the start, against GPS"),
            (f"{rms(between):.2f} m", "RMS difference of relative height and GPS"),
            (f"{weather:.1f} m", "read for 1 hPa of weather"),
        ]
    )
    every = slice(None, None, 10)
    figure = panels(
        [
            Panel("time / s", "pressure / hPa", {"": (baro.t[every], 0.01 * baro["pressure"][every])}),
            Panel(
                "time / s",
                "height above the start / m",
                {"barometer": (baro.t[every], relative[every]), "GPS": (gps.t, up)},
            ),
            Panel(
                "time / s",
                "barometer - GPS / m",
                {"difference": (gps.t, between), "line": (gps.t, np.polyval(np.polyfit(gps.t, between, 1), gps.t))},
            ),
        ],
        3,
    )
    page.figure(figure, f"A flight of `{LOG}`: pressure, both heights, and what is between them.")
    page.text(
        "The difference has both drifts in it, d = -p_z + b + n with b a random walk: neither sensor is a truth. What "
        "else is in it has names: `baro.airspeed` (wind), `baro.propwash`, `baro.temperature`, `baro.scale`."
    )
    page.write(out / "barometer.html")
