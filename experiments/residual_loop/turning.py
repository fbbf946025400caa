"""Accelerations in step with the turning, which `level` neglects.

A thing in the hand or on a joint turns about a point from which the accelerometer is r away. That accelerates it by

    a = (w x)^2 r + (dw/dt x) r,

linear in r. Without GPS nothing tells where the body's reference point is, so that this is no `accel.lever_arm`; but it
is the largest part of what such a log leaves. Neglects that the filter takes a part of it for a tilt, so that r comes
out too short: by a tenth to a fifth in simulation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from sinan.estimator.evidence.score import BLOCKS
from sinan.estimator.evidence.sensitivity import driver_regressors
from sinan.estimator.filter.effect_forms import Along, Terms
from sinan.estimator.filter.events import window_means
from sinan.estimator.filter.flight_model import FlightModel
from sinan.sensors.arrays import FloatArray, IntArray
from sinan.sensors.effects import effect
from sinan.sensors.motion import Motion
from sinan.sensors.recording import Recording

#: Readings of each block of time, at the least, from whose scatter it is said how well r is known.
_LEAST = 5


@dataclass(frozen=True)
class TurningPoint:
    """Where a body turns, as its accelerometer sees it.

    Attributes
    ----------
    arm, std : (3,) from the point to the accelerometer, in the body, and its 1-sigma by the scatter of blocks [m]
    share : of the variance of the residual
    p_value : of a body that turns about its accelerometer: Hotelling's test of the blocks
    """

    arm: FloatArray
    std: FloatArray
    share: float
    p_value: float

    @property
    def words(self) -> str:
        """Of the report."""
        arm, std = (", ".join(f"{value:.2g}" for value in part) for part in (self.arm, self.std))
        return (
            f"{self.share:.0%} of the variance of the level (accelerometer) residual looks like the acceleration of a "
            f"body that turns about a point, with the accelerometer at ({arm}) ± ({std}) m from it"
        )


def turning_regressor(recording: Recording, model: FlightModel, motion: Motion) -> FloatArray:
    """(k, 3, 3) d a / d r, averaged over each window of `level`; `motion` at the samples of the IMU table."""
    G = driver_regressors(Along(recording, model, Terms(), motion), "accel", [effect("accel.lever_arm")])
    imu = recording.streams["imu"].t
    return window_means(recording, model, G[np.clip(np.searchsorted(motion.t, imu), 0, len(motion) - 1)])


def turning_point(G: FloatArray, residual: FloatArray, row: IntArray) -> TurningPoint | None:
    """Least squares of the residual of `level`; None where there are too few readings, or turns about too few axes.

    Parameters
    ----------
    G : from `turning_regressor`
    residual, row : (n, 3) [m/s^2], and (n,) the reading of each
    """
    if len(row) < _LEAST * BLOCKS or not np.any(residual):
        return None
    G = G[row]
    information, score = np.einsum("nji,njk->nik", G, G), np.einsum("nji,nj->ni", G, residual)
    L = information.sum(axis=0)
    if np.linalg.cond(L) > 1e6:
        return None
    arm = np.linalg.solve(L, score.sum(axis=0))
    left = score - information @ arm
    blocks = np.array([part.sum(axis=0) for part in np.array_split(left, BLOCKS)])
    inverse = np.linalg.inv(L)
    covariance = inverse @ (blocks.T @ blocks) @ inverse * (BLOCKS / (BLOCKS - 1.0))
    total = float(arm @ np.linalg.solve(covariance, arm))
    freedom = BLOCKS - len(arm)
    p = float(stats.f.sf(total * freedom / (len(arm) * (BLOCKS - 1.0)), len(arm), freedom))
    share = 1.0 - float(np.sum((residual - np.einsum("nij,j->ni", G, arm)) ** 2) / np.sum(residual**2))
    return TurningPoint(arm, np.sqrt(np.diag(covariance)), share, p)
