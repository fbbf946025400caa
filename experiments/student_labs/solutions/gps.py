"""Solutions of the lab `gps`."""

from __future__ import annotations

import numpy as np

from sinan.experiments.student_labs.gps import RADIUS, SATELLITES, XYZ
from sinan.experiments.student_labs.lab import Data, Solution
from sinan.sensors.arrays import FloatArray, IntArray

FOUR, ALL = np.arange(4), np.arange(SATELLITES)


def solved(data: Data, use: IntArray, corrected: bool) -> tuple[FloatArray, FloatArray]:
    """Position and clock (4,) [m] of the satellites in `use` by Gauss-Newton; their residuals [m]."""
    s = np.stack([data[c] for c in XYZ], axis=1)[use]
    rho = (data["pseudorange"] + (data["correction"] if corrected else 0.0))[use]
    x = np.append(RADIUS * np.mean(s, axis=0) / np.linalg.norm(np.mean(s, axis=0)), 0.0)
    for _ in range(12):
        d = x[:3] - s
        r = np.linalg.norm(d, axis=1)
        A = np.hstack([d / r[:, None], np.ones((len(r), 1))])
        x = x + np.linalg.lstsq(A, rho - r - x[3], rcond=None)[0]
    return x, rho - np.linalg.norm(x[:3] - s, axis=1) - x[3]


def position(data: Data, use: IntArray, corrected: bool = False) -> FloatArray:
    """(3,) m."""
    return solved(data, use, corrected)[0][:3]


def off(data: Data) -> FloatArray:
    """Number, from 1, of the satellite without which the others fit best, corrections applied."""
    every = np.arange(SATELLITES)
    left = [float(np.sum(solved(data, np.delete(every, k), True)[1] ** 2)) for k in every]
    return np.array([1.0 + int(np.argmin(left))])


def without(data: Data) -> IntArray:
    """Rows of the satellites that fit."""
    return np.delete(np.arange(SATELLITES), int(off(data)[0]) - 1)


SOLUTIONS = {
    "position_four": Solution(lambda d: position(d, FOUR), (lambda d: position(d, ALL),)),
    "clock": Solution(lambda d: solved(d, FOUR, False)[0][3:], (lambda d: -solved(d, FOUR, False)[0][3:],)),
    "satellite": Solution(off, (lambda d: off(d) - 1.0,)),
    "position": Solution(
        lambda d: position(d, without(d), True),
        (
            lambda d: position(d, without(d)),
            lambda d: position(d, ALL, True),
        ),
    ),
}
