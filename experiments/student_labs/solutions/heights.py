"""Solutions of the lab `heights`."""

from __future__ import annotations

import numpy as np

from sinan.experiments.student_labs.lab import Data, Solution
from sinan.sensors.arrays import FloatArray
from sinan.sensors.atmosphere import height_from_pressure, speed_of_sound
from sinan.sensors.constants import SEA_LEVEL_PRESSURE


def speed(data: Data) -> FloatArray:
    """Speed of sound [m/s]."""
    return np.array([speed_of_sound(data["air"])[0]])


def sonar(data: Data, tilted: bool = True) -> FloatArray:
    """(n,) height by sonar [m], NaN without an echo."""
    d = 0.5 * speed(data)[0] * data["time_of_flight"]
    return np.asarray(d * np.cos(data["roll"]) * np.cos(data["pitch"]) if tilted else d)


def absolute(data: Data) -> FloatArray:
    """(n,) height of the standard atmosphere [m]."""
    return height_from_pressure(data["pressure"], SEA_LEVEL_PRESSURE)


def line(data: Data) -> FloatArray:
    """Barometer minus sonar: at t = 0 [m], and its drift [m/min]."""
    off = absolute(data) - sonar(data)
    known = np.isfinite(off)
    slope, start = np.polyfit(data["t"][known], off[known], 1)
    return np.array([start, 60.0 * slope])


def scatters(data: Data) -> FloatArray:
    """1 sigma of sonar and barometer [m]: third differences of the height, which see noise and next to no motion."""
    known = np.isfinite(data["time_of_flight"])
    whole = np.convolve(known, np.ones(4), mode="valid") == 4
    return np.array([np.std(np.diff(h, 3)[whole]) / np.sqrt(20.0) for h in (sonar(data), absolute(data))])


def weight(data: Data) -> FloatArray:
    """Share of the sonar in the mean of least variance."""
    s, b = scatters(data)
    return np.array([b**2 / (s**2 + b**2)])


SOLUTIONS = {
    "speed": Solution(speed, (lambda d: np.sqrt(1.4 * 287.05287 * np.abs(d["air"][:1])),)),
    "height": Solution(
        lambda d: np.array([np.nanmean(sonar(d))]),
        (
            lambda d: np.array([np.nanmean(sonar(d, False))]),
            lambda d: np.array([2.0 * np.nanmean(sonar(d))]),
        ),
    ),
    "offset": Solution(lambda d: line(d)[:1], (lambda d: -line(d)[:1],)),
    "drift": Solution(
        lambda d: line(d)[1:],
        (
            lambda d: line(d)[1:] / 60.0,
            lambda d: -line(d)[1:],
        ),
    ),
    "weight": Solution(
        weight,
        (
            lambda d: 1.0 - weight(d),
            lambda d: scatters(d)[1:] / np.sum(scatters(d)),
        ),
    ),
}
