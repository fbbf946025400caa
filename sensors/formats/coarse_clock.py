"""The clock of a table whose stamps are coarser than its rows: 200 rows a second, and a time of two decimals."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray


def spread(t: FloatArray) -> tuple[FloatArray, list[str]]:
    """(n,) stamps of all rows of a table, those that are shared put evenly before the next, and no later than a usual
    step of the clock after their own; and that in words. What is in a table twice counts as two rows.

    Where the clock goes back, or no stamp is shared, they stay as they are.
    """
    steps = np.diff(t)
    if len(t) < 2 or not np.all(steps >= 0.0) or not np.any(steps == 0.0) or not np.any(steps > 0.0):
        return t, []
    first = np.flatnonzero(np.append(True, steps > 0.0))
    to_next = np.diff(t[first])
    usual = float(np.median(to_next))
    until = np.append(np.minimum(to_next, usual), usual)
    group = np.searchsorted(first, np.arange(len(t)), side="right") - 1
    place = np.arange(len(t)) - first[group]
    count = f"{len(t) - len(first)} rows have the stamp of the row before: put evenly before the next stamp"
    return t + until[group] * place / np.bincount(group)[group], [count]
