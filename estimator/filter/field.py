"""The magnetic field as a log's own readings have it."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import ACCEL, MAG, Recording


def field_of_the_log(recording: Recording) -> FloatArray:
    """(3,) field of a log that declares none: norm and dip as its own readings have them, north is magnetic north.

    Median over the log of |m| and of the angle between field and specific force. Neglects the magnetometer's bias and
    scale, and accelerations longer than the log's median sees.
    """
    mag, imu = recording.streams["mag"], recording.streams["imu"]
    m = mag.array(MAG)
    f = np.stack([np.interp(mag.t, imu.t, imu[name]) for name in ACCEL], axis=-1)
    norm = np.linalg.norm(m, axis=1)
    down = -np.sum(m * f, axis=1) / np.maximum(norm * np.linalg.norm(f, axis=1), 1e-12)
    sine = float(np.median(down))
    return float(np.median(norm)) * np.array([np.sqrt(1.0 - sine**2), 0.0, sine])
