"""Exact derivatives of the likelihood by every level of noise, from one forward and one backward pass.

With the disturbance smoother's r and N (`estimator.filter.smoother_numba`), and D, u the same of a reading,

    d log L / d q = 1/2 (r r' - N)     of the process noise q of a step
    d log L / d R = 1/2 (u u' - D)     u = S^-1 nu - K' r,  D = S^-1 + K' N K
    d log L / d P0 = 1/2 (r0 r0' - N0)

(Fisher's identity; S. J. Koopman and N. Shephard, Biometrika 79(4), 1992, 823). The model is taken as linear about the
filter's own estimates. A reading of less weight counts with the covariance that it had, S over its weight.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.estimator.filter.events import ACCEPTED
from sinan.estimator.filter.inputs import RunInputs
from sinan.estimator.filter.layout import CAPACITY
from sinan.estimator.filter.pieces import parts_of, recorded
from sinan.sensors.arrays import FloatArray, IntArray

PART = 4000  # IMU samples whose gains are in memory at one time: bound of work (`test_level_scores`)


@dataclass(frozen=True)
class LevelScores:
    """Likelihood of a run and its derivatives.

    Attributes
    ----------
    loglik : (K,) of each reading, normal; 0 of those that were not used
    nis, weight : (K,)
    r : (rows,) by the variance of each component of each reading
    q_accel, q_gyro : (N - 1,) by the variance rates of the IMU's intervals, of the three axes together
    bias_of_part : (parts, n) by the logarithm of walk^2 of each bias or colour, its time constant fixed
    first_interval, first_reading : (parts,) of each part
    start : (n, n) by the first covariance, of all stretches together
    """

    loglik: FloatArray
    nis: FloatArray
    weight: FloatArray
    r: FloatArray
    q_accel: FloatArray
    q_gyro: FloatArray
    bias_of_part: FloatArray
    first_interval: IntArray
    first_reading: IntArray
    start: FloatArray

    @property
    def bias(self) -> FloatArray:
        """(n,) that of all parts."""
        return np.asarray(np.sum(self.bias_of_part, axis=0))


def level_scores(inputs: RunInputs, length: int | None = None) -> LevelScores:
    """Run forwards and backwards over prepared inputs.

    Parameters
    ----------
    length : IMU samples of a part; default `PART`
    """
    N, n, K = len(inputs.imu), inputs.model.layout.n, len(inputs.events)
    parts = parts_of(inputs, length or PART)
    first_reading = K - np.cumsum([len(part.inputs.events) for part in reversed(parts)])[::-1]
    found = LevelScores(
        np.zeros(K), np.zeros(K), np.ones(K), np.zeros(len(inputs.events.z)), np.zeros(N - 1), np.zeros(N - 1),
        np.zeros((len(parts), n)), np.array([part.i0 for part in parts]), first_reading, np.zeros((n, n)),
    )  # fmt: skip
    r, information = np.zeros(CAPACITY), np.zeros((CAPACITY, CAPACITY))
    for number in reversed(range(len(parts))):
        part = parts[number]
        _backward(part.inputs, number, int(inputs.events.row[first_reading[number]]), r, information, found)
        if part.begins:  # later readings say nothing of what was before
            found.start[:] += 0.5 * (np.outer(r[:n], r[:n]) - information[:n, :n])
            r[:], information[:] = 0.0, 0.0
    return found


def _backward(
    part: RunInputs, number: int, row0: int, r: FloatArray, information: FloatArray, found: LevelScores
) -> None:
    """Carry r and the information to the start of a part, in place, and write down what it says."""
    from sinan.estimator.filter.smoother_numba import By, backward_scores

    i0, k0 = int(found.first_interval[number]), int(found.first_reading[number])
    engine, trail = recorded(part, 0)
    outputs, row = engine.outputs, part.events.row
    K, intervals = len(part.events), slice(i0, i0 + len(part.imu) - 1)
    used, bias = outputs.status == ACCEPTED, np.zeros(CAPACITY)
    by = By(found.r[row0 : row0 + int(row[-1])], found.q_accel[intervals], found.q_gyro[intervals], bias)
    backward_scores(trail, row, engine.written, used, engine.world, r, information, by)
    found.bias_of_part[number] = bias[: found.bias_of_part.shape[1]]
    found.loglik[k0 : k0 + K] = np.where(used, outputs.loglik, 0.0)
    found.nis[k0 : k0 + K] = np.where(used, outputs.nis, 0.0)
    found.weight[k0 : k0 + K] = outputs.weight
