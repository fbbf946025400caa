"""The hard iron of a compass as the turns of its log show it, before any attitude is known.

The field that a body meets turns against it as the body turns, the iron that it carries does not. With R the turn from
one reading to a later one by the gyroscope,

    m_later - R m = (I - R) b - [m_later - b]x T db_gyro + noise,

linear in the iron b and in the bias of the gyroscope but for their product, which a few rounds settle; attitude,
heading and field are not in it.
"""

from __future__ import annotations

import numpy as np

from sinan.calibration.levels.levels import TAIL
from sinan.estimator.filter.alignment import WINDOW
from sinan.estimator.filter.imu import GAP
from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.recording import GYRO, MAG, Recording
from sinan.sensors.rotation import (
    quaternion_conjugate,
    quaternion_interpolate,
    quaternion_multiply,
    rotate,
    skew,
    turned_since_start,
)

#: Rounds of iron, bias and weights: bound of work. Half and twice move iron of 1.2 of the field by less than its sigma
#: (`test_fields`).
ROUNDS = 5


def iron_of_turns(recording: Recording, std: float, rate_std: float) -> tuple[FloatArray, float]:
    """The likeliest hard iron (3,) and 1-sigma of a component, in the unit of the readings; zero, `std` without turns.

    By least squares over readings `WINDOW` apart, of which those within one such time count as one; their noise is as
    large as they have it, and has the tail of Student's law.

    Parameters
    ----------
    std : of a component before the log is seen
    rate_std : of the gyroscope's bias [rad/s]

    Neglects mag.scale and mag.misalignment, a field that depends on the place, and the lateness of stamps.
    """
    mag, imu = recording.streams["mag"], recording.streams["imu"]
    later = np.searchsorted(mag.t, mag.t + WINDOW)
    first = np.flatnonzero(later < len(mag))
    later = later[first]
    lasts = mag.t[later] - mag.t[first]
    near = (lasts < 2.0 * WINDOW) & ~_over_a_gap(recording, mag.t[first], mag.t[later])
    first, later, lasts = first[near], later[near], lasts[near]
    if not len(first):
        return np.zeros(3), std
    q, m = quaternion_interpolate(mag.t, imu.t, turned_since_start(imu.t, imu.array(GYRO))), mag.array(MAG)
    turn = quaternion_multiply(quaternion_conjugate(q[later]), q[first])
    R = np.stack([rotate(turn, np.broadcast_to(e, (len(turn), 3))) for e in np.eye(3)], axis=-1)
    e = (m[later] - rotate(turn, m[first])).ravel()
    alone = max(1.0, WINDOW / float(np.median(np.diff(mag.t))))
    least = max(float(np.finfo(float).eps * np.max(np.abs(m))), float(np.finfo(float).tiny))
    prior = np.diag([1.0 / std] * 3 + [1.0 / rate_std] * 3)
    found, weight = np.zeros(6), np.ones(len(e))
    for _ in range(ROUNDS):
        A = np.concatenate([np.eye(3) - R, -skew(m[later] - found[:3]) * lasts[:, None, None]], axis=2).reshape(-1, 6)
        plain = np.linalg.lstsq(A * np.sqrt(weight)[:, None], e * np.sqrt(weight), rcond=None)[0]
        left = e - A @ plain
        noise = max(float(np.sqrt(np.mean(weight * left**2))), least)
        weight = (TAIL + 1.0) / (TAIL + (left / noise) ** 2)
        unit = np.sqrt(weight / alone) / noise
        q_part, r_part = np.linalg.qr(np.vstack([A * unit[:, None], prior]))
        found = np.linalg.solve(r_part, q_part[: len(e)].T @ (e * unit))
    root = np.linalg.inv(r_part)[:3]
    return found[:3], float(np.sqrt(np.sum(root**2) / 3.0))


def _over_a_gap(recording: Recording, begin: FloatArray, end: FloatArray) -> BoolArray:
    """(k,) whether the gyroscope misses something between two instants."""
    t = recording.streams["imu"].t
    step = np.diff(t)
    gaps = np.concatenate([[0.0], np.cumsum(step > GAP * np.median(step))])
    return np.asarray(np.interp(end, t, gaps) != np.interp(begin, t, gaps))
