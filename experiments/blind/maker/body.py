"""How a body moves: exact specific force and angular rate of a multirotor on a given path, and of a thing in the hand.

The multirotor's attitude is not chosen but follows. Its rotors push along -z_b, and its drag is linear and across z_b:

    f_n = a_n - g_n = -c z_b - k (u - z_b (z_b . u)),    u = v_n - wind_n,    g_n = (0, 0, g)

so that z_b = s / |s| with s = g_n - a_n - k u, which holds for every thrust c. The heading gives the rest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sinan.experiments.blind.maker.curves import Curve
from sinan.experiments.blind.maker.turning import cross_rows, exp_rotation, mat_vec, vee
from sinan.sensors.arrays import FloatArray


@dataclass(frozen=True)
class Body:
    """What there is to sense, at n instants.

    Attributes
    ----------
    t : (n,) s
    p, v, a : (n, 3) NED position, velocity, acceleration [m, m/s, m/s^2]
    C : (n, 3, 3) body to NED
    f, w, dw : (n, 3) specific force, angular rate and angular acceleration in the body [m/s^2, rad/s, rad/s^2]
    wind : (n, 3) NED [m/s]
    thrust : (n,) rotor thrust per mass [m/s^2]; zero in the hand
    """

    t: FloatArray
    p: FloatArray
    v: FloatArray
    a: FloatArray
    C: FloatArray
    f: FloatArray
    w: FloatArray
    dw: FloatArray
    wind: FloatArray
    thrust: FloatArray

    @property
    def airspeed(self) -> FloatArray:
        """(n,) |v - wind| [m/s]."""
        return np.asarray(np.linalg.norm(self.v - self.wind, axis=1))

    def to_body(self, vector_n: FloatArray) -> FloatArray:
        """(n, 3) NED vectors, or one (3,), seen in the body."""
        return np.einsum("nji,nj->ni", self.C, np.broadcast_to(vector_n, self.p.shape))

    def to_ned(self, vector_b: FloatArray) -> FloatArray:
        """(n, 3) body vectors, or one (3,), seen in NED."""
        return mat_vec(self.C, np.broadcast_to(vector_b, self.p.shape))


#: The motion of a recording: instants (n,) -> `Body`.
Motion = Callable[[FloatArray], Body]


@dataclass(frozen=True)
class Multirotor:
    """A path in the air; call it with instants.

    Attributes
    ----------
    path : north, east, down [m]
    heading : psi [rad]
    wind : north, east, down [m/s]
    drag : k [1/s]
    gravity : g [m/s^2]
    """

    path: tuple[Curve, Curve, Curve]
    heading: Curve
    wind: tuple[Curve, Curve, Curve]
    drag: float
    gravity: float

    def __call__(self, t: FloatArray) -> Body:
        p, v, a, jerk, snap = np.stack([curve.derivatives(t, 4) for curve in self.path], axis=-1)
        wind, wind_1, wind_2 = np.stack([curve.derivatives(t, 2) for curve in self.wind], axis=-1)
        g_n = np.array([0.0, 0.0, self.gravity])
        s = np.stack([
            g_n - a - self.drag * (v - wind),
            -jerk - self.drag * (a - wind_1),
            -snap - self.drag * (jerk - wind_2),
        ])  # fmt: skip
        z = unit(s)
        y = unit(cross(z, north_of(self.heading.derivatives(t, 2))))
        x = cross(y, z)
        C, C_1, C_2 = np.stack([x, y, z], axis=-1)
        w, dw = rates(C, C_1, C_2)
        f = np.einsum("nji,nj->ni", C, a - g_n)
        return Body(t, p, v, a, C, f, w, dw, wind, -f[:, 2])


@dataclass(frozen=True)
class Hand:
    """Turns about fixed axes with rests between, about a point at `arm` from the instrument; call it with instants.

    Turn k goes from attitude C_k to C_k Exp(phi_k), with the smooth step as its course, so that w = phi_k s'(t).

    Attributes
    ----------
    start : (3, 3) first attitude
    turns : (m, 3) phi_k [rad], in the body
    begin, duration : (m,) of each turn [s]
    arm : (3,) from the centre of turning to the instrument, in the body [m]
    gravity : g [m/s^2]
    """

    start: FloatArray
    turns: FloatArray
    begin: FloatArray
    duration: FloatArray
    arm: FloatArray
    gravity: float

    def __call__(self, t: FloatArray) -> Body:
        from sinan.experiments.blind.maker.curves import Rise, rise_derivatives

        C = np.repeat(self.start[None], len(t), axis=0)
        w, dw = np.zeros((len(t), 3)), np.zeros((len(t), 3))
        for phi, begin, duration in zip(self.turns, self.begin, self.duration, strict=True):
            begun = t > begin
            share, rate, acceleration = rise_derivatives(Rise(1.0, begin, duration), t[begun], 2)
            C[begun] = C[begun] @ exp_rotation(share[:, None] * phi)
            w[begun] += rate[:, None] * phi
            dw[begun] += acceleration[:, None] * phi
        r = np.broadcast_to(self.arm, w.shape)
        a_b = cross_rows(w, cross_rows(w, r)) + cross_rows(dw, r)
        g_n = np.array([0.0, 0.0, self.gravity])
        a = mat_vec(C, a_b)
        f = a_b - np.einsum("nji,j->ni", C, g_n)
        p, v = mat_vec(C, r), mat_vec(C, cross_rows(w, r))
        return Body(t, p, v, a, C, f, w, dw, np.zeros_like(p), np.zeros(len(t)))


def unit(s: FloatArray) -> FloatArray:
    """(3, n, 3) s/|s| with two derivatives, from s = n m: s' = n' m + n m', s'' = n'' m + 2 n' m' + n m''."""
    m = np.linalg.norm(s[0], axis=-1, keepdims=True)
    n = s[0] / m
    m_1 = np.sum(n * s[1], axis=-1, keepdims=True)
    n_1 = (s[1] - n * m_1) / m
    m_2 = np.sum(n_1 * s[1] + n * s[2], axis=-1, keepdims=True)
    n_2 = (s[2] - 2.0 * n_1 * m_1 - n * m_2) / m
    return np.stack([n, n_1, n_2])


def cross(left: FloatArray, right: FloatArray) -> FloatArray:
    """(3, n, 3) the cross product with two derivatives."""
    return np.stack([
        cross_rows(left[0], right[0]),
        cross_rows(left[1], right[0]) + cross_rows(left[0], right[1]),
        cross_rows(left[2], right[0]) + 2.0 * cross_rows(left[1], right[1]) + cross_rows(left[0], right[2]),
    ])  # fmt: skip


def north_of(psi: FloatArray) -> FloatArray:
    """(3, n, 3) the horizontal direction (cos psi, sin psi, 0) with two derivatives; psi (3, n)."""
    c, s, zero = np.cos(psi[0]), np.sin(psi[0]), np.zeros_like(psi[0])
    ahead, aside = np.stack([c, s, zero], axis=-1), np.stack([-s, c, zero], axis=-1)
    rate, acceleration = psi[1][:, None], psi[2][:, None]
    return np.stack([ahead, rate * aside, acceleration * aside - rate**2 * ahead])


def rates(C: FloatArray, C_1: FloatArray, C_2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n, 3) w and dw from C' = C [w]x and C'' = C ([w]x^2 + [dw]x); the square is symmetric and drops out."""
    return vee(np.einsum("nji,njk->nik", C, C_1)), vee(np.einsum("nji,njk->nik", C, C_2))
