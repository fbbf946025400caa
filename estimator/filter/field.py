"""The magnetic field as a log's own readings have it."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import ACCEL, GYRO, MAG, Recording
from sinan.sensors.rotation import quaternion_interpolate, rotate, turned_since_start

#: Over which force and field are averaged before they are compared [s]: the speed of a hand, 1 m/s at either end, then
#: tilts the mean force by as much as a rate that is off by 0.01 rad/s turns the axes,
#: sqrt(2) * 1 / (9.8 * 4) = 0.04 = 0.01 * 4.
WINDOW = 4.0


def field_of_the_log(recording: Recording, iron: FloatArray | None = None) -> FloatArray:
    """(3,) field of a log that declares none: norm and dip as its own readings have them, north is magnetic north.

    Median over the log of |m|, and over its stretches of about `WINDOW` of the angle between mean field and mean
    specific force, in axes that the gyroscope keeps from turning. An acceleration that comes and goes tilts the force
    of an instant by any angle, that of a stretch from t0 to t1 by the change of speed alone:

        mean f = -g + (v1 - v0) / (t1 - t0)

    Parameters
    ----------
    iron : (3,) hard iron that the readings have; default: none

    Neglects the magnetometer's scale, and a speed that grows for longer than the log's median sees.
    """
    mag, imu = recording.streams["mag"], recording.streams["imu"]
    m = mag.array(MAG) - (0.0 if iron is None else iron)
    start, lasts = imu.t[0], imu.t[-1] - imu.t[0]
    turn = turned_since_start(imu.t, imu.array(GYRO))
    count = max(1, round(lasts / WINDOW))
    rows = np.unique(np.searchsorted(imu.t, start + lasts * np.arange(count) / count))
    f_sum, m_sum = np.add.reduceat(rotate(turn, imu.array(ACCEL)), rows), np.zeros((len(rows), 3))
    stretch = np.maximum(np.searchsorted(imu.t[rows], mag.t, side="right") - 1, 0)
    np.add.at(m_sum, stretch, rotate(quaternion_interpolate(mag.t, imu.t, turn), m))
    f_sum, m_sum = f_sum[np.unique(stretch)], m_sum[np.unique(stretch)]
    both = np.linalg.norm(f_sum, axis=1) * np.linalg.norm(m_sum, axis=1)
    sine = float(np.median(-np.sum(f_sum * m_sum, axis=1) / np.maximum(both, 1e-12)))
    return float(np.median(np.linalg.norm(m, axis=1))) * np.array([np.sqrt(1.0 - sine**2), 0.0, sine])
