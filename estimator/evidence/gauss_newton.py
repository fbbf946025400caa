"""Gauss-Newton with halved steps: the search over beta, whatever a point of it costs."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError

Point = TypeVar("Point")
#: Share of the cost by which rounding may raise it where it is least: of ten thousand squares n eps = 2e-12.
_ROUNDING = 1e-12


def least(
    best: Point,
    cost: Callable[[Point], float],
    step: Callable[[Point], tuple[FloatArray, int] | None],
    tried: Callable[[Point, FloatArray], Point],
    most: int,
    settled: float = 0.0,
) -> Point:
    """The point that steps downhill reach, each halved where it leads up or to no model at all.

    Parameters
    ----------
    best : the start
    step : the whole step from a point, and how often it is worth halving; None: the search has settled there
    tried : the point after a step from another; raises InputError or LinAlgError where no model follows
    most : points at most, the start among them
    settled : share of the cost that a step has to gain, or else the search has settled
    """
    ahead = step(best)
    for _ in range(most - 1):
        if ahead is None or ahead[1] < 0:
            break
        before = cost(best)
        try:
            new = tried(best, ahead[0])
            is_down = cost(new) <= before + _ROUNDING * abs(before)
        except (InputError, np.linalg.LinAlgError):
            is_down = False
        if is_down:
            best, gain = new, before - cost(new)
            ahead = None if gain <= settled * abs(cost(new)) else step(new)
        else:
            ahead = 0.5 * ahead[0], ahead[1] - 1
    return best
