"""The shapes that regressors share: what grows with one quantity on each axis, turned triads, the air."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import REFERENCE_TEMPERATURE
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import rotate_back, rotation_exp


def diagonal(value: FloatArray) -> FloatArray:
    """(n, 3) -> (n, 3, 3): axis i of the reading grows with b_i value_i."""
    return value[:, :, None] * np.eye(3)


def matrix_times(value: FloatArray) -> FloatArray:
    """(n, 3) -> (n, 3, 9): the reading grows by G value, beta = G row by row."""
    G = np.zeros((len(value), 3, 9))
    for row in range(3):
        G[:, row, 3 * row : 3 * row + 3] = value
    return G


def warmth(motion: Motion) -> FloatArray:
    """(n,) T - T0 [K], T0 = 25 degC."""
    return motion.covariates["temperature"] - REFERENCE_TEMPERATURE


def warmth_on_each_axis(motion: Motion) -> FloatArray:
    """(n, 3, 3): axis i grows by b_i (T - T0)."""
    return warmth(motion)[:, None, None] * np.eye(3)


def covariate_on_each_axis(motion: Motion, name: str) -> FloatArray:
    """(n, 3, 3): axis i grows by b_i times the covariate."""
    return motion.covariates[name][:, None, None] * np.eye(3)


def turned_triad(reading: FloatArray, beta: FloatArray) -> FloatArray:
    """(n, 3) Exp(-beta) reading: what a triad reads that is turned by the rotation vector beta against the body."""
    return reading @ rotation_exp(-np.asarray(beta)).T


def wind_n(motion: Motion) -> FloatArray:
    """(n, 3) wind in NED [m/s]; zero where it is not known."""
    wind = np.zeros((len(motion), 3))
    if motion.has("wind"):
        wind[:, :2] = motion.covariates["wind"]
    return wind


def air_velocity_b(motion: Motion) -> FloatArray:
    """(n, 3) velocity against the air, in the body [m/s]: C_bn (v - wind)."""
    return rotate_back(motion.q_nb, motion.v_n - wind_n(motion))


def airspeed(motion: Motion) -> FloatArray:
    """(n,) measured airspeed, else |v - wind| [m/s]."""
    if motion.has("airspeed"):
        return motion.covariates["airspeed"]
    return np.asarray(np.linalg.norm(motion.v_n - wind_n(motion), axis=1))
