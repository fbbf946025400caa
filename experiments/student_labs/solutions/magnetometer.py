"""Solutions of the lab `magnetometer`."""

from __future__ import annotations

import numpy as np

from sinan.calibration.poses.triad import calibrate_norm
from sinan.experiments.student_labs.lab import Data, Solution
from sinan.experiments.student_labs.magnetometer import COLUMNS, HIGHEST
from sinan.sensors.arrays import FloatArray
from sinan.sensors.magnetometer import tilt_compensated_heading


def normalised(data: Data) -> tuple[FloatArray, float]:
    """(n, 3) readings over the mean norm of those without current but the last, and that mean norm [gauss]."""
    raw = np.stack([data[c] for c in COLUMNS], axis=1)
    mean = float(np.mean(np.linalg.norm(raw[:-1][data["current"][:-1] == 0.0], axis=1)))
    return raw / mean, mean


def fitted(data: Data) -> tuple[FloatArray, FloatArray]:
    """K and b from the rows without current but the last."""
    r, _ = normalised(data)
    fit = calibrate_norm("mag", r[:-1][data["current"][:-1] == 0.0], 1.0)
    return fit.K, fit.offset


def heading(data: Data, tilted: bool = True) -> FloatArray:
    """Heading [deg] of the last row, calibrated."""
    K, b = fitted(data)
    m = (normalised(data)[0][-1:] + b) * K
    roll, pitch = (data[c][-1:] if tilted else np.zeros(1) for c in ("roll", "pitch"))
    return np.rad2deg(tilt_compensated_heading(m, roll, pitch))


def current_effect(data: Data) -> FloatArray:
    """d [of the normalised reading, per A] of |K (m + b + I d)| = 1, by least squares over the rows with current."""
    from scipy.optimize import least_squares

    r, _ = normalised(data)
    K, b = fitted(data)
    on = data["current"] > 0.0
    amperes = data["current"][on, None]
    found = least_squares(lambda d: np.linalg.norm((r[on] + b + amperes * d) * K, axis=1) - 1.0, np.zeros(3))
    return np.asarray(found.x)


SOLUTIONS = {
    "norm": Solution(lambda d: np.array([normalised(d)[1]])),
    "K": Solution(lambda d: fitted(d)[0], (lambda d: 1.0 / fitted(d)[0],)),
    "b": Solution(
        lambda d: fitted(d)[1],
        (
            lambda d: -fitted(d)[1],
            lambda d: fitted(d)[1] * normalised(d)[1],
        ),
    ),
    "heading": Solution(
        heading,
        (
            lambda d: heading(d, False),
            lambda d: -heading(d),
        ),
    ),
    "d": Solution(
        current_effect,
        (
            lambda d: -current_effect(d),
            lambda d: current_effect(d) * HIGHEST,
        ),
    ),
}
