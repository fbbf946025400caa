"""Exact derivatives of the likelihood by every level of noise, from one forward and one backward pass.

The filter's recursions are differentiated backwards. With r = d log L / dx and G = d log L / dP after a reading of
weight w, M = S / w = L L', y = L^-1 nu, K = P H' M^-1, its part of log L being log(exp(A) + stray) with
A = -1/2 log |S| - 1/2 rho(nu' S^-1 nu), and p the probability exp(A) / (exp(A) + stray) that it is no stray answer,

    g = d log L / d log w = r' K nu - tr(G K M K')           the correction that it makes
    a = d log L / d A = p + g (1 - p)                        as w = p rho' and d log p = (1 - p) dA; 1 where p is
    c = (a rho' + 2 g / (tail + NIS)) / w                    1 where w is; the second term where rho' < 1
    d log L / d nu = K' r - c M^-1 nu                        and r <- r - H' d log L / d nu
    d log L / d S = L^-T (-a/2 + c/2 y y' - sym(y (K L)' r) + L' K' G K L) L^-1 / w

which is d log L / d R, too; G takes what P does in S, in P H' and by itself. A step has r <- Phi' r, G <- Phi' G Phi,
and d log L / d Q = G. Of a first-order process of standard deviation s and time constant tau, phi = exp(-h / tau) and
q = s^2 (1 - phi^2), so that with x and P after the step

    d log L / d log tau = sum over steps of  h / tau (r_i x_i + 2 (G P)_ii - 2 s^2 G_ii)

For a normal law G is 1/2 (r r' - N), N the covariance of r: Fisher's identity (S. J. Koopman and
N. Shephard, Biometrika 79(4), 1992, 823). The model is taken as linear about the filter's own estimates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.estimator.filter.events import ACCEPTED
from sinan.estimator.filter.inputs import RunInputs
from sinan.estimator.filter.layout import CAPACITY
from sinan.estimator.filter.pieces import parts_of, recorded
from sinan.sensors.arrays import FloatArray, IntArray
from sinan.sensors.window import time_in_log

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
    time_of_part : (parts, n) by the logarithm of the time constant of each colour, its standard deviation fixed
    first_interval, first_reading : (parts,) of each part
    start : (n, n) by the first covariance, of all stretches together
    start_x : (n,) by the first state of the first stretch
    """

    loglik: FloatArray
    nis: FloatArray
    weight: FloatArray
    r: FloatArray
    q_accel: FloatArray
    q_gyro: FloatArray
    bias_of_part: FloatArray
    time_of_part: FloatArray
    first_interval: IntArray
    first_reading: IntArray
    start: FloatArray
    start_x: FloatArray

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
        np.zeros((len(parts), n)), np.zeros((len(parts), n)), np.array([part.i0 for part in parts]), first_reading,
        np.zeros((n, n)), np.zeros(n),
    )  # fmt: skip
    r, G = np.zeros(CAPACITY), np.zeros((CAPACITY, CAPACITY))
    for number in reversed(range(len(parts))):
        part = parts[number]
        _backward(part.inputs, number, int(inputs.events.row[first_reading[number]]), r, G, found)
        if part.begins:  # later readings say nothing of what was before
            elapsed = time_in_log(inputs.recording, inputs.imu.t[0], part.inputs.imu.t[0])
            _add_walked(part.inputs, elapsed, G, found.bias_of_part[number])
            found.start[:] += G[:n, :n]
            found.start_x[:] = r[:n]
            r[:], G[:] = 0.0, 0.0
    return found


def _add_walked(inputs: RunInputs, elapsed: float, G: FloatArray, bias: FloatArray) -> None:
    """What a first covariance has of walks since the log began (`FlightModel.after`): walk^2 elapsed in each bias."""
    for process in inputs.model.processes:
        if np.isinf(process.tau):
            block = inputs.model.layout.slice(process.block)
            bias[block] += process.walk**2 * elapsed * np.diag(G)[block]


def _backward(part: RunInputs, number: int, row0: int, r: FloatArray, G: FloatArray, found: LevelScores) -> None:
    """Carry r and G to the start of a part, in place, and write down what they say."""
    from sinan.estimator.filter.smoother_numba import By, backward_scores

    i0, k0 = int(found.first_interval[number]), int(found.first_reading[number])
    engine, trail = recorded(part, 0, times=True)
    outputs, row = engine.outputs, part.events.row
    K, intervals = len(part.events), slice(i0, i0 + len(part.imu) - 1)
    used, bias, time = outputs.status == ACCEPTED, np.zeros(CAPACITY), np.zeros(CAPACITY)
    by = By(found.r[row0 : row0 + int(row[-1])], found.q_accel[intervals], found.q_gyro[intervals], bias, time)
    tail = np.array([part.model.tail_of(name) or 0.0 for name in part.events.sensors])[part.events.sensor]
    freedom = part.events.freedom
    backward_scores(trail, row, engine.written, used, tail, freedom, engine.world, r, G.reshape(-1), by)
    n = found.bias_of_part.shape[1]
    found.bias_of_part[number], found.time_of_part[number] = bias[:n], time[:n]
    found.loglik[k0 : k0 + K] = np.where(used, outputs.loglik, 0.0)
    found.nis[k0 : k0 + K] = np.where(used, outputs.nis, 0.0)
    found.weight[k0 : k0 + K] = outputs.weight
