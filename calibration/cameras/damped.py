"""Levenberg's and Marquardt's method over parameters that all observations share, those of each eliminated.

Source: R. Hartley, A. Zisserman, Multiple View Geometry, 2nd edition, appendix 6 (sparse Levenberg-Marquardt).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from sinan.sensors.arrays import FloatArray

#: Of each observation: residual r, and its Jacobians A by what is shared and B by what is the observation's own.
Blocks = Sequence[tuple[FloatArray, FloatArray, FloatArray]]
State = TypeVar("State")

#: From a closed start five to fifteen rounds do; a fit that takes so many never settles: bound of work (`bounds_of_work
#: camera`).
_ROUNDS = 100
#: Relative gain of a round at which the sum of squares is at its minimum to rounding: bound of work (`bounds_of_work
#: camera`).
_SETTLED = 1e-9
#: Damping at the start, at least and at most, over the diagonal of the normal matrix: bound of work (`bounds_of_work
#: camera`).
_DAMPING, _LEAST, _MOST = 1e-3, 1e-12, 1e12


def minimised(
    state: State,
    cost: Callable[[State], float],
    blocks: Callable[[State], Blocks],
    moved: Callable[[State, FloatArray, Sequence[FloatArray]], State | None],
) -> State:
    """The state of the least cost that steps downhill reach.

    Parameters
    ----------
    state : the start
    cost : sum of squares; infinite where there is no prediction
    blocks : residuals and Jacobians
    moved : the state after a step of what is shared and of what is each one's own; None: there is no such state

    Raises
    ------
    LinAlgError : the start has no finite cost
    """
    least, damping = cost(state), _DAMPING
    if not np.isfinite(least):
        raise np.linalg.LinAlgError("a corner that the start does not see")
    for _ in range(_ROUNDS):
        there = blocks(state)
        while True:
            tried = moved(state, *damped_step(there, damping))
            new = np.inf if tried is None else cost(tried)
            if tried is not None and new <= least:
                break
            damping *= 10.0
            if damping > _MOST:
                return state
        gain, least, state, damping = least - new, new, tried, max(damping / 10.0, _LEAST)
        if gain <= _SETTLED * max(least, 1e-300):
            break
    return state


def damped_step(blocks: Blocks, damping: float) -> tuple[FloatArray, list[FloatArray]]:
    """One damped step of what is shared, and of each one's own: (U - sum W V^-1 W') da = sum W V^-1 h - g."""
    U = sum(A.T @ A for _, A, _ in blocks)
    left = U + damping * np.diag(np.diag(U))
    right = sum(A.T @ r for r, A, _ in blocks)
    kept = []
    for r, A, B in blocks:
        V, W, h = B.T @ B, A.T @ B, B.T @ r
        V = V + damping * np.diag(np.diag(V))
        VW, Vh = np.linalg.solve(V, W.T), np.linalg.solve(V, h)
        left, right = left - W @ VW, right - W @ Vh
        kept.append((VW, Vh))
    da = np.asarray(-np.linalg.lstsq(left, right, rcond=None)[0], dtype=np.float64)
    return da, [np.asarray(-Vh - VW @ da, dtype=np.float64) for VW, Vh in kept]
