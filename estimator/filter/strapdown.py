"""One step of the strapdown integration, readable; the compiled engine holds the same equations.

The samples at the two ends of the step are taken as joined by a straight line:

    phi = h (w_0 + w_1) / 2 + h^2 / 12  w_0 x w_1          rotation vector, with the coning of a linear rate
    q_1 = exp(-w_ie h) q_0 exp(phi)
    v_1 = v_0 + h / 2 (C_0 f_0 + C_1 f_1) + h (g - 2 w_ie x v_0)
    p_1 = p_0 + h / 2 (v_0 + v_1)

The trapezoid's own errors add up to differences between the ends of the flight, h^2 / 12 of the change in
acceleration, and do not grow. Neglects transport rate and the change of gravity with height: NED is flat.

Source: P. G. Savage, "Strapdown inertial navigation integration algorithm design", J. Guidance 21(1), 1998 (coning).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.estimator.filter.layout import B_ACCEL, B_GYRO, P_N, Q_NB, V_N
from sinan.sensors.arrays import FloatArray
from sinan.sensors.rotation import cross, matrix_from_quaternion, quaternion_exp, quaternion_multiply


@dataclass(frozen=True)
class Step:
    """What one step leaves for the error dynamics.

    Attributes
    ----------
    h : s
    C0, C1 : (3, 3) attitude at its ends
    phi : (3,) rotation vector [rad]
    a0, a1 : (3,) C f at its ends [m/s^2]
    """

    h: float
    C0: FloatArray
    C1: FloatArray
    phi: FloatArray
    a0: FloatArray
    a1: FloatArray


def strapdown_step(
    x: FloatArray,
    u0: FloatArray,
    u1: FloatArray,
    h: float,
    g_n: FloatArray,
    w_ie_n: FloatArray,
    translation: bool = True,
) -> tuple[FloatArray, Step]:
    """Nominal state after a step of h, and the step.

    Parameters
    ----------
    x : (n + 1,) nominal state: p_n, v_n, q_nb, b_accel, b_gyro, ...
    u0, u1 : (6,) specific force and rate as read at the two ends
    translation : False: position and velocity stay
    """
    f0, f1 = u0[:3] - x[B_ACCEL], u1[:3] - x[B_ACCEL]
    w0, w1 = u0[3:] - x[B_GYRO], u1[3:] - x[B_GYRO]
    phi = 0.5 * h * (w0 + w1) + h * h / 12.0 * cross(w0, w1)
    q1 = quaternion_multiply(x[Q_NB], quaternion_exp(phi))
    if np.any(w_ie_n):
        q1 = quaternion_multiply(quaternion_exp(-h * w_ie_n), q1)
    q1 = q1 / np.linalg.norm(q1)
    C0, C1 = matrix_from_quaternion(x[Q_NB]), matrix_from_quaternion(q1)
    a0, a1 = C0 @ f0, C1 @ f1
    moved = x.copy()
    moved[Q_NB] = q1
    if translation:
        moved[V_N] = x[V_N] + 0.5 * h * (a0 + a1) + h * (g_n - 2.0 * cross(w_ie_n, x[V_N]))
        moved[P_N] = x[P_N] + 0.5 * h * (x[V_N] + moved[V_N])
    return moved, Step(h, C0, C1, phi, a0, a1)
