"""Parts of a recording: between two instants, and the liveliest of some length."""

from __future__ import annotations

import numpy as np

from sensors.arrays import FloatArray
from sensors.recording import GYRO, Initial, Recording

#: A stream with fewer rows in a part is not in it.
LEAST_ROWS = 2


def between(recording: Recording, begin: float, end: float) -> Recording:
    """The rows with begin <= t < end [s]; a first state that is declared is that of the whole."""
    parts = {name: stream.rows((stream.t >= begin) & (stream.t < end)) for name, stream in recording.streams.items()}
    streams = {name: part for name, part in parts.items() if len(part) >= LEAST_ROWS}
    first = recording.streams["imu"].t[0]
    return recording.replace(streams=streams, initial=recording.initial if begin <= first else Initial())


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
