"""Accelerations in step with the turning, which `level` neglects.

A thing in the hand or on a joint turns about a point from which the accelerometer is r away. That accelerates it by

    a = (w x)^2 r + (dw/dt x) r,

linear in r. Without GPS nothing tells where the body's reference point is, so that this is no `accel.lever_arm`; but it
is the largest part of what such a log leaves. Neglects that the filter takes a part of it for a tilt, so that r comes
out too short: by a tenth to a fifth in simulation.

Where the point moves, each component of a is another such function. In a motion to and fro the tilt that an error of
the gyroscope leaves is as much in step with the turning, and looks like it. So an effect on the IMU is judged given

    a_i = sum_jk q_ijk w_j w_k + sum_j d_ij dw_j/dt,

27 numbers of which nothing is known. What they do not take up is a tilt that stays when the turning has ended. They are
taken at the middle of the window of `level`, which neglects how they change within it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from sinan.estimator.evidence.score import BLOCKS, block_scatter, log_p_of_divided
from sinan.estimator.evidence.sensitivity import driver_regressors
from sinan.estimator.filter.effect_forms import Along, Terms
from sinan.estimator.filter.events import window_means
from sinan.estimator.filter.flight_model import FlightModel
from sinan.experiments.residual_loop.onsets import Rows, projected_out
from sinan.experiments.residual_loop.probes import offsets
from sinan.sensors.arrays import FloatArray, IntArray
from sinan.sensors.effects import Effect, effect
from sinan.sensors.effects.declaration import Parameter
from sinan.sensors.motion import Motion
from sinan.sensors.recording import Recording

#: The functions of w and dw/dt of which each component has its own multiples.
_SQUARES = np.triu_indices(3)
#: Directions of an effect that are seen: share of the information of the best.
_FLOOR = 1e-6
#: Readings of each block of time, at the least, from whose scatter it is said how well r is known.
_LEAST = 5


def in_step(motion: Motion) -> FloatArray:
    """(n, 3, 27) the accelerations of the module's last equation, one column a number."""
    w = motion.w_ib_b
    return offsets(np.concatenate([w[:, _SQUARES[0]] * w[:, _SQUARES[1]], motion.dw_b], axis=1), 3)


IN_STEP = Effect(
    name="probe.level.turning",
    stream="level",
    summary="The body accelerates in step with its turning.",
    enters="",
    physics="No effect of the catalogue: what `level` neglects.",
    source="",
    parameters=tuple(Parameter(f"b{k}", "1", 1.0) for k in range(27)),
    needs=("w_ib_b", "dw_b"),
    regressor=in_step,
)


def log_p_given_turning(rows: Rows, turning: FloatArray) -> float:
    """Logarithm of the p-value of an effect, to which `wanted` are the sensitivities, given what is in `own` and
    `turning` (r, 27), the sensitivities to `IN_STEP`; divided by the scatter of its blocks in time.

    An effect whose own estimate explains less than half of what it predicts there is none: the acceleration has given
    it its size. So is one of which nothing is left there.
    """
    asked = np.column_stack([rows.wanted, rows.white])
    alone = projected_out(rows.own, asked)
    jointly = projected_out(np.hstack([rows.own, turning]), asked)
    information, W, z = alone[:, :-1].T @ alone[:, :-1], jointly[:, :-1], jointly[:, -1]
    values, vectors = np.linalg.eigh(W.T @ W)
    seen = values > _FLOOR * max(float(np.trace(information)), 1e-300)
    if not np.any(seen):
        return 0.0
    predicted = W @ (np.linalg.pinv(information, rcond=_FLOOR, hermitian=True) @ (alone[:, :-1].T @ alone[:, -1]))
    if 2.0 * float(predicted @ z) - float(predicted @ predicted) < 0.5 * float(predicted @ predicted):
        return 0.0
    W = W @ (vectors[:, seen] / np.sqrt(values[seen]))
    beta = W.T @ z
    share = (rows.t - rows.t[0]) / max(float(np.ptp(rows.t)), 1e-300)
    inside = [np.minimum((BLOCKS * share).astype(int), BLOCKS - 1) == k for k in range(BLOCKS)]
    of_blocks = np.stack([W[block].T @ W[block] for block in inside])
    scatter = block_scatter(of_blocks, np.stack([W[block].T @ z[block] for block in inside]), beta)
    return log_p_of_divided(float(beta @ beta), int(np.sum(seen)), *scatter)


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
