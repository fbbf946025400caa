"""The true values behind readings: a sensor's model, solved for them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.rotation import cross

#: Passes, step of the derivative and end of the passes, both over the size of a reading: bound of work
#: (`bounds_of_work poses`, `turns`).
_MOST_PASSES, _STEP, _SETTLED = 25, 1e-5, 1e-12


def inverted(
    y: FloatArray, scale: FloatArray, size: float, added: Callable[[FloatArray], FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Solve scale * u + added(u) = y for u by Newton's method, with the slope at y / scale in every pass.

    Parameters
    ----------
    y : (n, 3) readings without what does not depend on u
    scale : (3,) of the axes
    size : of a reading, in its unit
    added : what the effects add to the reading at u (n, 3)

    Returns
    -------
    u (n, 3), and d reading / d u (n, 3, 3) there
    """

    def slope(u: FloatArray) -> FloatArray:
        h = _STEP * size * np.eye(3)
        return np.asarray(
            np.diag(scale) + np.stack([added(u + d) - added(u - d) for d in h], -1) / (2.0 * _STEP * size)
        )

    u = y / scale
    back = inverse(slope(u))
    for _ in range(_MOST_PASSES):
        step = np.einsum("nij,nj->ni", back, scale * u + added(u) - y)
        u = u - step
        if not np.max(np.abs(step)) > _SETTLED * size:
            break
    return u, slope(u)


def inverse(B: FloatArray) -> FloatArray:
    """(n, 3, 3) inverse of each matrix by its cofactors."""
    rows = cross(B[:, [1, 2, 0]], B[:, [2, 0, 1]])
    return np.swapaxes(rows, 1, 2) / np.einsum("ni,ni->n", B[:, 0], rows[:, 0])[:, None, None]
