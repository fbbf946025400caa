"""Solutions of the lab `accelerometer`."""

from __future__ import annotations

import numpy as np

from sinan.calibration.poses.triad import calibrate_norm
from sinan.experiments.student_labs.accelerometer import COLUMNS, POSE, G
from sinan.experiments.student_labs.lab import Data, Solution
from sinan.sensors.arrays import FloatArray


def readings(data: Data) -> FloatArray:
    """(10, 3) m/s^2."""
    return np.stack([data[c] for c in COLUMNS], axis=1)


def fitted(data: Data, g: float = G) -> tuple[FloatArray, FloatArray]:
    """K and b at the minimum of the index."""
    fit = calibrate_norm("accel", readings(data), g)
    return fit.K, fit.offset


def index(data: Data, K: FloatArray | float, b: FloatArray | float) -> FloatArray:
    """The index: sum of (|K (a + b)| - g)^2."""
    return np.array([np.sum((np.linalg.norm((readings(data) + b) * K, axis=1) - G) ** 2)])


def pitch(data: Data) -> FloatArray:
    """Pitch [deg] of the last pose, calibrated."""
    K, b = fitted(data)
    return _pitch((readings(data)[POSE] + b) * K)


def _pitch(f: FloatArray) -> FloatArray:
    return np.rad2deg(np.array([np.arctan2(f[0], np.hypot(f[1], f[2]))]))


SOLUTIONS = {
    "K": Solution(
        lambda d: fitted(d)[0],
        (
            lambda d: 1.0 / fitted(d)[0],
            lambda d: fitted(d, 1.0)[0],
        ),
    ),
    "b": Solution(lambda d: fitted(d)[1], (lambda d: -fitted(d)[1],)),
    "index_before": Solution(lambda d: index(d, 1.0, 0.0)),
    "index_after": Solution(lambda d: index(d, *fitted(d))),
    "K_one": Solution(lambda d: fitted(d, 1.0)[0], (lambda d: fitted(d)[0],)),
    "pitch": Solution(
        pitch,
        (
            lambda d: -pitch(d),
            lambda d: _pitch(readings(d)[POSE]),
            lambda d: np.deg2rad(pitch(d)),
        ),
    ),
}
