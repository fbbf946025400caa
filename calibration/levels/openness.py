"""How far the sizes that a log gave are open: its flight with sizes one sigma off along each axis of their scatter."""

from __future__ import annotations

import numpy as np

from sinan.calibration.levels.levels import Levels
from sinan.calibration.levels.problem import Problem
from sinan.estimator.evidence.flights.open_levels import OpenLevels
from sinan.estimator.filter.flight import Flight
from sinan.sensors.arrays import FloatArray

#: Axes along which one sigma changes no size by more, in the logarithm, are taken for closed: lambda goes with a size
#: as its square at most, so that 1/2 15 (2 * 0.05)^2 = 8 % of what is detectable are neglected for each.
_CLOSED = 0.05


def open_levels(levels: Levels, flight: Flight) -> OpenLevels | None:
    """Of a flight with the model of some levels; None where none of its sizes is open.

    One sigma is where the log-posterior is lower by a half, on the mean of both sides, or what the covariance has where
    that is less: its scatter is that of the gradients of few parts. Times stay as they are: what is late has a name.
    """
    free = [k for k, size in enumerate(levels.found) if not size.linear]
    if not free or levels.covariance is None:
        return None
    sizes = [levels.found[k] for k in free]
    problem = Problem(flight.recording, sizes, levels)
    theta = problem.theta(levels)
    values, vectors = np.linalg.eigh(levels.covariance[np.ix_(free, free)])
    axes = vectors.T * np.sqrt(np.maximum(values, 0.0))[:, None]
    axes = axes[np.max(np.abs(axes * [size.spread for size in sizes]), axis=1) > _CLOSED]
    if not len(axes):
        return None
    top = problem.value(theta)
    wide = np.ones(len(axes), dtype=bool)
    for _ in range(2):  # what is far too wide is no parabola as far as that
        lower = np.full(len(axes), 0.5)
        lower[wide] = [top - 0.5 * (problem.value(theta + axis) + problem.value(theta - axis)) for axis in axes[wide]]
        axes /= np.sqrt(2.0 * np.maximum(lower, 0.5))[:, None]
        wide = lower > 1.0
    least, most = np.array([size.bounds for size in sizes]).T

    def there(moved: FloatArray) -> Flight:
        return problem.levels(np.clip(moved, least, most)).flight(flight.recording)

    sides = [(there(theta - axis), there(theta + axis)) for axis in axes]
    return OpenLevels(sides, axes, np.array([theta - least, most - theta]))
