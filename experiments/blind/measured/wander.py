"""How far a stream's own error wanders while an offset lasts: the unit in which steps and transients are put in."""

from __future__ import annotations

import numpy as np

from sinan.estimator.filter.flight_model import FlightModel
from sinan.sensors.arrays import FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.recording import SensorSpec

#: Median absolute deviation of a normal number of variance one.
MAD = 0.6745
#: Windows over which errors are compared begin this often in their length.
OVERLAP = 4
#: Share of the usual number of readings that a window has at least; it is in a gap else.
FILLED = 0.5


def errors(model: FlightModel, motion: Motion, sensor: str, t: FloatArray, reading: FloatArray) -> FloatArray:
    """(n, k) readings of a sensor less what the perfect one reads along a motion: bias, colour, noise, what is not
    modelled. A motion that was estimated from the readings follows their slow errors in part.
    """
    return reading - model.sensors[sensor].predict(motion.at(t))


def scatter(error: FloatArray) -> FloatArray:
    """(k,) standard deviation of the white part of an error (n, k): of its steps, by their median."""
    return np.asarray(np.median(np.abs(np.diff(error, axis=0)), axis=0) / MAD / np.sqrt(2.0))


def wander(t: FloatArray, error: FloatArray, length: float) -> FloatArray:
    """(k,) RMS distance of an error's mean over `length` seconds from that over as long before and after.

    d = m_1 - (m_0 + m_2) / 2: what an offset of that length, known to its ends, would be estimated from. Of white noise
    with n readings in a window it has the variance 3/2 sigma^2 / n, of a random walk w^2 length / 4.
    """
    length = min(length, (t[-1] - t[0]) / 3.0)
    edges = np.arange(t[0], t[-1] - 3.0 * length + 1e-9, length / OVERLAP)
    total = np.vstack([np.zeros(error.shape[1]), np.cumsum(error, axis=0)])
    rows = np.searchsorted(t, edges[:, None] + length * np.arange(4), side="left")
    rows[:, 3] = np.searchsorted(t, edges + 3.0 * length, side="right")
    counts = np.diff(rows, axis=1)
    filled = np.all(counts > FILLED * np.median(counts), axis=1) if len(counts) else np.zeros(0, dtype=bool)
    rows, counts = rows[filled], counts[filled]
    if not len(rows):
        return np.zeros(error.shape[1])
    means = np.diff(total[rows], axis=1) / counts[:, :, None]
    apart = means[:, 1] - 0.5 * (means[:, 0] + means[:, 2])
    return np.asarray(np.sqrt(np.mean(apart**2, axis=0)))


def imu_wander(spec: SensorSpec, length: float) -> float:
    """The same of an accelerometer or gyroscope, of its levels: variance 3/2 N^2 / length + w^2 length / 4."""
    N, walk = spec.noise_density or 0.0, spec.bias_walk or 0.0
    return float(np.sqrt(1.5 * N**2 / length + 0.25 * walk**2 * length))
