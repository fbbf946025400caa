"""The likeliest lateness.

Where readings lie between two samples of the IMU makes log L go up and down by tens, with the IMU's step for a period:
a comb, in which a slope leads to the next tooth; and readings that are doubted lose weight, of which a slope knows
nothing. So steps are compared.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

#: First step of the search, in the spread of what is sought: bound of work (`bounds_of_work sizes`).
FIRST_MOVE = 0.5


def whole_moves(spread: float, step: float) -> list[float]:
    """Steps that are multiples of the IMU's, from long to short, where a lateness may be far off.

    Parameters
    ----------
    spread, step : of what is sought, and of the IMU, in one unit
    """
    whole = max(1, round(FIRST_MOVE * spread / step))
    return [(whole >> k) * step for k in range(whole.bit_length())]


def best_tooth(value: Callable[[float], float], best: float, moves: Sequence[float], narrowing: bool = False) -> float:
    """Where steps to either side, each as long as it leads up, end.

    Parameters
    ----------
    value : log L, and priors
    best : where to begin
    moves : the steps, from long to short
    narrowing : end as soon as a step is no longer than a sigma
    """
    at = cache(value)
    for step in moves:
        while (near := max(best + step, best - step, key=at)) != best and at(near) > at(best):
            best = near
        if narrowing and 2.0 * at(best) - at(best + step) - at(best - step) <= 1.0:
            break  # minus the second difference is (step / sigma)^2
    return best
