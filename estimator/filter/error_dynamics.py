"""How the error state moves in one step: Phi and Q, readable; the compiled engine holds the same structure.

With C_true = C Exp(dtheta_b), f_true = f_meas - b_accel - n, w_true = (1 - S) (w_meas - b_gyro) - n, and the step of
`estimator.filter.strapdown`, the derivative of the step itself (not of a continuous model):

    dtheta_1 = R dtheta_0 - h J_r(phi) db_gyro                                R = C_1' C_0
    dv_1 = dv_0 - A_0 dtheta_0 - A_1 dtheta_1 - h / 2 (C_0 + C_1) db_accel    A_k = h / 2 [C_k f_k]x C_k
    dp_1 = dp_0 + h / 2 (dv_0 + dv_1)

`with_axes` has the part of S, which most models have not. Neglects S db_gyro, the turn of the Earth inside the step
(1e-7 of dtheta, and 2 h w_ie x dv), what the coning term adds to the part of db_gyro (h / 12 of the change of rate,
1e-4 of it), and in Q the noise that the angle passes on to the velocity within one step (it does so from the next on).
"""

from __future__ import annotations

import numpy as np

from sinan.estimator.filter.flight_model import FlightModel
from sinan.estimator.filter.layout import DB_ACCEL, DB_GYRO, DP, DTHETA, DV
from sinan.estimator.filter.strapdown import Step
from sinan.sensors.arrays import FloatArray
from sinan.sensors.rotation import right_jacobian, skew


def transition(step: Step, n: int, translation: bool = True, decay: FloatArray | None = None) -> FloatArray:
    """(n, n) Phi of one step; `decay` (n,) is that of the biases, from `decay_over`; default: none decays."""
    h, Phi = step.h, np.eye(n) if decay is None else np.diag(decay)
    p, v, t, a, g = DP, DV, DTHETA, DB_ACCEL, DB_GYRO
    Phi[t, t] = step.C1.T @ step.C0
    Phi[t, g] = -h * right_jacobian(step.phi)
    if not translation:
        return Phi
    A0 = 0.5 * h * skew(step.a0) @ step.C0
    A1 = 0.5 * h * skew(step.a1) @ step.C1
    Phi[v, t] = -A0 - A1 @ Phi[t, t]
    Phi[v, g] = -A1 @ Phi[t, g]
    Phi[v, a] = -0.5 * h * (step.C0 + step.C1)
    Phi[p, v] = h * np.eye(3)
    Phi[p, t] = 0.5 * h * Phi[v, t]
    Phi[p, g] = 0.5 * h * Phi[v, g]
    Phi[p, a] = 0.5 * h * Phi[v, a]
    return Phi


def with_axes(Phi: FloatArray, axes: slice, w: FloatArray) -> FloatArray:
    """(n, n) Phi of one step in which a gyroscope's scale and axes act like a bias S w: T^-1 Phi T, b -> b + S w in T.

    Parameters
    ----------
    axes : the elements of S among the states, row by row
    w : (3,) rate of the step as it is read, less the bias [rad/s]
    """
    T = np.eye(len(Phi))
    T[DB_GYRO, axes] = np.kron(np.eye(3), w)
    found = Phi @ T
    found[DB_GYRO] -= T[DB_GYRO, axes] @ found[axes]
    return found


def bias_rates(model: FlightModel) -> tuple[FloatArray, FloatArray]:
    """(n,), (n,) walk^2 of each bias state [unit^2/s] and 1 / tau [1/s]; zero of the other states."""
    walk2, rate = np.zeros(model.layout.n), np.zeros(model.layout.n)
    for process in model.processes:
        block = model.layout.slice(process.block)
        walk2[block], rate[block] = process.walk**2, process.rate
    return walk2, rate


def decay_over(h: float, walk2: FloatArray, rate: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n,), (n,) factor phi = exp(-h rate) of each bias over h; variance added, walk^2 (1 - phi^2) / (2 rate)."""
    phi = np.exp(-h * rate)
    moving = np.where(rate > 0.0, rate, 1.0)
    return phi, np.where(rate > 0.0, 0.5 * walk2 / moving * (1.0 - phi**2), walk2 * h)


def process_noise(h: float, q_accel: float, q_gyro: float, q_bias: FloatArray, translation: bool = True) -> FloatArray:
    """(n, n) Q of one step; two half steps, the first carried through Phi, add up to the whole.

    Parameters
    ----------
    q_accel, q_gyro : variance rates of the interval, `estimator.filter.imu`
    q_bias : (n,) from `decay_over`
    """
    Q = np.diag(q_bias)
    Q[DTHETA, DTHETA] += q_gyro * h * np.eye(3)
    if translation:
        Q[DV, DV] += q_accel * h * np.eye(3)
        Q[DP, DP] += q_accel * h * h * h / 3.0 * np.eye(3)
        Q[DP, DV] += 0.5 * q_accel * h * h * np.eye(3)
        Q[DV, DP] += 0.5 * q_accel * h * h * np.eye(3)
    return Q
