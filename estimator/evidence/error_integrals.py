"""How the error state moves between any two instants of a known motion, in closed form: no step by step product.

With psi = C_nb dtheta_b, the attitude error seen from NED, and a = C_nb f_b the specific force there,

    dpsi/dt = -C b_gyro
    dv/dt   = -[a]x psi - C b_accel
    dp/dt   = v

and therefore, with the integrals taken from t_0 to t,

    psi = psi_0 - D_C b_gyro                                            D_C = int C
    v   = v_0 - [D_a]x psi_0 - D_C b_accel + D_M b_gyro                 D_a = int a,  D_M = int [a]x D_C
    p   = p_0 + (t - t_0) v_0 - [DD_a]x psi_0 - DD_C b_accel + DD_M b_gyro,   DD = int D.

The integrals are kept from the beginning of the motion; those between two instants follow by differences:
D_M(t_0, t) = M(t) - M(t_0) - [a_int(t) - a_int(t_0)]x C_int(t_0), and the like once more for DD. So
Phi(t_2, t_0) = Phi(t_2, t_1) Phi(t_1, t_0) to rounding, and t may lie before t_0.

Neglects the turn of the Earth (7e-5 of psi a second) and its Coriolis acceleration.

Source: P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed., 2013,
section 14.2.4 (the differential equations, in a local navigation frame).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray, IntArray, integral
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import matrix_from_quaternion, quaternion_interpolate, skew

#: Error states that move by themselves: position, velocity, attitude, accelerometer and gyroscope bias, 5 * 3 = 15.
MOVING = 15


@dataclass(frozen=True)
class ErrorIntegrals:
    """Integrals along a motion, from its first instant.

    Attributes
    ----------
    t, q_nb : (N,), (N, 4) instants [s] and attitude
    C, a, M : (N, 3, 3), (N, 3), (N, 3, 3) integrals of C_nb, of C_nb f_b, of [C_nb f_b]x C
    CC, aa, MM : the integrals of those
    """

    t: FloatArray
    q_nb: FloatArray
    C: FloatArray
    a: FloatArray
    M: FloatArray
    CC: FloatArray
    aa: FloatArray
    MM: FloatArray

    @classmethod
    def along(cls, motion: Motion) -> ErrorIntegrals:
        """The integrals along a motion with attitude and specific force at instants as close as the IMU's."""
        t, C_nb = motion.t, matrix_from_quaternion(motion.q_nb)
        a_n = np.einsum("nij,nj->ni", C_nb, motion.f_b)
        C, a = integral(t, C_nb), integral(t, a_n)
        M = integral(t, skew(a_n) @ C)
        return cls(t, motion.q_nb, C, a, M, integral(t, C), integral(t, a), integral(t, M))

    def at(self, t: FloatArray) -> ErrorIntegrals:
        """The same integrals at other instants (m,)."""
        q_nb = quaternion_interpolate(t, self.t, self.q_nb)
        parts = (self.C, self.a, self.M, self.CC, self.aa, self.MM)
        return ErrorIntegrals(t, q_nb, *(_interpolate(t, self.t, part) for part in parts))

    def rows(self, keep: IntArray | slice) -> ErrorIntegrals:
        """Some of the instants."""
        parts = (self.t, self.q_nb, self.C, self.a, self.M, self.CC, self.aa, self.MM)
        return ErrorIntegrals(*(part[keep] for part in parts))


def transitions(start: ErrorIntegrals, stop: ErrorIntegrals) -> FloatArray:
    """(m, 15, 15) Phi from each instant of `start` to the same row of `stop`; the attitude error is dtheta_b."""
    t = (stop.t - start.t)[:, None, None]
    D_C, D_a = stop.C - start.C, skew(stop.a - start.a)
    D_M = stop.M - start.M - D_a @ start.C
    DD_C = stop.CC - start.CC - t * start.C
    DD_a = skew(stop.aa - start.aa - t[:, :, 0] * start.a)
    DD_M = stop.MM - start.MM - t * start.M - DD_a @ start.C
    C_0, C_1 = matrix_from_quaternion(start.q_nb), matrix_from_quaternion(stop.q_nb)
    Phi = np.tile(np.eye(MOVING), (len(t), 1, 1))
    p, v, th, a, g = (slice(3 * k, 3 * k + 3) for k in range(5))
    Phi[:, p, v] = t * np.eye(3)
    Phi[:, p, th], Phi[:, p, a], Phi[:, p, g] = -DD_a @ C_0, -DD_C, DD_M
    Phi[:, v, th], Phi[:, v, a], Phi[:, v, g] = -D_a @ C_0, -D_C, D_M
    C_1_back = np.swapaxes(C_1, 1, 2)
    Phi[:, th, th], Phi[:, th, g] = C_1_back @ C_0, -C_1_back @ D_C
    return Phi


def _interpolate(t: FloatArray, t_known: FloatArray, value: FloatArray) -> FloatArray:
    """Linear between the known instants, and beyond them with the slope at the end."""
    i = np.clip(np.searchsorted(t_known, t, side="right") - 1, 0, len(t_known) - 2)
    share = ((t - t_known[i]) / (t_known[i + 1] - t_known[i])).reshape(-1, *([1] * (value.ndim - 1)))
    return np.asarray((1.0 - share) * value[i] + share * value[i + 1])
