"""The liveliest parts of a recording."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import GYRO, Recording


def lively_starts(recording: Recording, length: float, every: float) -> FloatArray:
    """(k,) starts, `every` so many seconds, of the parts of some length that turn most: the upper half by RMS rate [s].

    A recording that is shorter has one, its own.
    """
    imu = recording.streams["imu"]
    starts = np.arange(imu.t[0], max(imu.t[-1] - length, imu.t[0]) + 1e-9, every)
    squares = np.sum(imu.array(GYRO) ** 2, axis=1)
    total = np.concatenate([[0.0], np.cumsum(squares)])
    first, last = np.searchsorted(imu.t, starts), np.searchsorted(imu.t, starts + length)
    turning = (total[last] - total[first]) / np.maximum(last - first, 1)
    return np.sort(starts[np.argsort(turning, kind="stable")[len(starts) // 2 :]])
