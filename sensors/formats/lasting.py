"""How much of gravity lasts as the rates turn the specific force: what wrong rates lose, wherever the body is.

Over ten seconds what a vehicle's velocity changes by is small beside what gravity would change it by (98 m/s). So the
specific force, turned by the rates, has gravity as its mean. Neglects the centre of long circles.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sinan.sensors.arrays import FloatArray, integral
from sinan.sensors.constants import STANDARD_GRAVITY
from sinan.sensors.formats.signed_axes import SIGNED, words_of
from sinan.sensors.recording import ACCEL, GYRO, Stream
from sinan.sensors.rotation import quaternion_exp, quaternion_multiply, rotate

#: Time over which the mean is taken [s]; of so many such times the middle one counts.
_LASTING, _TIMES = 10.0, 24
#: Part of gravity below which the rates are others, and how near to all of it the right ones are: 0.974 to 1.033 in 33
#: measured logs, by hand and in flight.
LOST, _NEAR = 0.85, 0.05


def lasting_gravity(imu: Stream) -> Callable[[FloatArray], float]:
    """Of (3, 3) `axes` the part of standard gravity that lasts as `axes` times the rates turn the force: the norm of
    the mean over `_LASTING`; NaN: the log is too short. A unit may be in the axes.

    Halves of a time are joined, from single steps on: the sum of two is v_1 + C_1 v_2, their turn C_1 C_2. The rates
    are taken as they are, and less their median, their bias where the body rests in between; the better counts.

    Parameters
    ----------
    imu : with accelerometer and gyroscope
    """
    span = float(imu.t[-1] - imu.t[0]) if len(imu) > 1 else 0.0
    if span < _LASTING:
        return lambda axes: float("nan")
    count = min(_TIMES, int(span / _LASTING))
    grid = np.linspace(imu.t[0], imu.t[-1] - _LASTING, count)[:, None] + np.linspace(0.0, _LASTING, 2**9 + 1)
    rate = imu.array(GYRO)
    force, turn = _integrated(imu.t, imu.array(ACCEL), grid), _integrated(imu.t, rate, grid)
    of_bias = np.median(rate, axis=0) * np.diff(grid, axis=1)[..., None]

    def lasting(axes: FloatArray) -> float:
        means = []
        for angle in (turn, turn - of_bias):
            v, q = force, quaternion_exp(angle @ axes.T)
            while v.shape[1] > 1:
                v = v[:, 0::2] + rotate(q[:, 0::2], v[:, 1::2])
                q = quaternion_multiply(q[:, 0::2], q[:, 1::2])
            means.append(float(np.median(np.linalg.norm(v[:, 0], axis=-1))) / _LASTING)
        return max(means) / STANDARD_GRAVITY

    return lasting


class OtherAxes(NamedTuple):
    """Axes with which gravity lasts, (3, 3); the part of it that does, and as read; how many others do as well."""

    axes: FloatArray
    lasting: float
    as_read: float
    others: int

    def words(self, now: FloatArray | None = None) -> str:
        """As a map would have them that has (3, 3) `now`, or says nothing of axes."""
        said = words_of(self.axes @ (np.eye(3) if now is None else now))
        more = f", or {self.others} others that such turns do not tell from it," if self.others else ""
        return f"axes = {said}{more} in a map would do"


def other_axes(imu: Stream) -> OtherAxes | None:
    """Other axes of the rates with which gravity lasts, where it does not as read; None: it does, or with none."""
    lasting = lasting_gravity(imu)
    if not (as_read := lasting(np.eye(3))) < LOST:
        return None
    parts = np.array([lasting(S) for S in SIGNED])
    off = np.abs(parts - 1.0)
    best = int(np.argmin(off))
    if not off[best] < _NEAR:
        return None
    return OtherAxes(SIGNED[best], float(parts[best]), as_read, int(np.sum(off < _NEAR)) - 1)


def _integrated(t: FloatArray, values: FloatArray, grid: FloatArray) -> FloatArray:
    """(times, steps, 3) integrals of (n, 3) readings over the steps of a grid, by the trapezoidal rule."""
    return np.diff(np.stack([np.interp(grid, t, column) for column in integral(t, values).T], axis=-1), axis=1)
