"""How much of gravity lasts as the rates turn the specific force: what wrong rates lose, wherever the body is.

Over ten seconds what a vehicle's velocity changes by is small beside what gravity would change it by (98 m/s). So the
specific force, turned by the rates, has gravity as its mean. Neglects the centre of long circles.
"""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import STANDARD_GRAVITY
from sinan.sensors.formats.signed_axes import SIGNED
from sinan.sensors.recording import ACCEL, GYRO, Stream
from sinan.sensors.rotation import quaternion_exp, quaternion_multiply, rotate

#: Time over which the mean is taken [s]; of so many such times the middle one counts.
_LASTING, _TIMES = 10.0, 24
#: Part of gravity below which the rates are others, and how near to all of it the right ones are: 0.974 to 1.033 in 33
#: measured logs, by hand and in flight.
LOST, _NEAR = 0.85, 0.05


def lasting_gravity(imu: Stream, axes: FloatArray) -> float:
    """Norm of the mean over `_LASTING` of the force, turned by `axes` times the rates, in parts of standard gravity;
    NaN: the log is too short.

    Halves of a time are joined, from single steps on: the sum of two is v_1 + C_1 v_2, their turn C_1 C_2. The rates
    are taken as they are, and less their median, their bias where the body rests in between; the better counts.

    Parameters
    ----------
    imu : with accelerometer and gyroscope
    axes : (3, 3) of the body's rates from those that are read; a unit may be in it
    """
    span = float(imu.t[-1] - imu.t[0]) if len(imu) > 1 else 0.0
    if span < _LASTING:
        return float("nan")
    count = min(_TIMES, int(span / _LASTING))
    grid = np.linspace(imu.t[0], imu.t[-1] - _LASTING, count)[:, None] + np.linspace(0.0, _LASTING, 2**9 + 1)
    rate = imu.array(GYRO) @ axes.T
    force = _integrated(imu.t, imu.array(ACCEL), grid)
    means = []
    for bias in (np.zeros(3), np.median(rate, axis=0)):
        v, q = force, quaternion_exp(_integrated(imu.t, rate - bias, grid))
        while v.shape[1] > 1:
            v = v[:, 0::2] + rotate(q[:, 0::2], v[:, 1::2])
            q = quaternion_multiply(q[:, 0::2], q[:, 1::2])
        means.append(float(np.median(np.linalg.norm(v[:, 0], axis=-1))) / _LASTING)
    return max(means) / STANDARD_GRAVITY


def axes_that_last(imu: Stream) -> tuple[FloatArray, float, int] | None:
    """Other axes of the rates with which gravity lasts, where it does not as read.

    Returns
    -------
    (3, 3) the best of `SIGNED`, the part of gravity that lasts, and how many others do as well; None: there are none
    """
    if not lasting_gravity(imu, np.eye(3)) < LOST:
        return None
    lasting = np.array([lasting_gravity(imu, S) for S in SIGNED])
    off = np.abs(lasting - 1.0)
    best = int(np.argmin(off))
    return (SIGNED[best], float(lasting[best]), int(np.sum(off < _NEAR)) - 1) if off[best] < _NEAR else None


def _integrated(t: FloatArray, values: FloatArray, grid: FloatArray) -> FloatArray:
    """(times, steps, 3) integrals of (n, 3) readings over the steps of a grid, by the trapezoidal rule."""
    areas = 0.5 * np.diff(t)[:, None] * (values[1:] + values[:-1])
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(areas, axis=0)])
    return np.diff(np.stack([np.interp(grid, t, column) for column in total.T], axis=-1), axis=1)
