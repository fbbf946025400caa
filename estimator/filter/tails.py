"""The law of innovations whose tail is heavier than normal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sinan.estimator.filter.flight_model import FlightModel
from sinan.sensors.arrays import FloatArray, IntArray


def deviance_of(nis: FloatArray, m: FloatArray | IntArray | int, tail: FloatArray | float | None) -> FloatArray:
    """(K,) what of -2 log density goes with nu' S^-1 nu: that of the normal law up to m, of Student's beyond.

    rho(NIS) = m + (nu + m) log((nu + NIS) / (nu + m)) for NIS > m: its slope is the weight (nu + m) / (nu + NIS) that
    the filter gives such a reading. None or infinite: normal throughout.
    """
    if tail is None:
        return nis
    v = np.broadcast_to(np.asarray(tail, dtype=np.float64), nis.shape)
    heavy = np.isfinite(v) & (nis > m)
    found = np.array(nis, dtype=np.float64)
    v, k, far = v[heavy], np.broadcast_to(m, nis.shape)[heavy], nis[heavy]
    found[heavy] = k + (v + k) * np.log((v + far) / (v + k))
    return found


def log_density(
    model: FlightModel, names: Sequence[str], sensor: IntArray, m: IntArray, normal: FloatArray, nis: FloatArray
) -> FloatArray:
    """(K,) logarithm of the density of each innovation by the law of its sensor, up to a constant of the sensor.

    Parameters
    ----------
    names, sensor : of the sensors; (K,) index of each reading's
    m : (K,) components that tell something
    normal, nis : (K,) logarithm of the normal density; nu' S^-1 nu
    """
    tails = np.array([model.tail_of(name) or np.inf for name in names])[sensor]
    return np.asarray(normal + 0.5 * (nis - deviance_of(nis, m, tails)))
