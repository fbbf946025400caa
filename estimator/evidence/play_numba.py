"""Compiled play of a sticking instrument: each value depends on the one before."""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np
from numba import njit

from sinan.estimator.filter.kernel_cache import options


@njit(**options())
def follow(x, half):
    """(n,) what follows x (n,), once it is left behind by more than `half`."""
    out, state = np.empty_like(x), x[0]
    for k in range(len(x)):
        state = min(max(state, x[k] - half), x[k] + half)
        out[k] = state
    return out
