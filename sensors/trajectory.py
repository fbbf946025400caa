"""Smooth motion whose position, velocity, attitude, rates and specific force belong together to rounding.

A command is rounded off by a B-spline of degree 7: its control points are the command at evenly spaced knots, so the
path is six times continuously differentiable, never overshoots, and has exact derivatives of every order.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import quaternion_from_rpy, rotate_back

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

DEGREE = 7
MARGIN = 10.0  # s before the first and after the last instant in which the body is at rest


def rounded(knots: FloatArray, command: FloatArray) -> BSpline:
    """The B-spline of degree 7 whose control points are the command (n, k) at evenly spaced knots (n,)."""
    from scipy.interpolate import BSpline

    h = float(knots[1] - knots[0])
    half = (DEGREE + 1) / 2.0
    # Control point i belongs to the middle of its basis function: knot vector i ... i + 8 around knots[i].
    vector = knots[0] + h * (np.arange(len(knots) + DEGREE + 1) - half)
    return BSpline(vector, command, DEGREE)


def even_knots(duration: float, spacing: float) -> FloatArray:
    """Knots that reach beyond 0 and `duration` by the margin."""
    before = int(np.ceil(MARGIN / spacing)) + DEGREE
    n = int(np.ceil(duration / spacing)) + 2 * before
    return np.asarray(spacing * (np.arange(n + 1) - before), dtype=np.float64)


@dataclass(frozen=True)
class Multicopter:
    """A multicopter that tilts its thrust to accelerate and to lean on the air.

    The rotors push along body up, drag holds back in the plane of the rotors, so that with the specific force
    f_n = a_n - g_n and the velocity v_n - wind against the air

        f_n = -T e_z - drag (I - e_z e_z') (v_n - wind)   =>   e_z = -unit(f_n + drag (v_n - wind)),

    e_z the body's down axis in NED. On the ground, where the rotors carry a share `lift` of the weight, drag has that
    share too.
    Yaw is free; roll and pitch follow. Rates and their derivatives are analytic.

    Attributes
    ----------
    knots : (n,) evenly spaced instants [s]
    command : (n, 5) north, east, down [m], yaw [rad], lift
    g_n, m_n : (3,) gravity and magnetic field, NED
    ground_down : down coordinate of the ground [m]
    drag : rotor drag per mass [1/s]
    wind : (2,) north, east [m/s]
    """

    knots: FloatArray
    command: FloatArray
    g_n: FloatArray
    m_n: FloatArray
    ground_down: float = 0.0
    drag: float = 0.0
    wind: tuple[float, float] = (0.0, 0.0)

    @cached_property
    def _path(self) -> list[BSpline]:
        path = rounded(self.knots, self.command)
        return [path, *(path.derivative(k) for k in range(1, 5))]

    def motion(self, t: FloatArray) -> Motion:
        """The motion at the instants t, without covariates."""
        p, v, a, jerk, snap = (spline(t) for spline in self._path)
        air = v[:, :3] - np.array([*self.wind, 0.0])
        c, dc, ddc = (self.drag * part[:, 4:5] for part in (p, v, a))
        s = a[:, :3] - self.g_n + c * air
        ds = jerk[:, :3] + c * a[:, :3] + dc * air
        dds = snap[:, :3] + c * jerk[:, :3] + 2.0 * dc * a[:, :3] + ddc * air
        angles = tilt_angles((-s, -ds, -dds), (p[:, 3], v[:, 3], a[:, 3]))
        q_nb = quaternion_from_rpy(angles[0])
        w_ib_b, dw_b = body_rates(*angles)
        return Motion(
            t=t,
            p_n=p[:, :3],
            v_n=v[:, :3],
            a_n=a[:, :3],
            q_nb=q_nb,
            f_b=rotate_back(q_nb, a[:, :3] - self.g_n),
            w_ib_b=w_ib_b,
            dw_b=dw_b,
            m_b=rotate_back(q_nb, self.m_n[None]),
            m_n=self.m_n[None],
            g_n=self.g_n,
            ground_down=self.ground_down,
        )

    def lift(self, t: FloatArray) -> FloatArray:
        """(n,) share of the weight that the rotors carry: 0 on the ground, 1 in the air."""
        return np.asarray(self._path[0](t)[:, 4])


@dataclass(frozen=True)
class Turntable:
    """A body turned by hand or by a table about its reference point, which may sway a little.

    Attributes
    ----------
    knots : (n,) evenly spaced instants [s]
    command : (n, 6) roll, pitch, yaw [rad], north, east, down [m]
    g_n, m_n, ground_down : as of `Multicopter`
    """

    knots: FloatArray
    command: FloatArray
    g_n: FloatArray
    m_n: FloatArray
    ground_down: float = 0.0

    @cached_property
    def _path(self) -> list[BSpline]:
        path = rounded(self.knots, self.command)
        return [path, path.derivative(1), path.derivative(2)]

    def motion(self, t: FloatArray) -> Motion:
        """The motion at the instants t, without covariates."""
        value, first, second = (spline(t) for spline in self._path)
        q_nb = quaternion_from_rpy(value[:, :3])
        w_ib_b, dw_b = body_rates(value[:, :3], first[:, :3], second[:, :3])
        return Motion(
            t=t,
            p_n=value[:, 3:],
            v_n=first[:, 3:],
            a_n=second[:, 3:],
            q_nb=q_nb,
            f_b=rotate_back(q_nb, second[:, 3:] - self.g_n),
            w_ib_b=w_ib_b,
            dw_b=dw_b,
            m_b=rotate_back(q_nb, self.m_n[None]),
            m_n=self.m_n[None],
            g_n=self.g_n,
            ground_down=self.ground_down,
        )


Derivatives = tuple[FloatArray, FloatArray, FloatArray]  # value, first, second derivative over time


def tilt_angles(down: Derivatives, yaw: Derivatives) -> Derivatives:
    """Roll, pitch, yaw (n, 3) and their two derivatives, of a body whose down axis points along `down` (n, 3) in NED.

    Turned back by yaw the axis is u = (sin(pitch) cos(roll), -sin(roll), cos(pitch) cos(roll)) |u|, so
    pitch = atan2(u_x, u_z), roll = atan2(-u_y, hypot(u_x, u_z)).
    """
    u, du, ddu = _turned_back(down, yaw)
    x, y, z = ((u[:, i], du[:, i], ddu[:, i]) for i in range(3))
    pitch = arctangent(x, z)
    level = _hypotenuse(x, z)
    roll = arctangent((-y[0], -y[1], -y[2]), level)
    stacked = [np.stack([roll[k], pitch[k], yaw[k]], axis=1) for k in range(3)]
    return stacked[0], stacked[1], stacked[2]


def _turned_back(v: Derivatives, yaw: Derivatives) -> Derivatives:
    """Rz(-yaw) v and its two derivatives, by the product rule."""
    c, s = np.cos(yaw[0]), np.sin(yaw[0])
    dc, ds = -s * yaw[1], c * yaw[1]
    ddc, dds = -c * yaw[1] ** 2 - s * yaw[2], -s * yaw[1] ** 2 + c * yaw[2]
    x, y = [part[:, 0] for part in v], [part[:, 1] for part in v]
    along = [
        c * x[0] + s * y[0],
        dc * x[0] + c * x[1] + ds * y[0] + s * y[1],
        ddc * x[0] + 2 * dc * x[1] + c * x[2] + dds * y[0] + 2 * ds * y[1] + s * y[2],
    ]
    across = [
        c * y[0] - s * x[0],
        dc * y[0] + c * y[1] - ds * x[0] - s * x[1],
        ddc * y[0] + 2 * dc * y[1] + c * y[2] - dds * x[0] - 2 * ds * x[1] - s * x[2],
    ]
    turned = [np.stack([along[k], across[k], v[k][:, 2]], axis=1) for k in range(3)]
    return turned[0], turned[1], turned[2]


def arctangent(y: Derivatives, x: Derivatives) -> Derivatives:
    """atan2(y, x) and its two derivatives: d = (x dy - y dx) / r^2, r^2 = x^2 + y^2."""
    r2 = x[0] ** 2 + y[0] ** 2
    dr2 = 2.0 * (x[0] * x[1] + y[0] * y[1])
    cross = x[0] * y[1] - y[0] * x[1]
    dcross = x[0] * y[2] - y[0] * x[2]
    return np.arctan2(y[0], x[0]), cross / r2, dcross / r2 - cross * dr2 / r2**2


def _hypotenuse(x: Derivatives, z: Derivatives) -> Derivatives:
    """sqrt(x^2 + z^2) and its two derivatives."""
    r = np.hypot(x[0], z[0])
    dr = (x[0] * x[1] + z[0] * z[1]) / r
    ddr = (x[1] ** 2 + x[0] * x[2] + z[1] ** 2 + z[0] * z[2] - dr**2) / r
    return r, dr, ddr


def body_rates(rpy: FloatArray, d: FloatArray, dd: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Angular rate and its derivative in the body, (n, 3) each, of ZYX angles and their two derivatives.

    w = (roll' - yaw' sin(pitch),
         pitch' cos(roll) + yaw' sin(roll) cos(pitch),
        -pitch' sin(roll) + yaw' cos(roll) cos(pitch))
    """
    sr, cr = np.sin(rpy[:, 0]), np.cos(rpy[:, 0])
    sp, cp = np.sin(rpy[:, 1]), np.cos(rpy[:, 1])
    dr, dp, dy = d.T
    ddr, ddp, ddy = dd.T
    w = np.stack([dr - dy * sp, dp * cr + dy * sr * cp, -dp * sr + dy * cr * cp], axis=1)
    dw = np.stack(
        [
            ddr - ddy * sp - dy * dp * cp,
            ddp * cr - dp * dr * sr + ddy * sr * cp + dy * dr * cr * cp - dy * dp * sr * sp,
            -ddp * sr - dp * dr * cr + ddy * cr * cp - dy * dr * sr * cp - dy * dp * cr * sp,
        ],
        axis=1,
    )
    return w, dw
