"""Solutions of the lab `gyroscope`."""

from __future__ import annotations

import numpy as np

from sinan.experiments.student_labs.gyroscope import ANGLE, RATE, REST, WANTED
from sinan.experiments.student_labs.lab import Data, Solution
from sinan.sensors.arrays import FloatArray


def bias(data: Data) -> FloatArray:
    """Mean reading at rest [rad/s]."""
    return np.array([np.mean(data["wz"][data["t"] < REST])])


def angle(data: Data, b: FloatArray | float = 0.0) -> FloatArray:
    """Angle [deg] at the end, by adding up reading + b."""
    return np.rad2deg(np.array([np.sum(data["wz"] + b) / RATE]))


def density(data: Data) -> FloatArray:
    """White-noise density [rad/s/sqrt(Hz)]: scatter at rest over the root of the rate."""
    return np.array([np.std(data["wz"][data["t"] < REST], ddof=1) / np.sqrt(RATE)])


def rest_needed(data: Data) -> FloatArray:
    """Time at rest [s] after which the mean knows the bias to `WANTED`: sigma = N / sqrt(time)."""
    return (density(data) / WANTED) ** 2


SOLUTIONS = {
    "b": Solution(
        lambda d: -bias(d),
        (
            bias,
            lambda d: -np.rad2deg(bias(d)),
        ),
    ),
    "angle_raw": Solution(angle, (lambda d: np.deg2rad(angle(d)),)),
    "angle": Solution(lambda d: angle(d, -bias(d)), (angle,)),
    "K": Solution(
        lambda d: np.rad2deg(ANGLE) / angle(d, -bias(d)),
        (
            lambda d: angle(d, -bias(d)) / np.rad2deg(ANGLE),
            lambda d: np.rad2deg(ANGLE) / angle(d),
        ),
    ),
    "density": Solution(density, (lambda d: density(d) * np.sqrt(RATE),)),
    "rest": Solution(rest_needed, (lambda d: np.sqrt(rest_needed(d)),)),
}
