"""Prediction over seconds: readings of one stream are withheld, and a model says what they are.

Where the noise of a log is found and not declared, a smaller one-step innovation proves no effect: it may have taken
the shape of colour. What is wrong in the mean is wrong for seconds, and shows when nothing corrects the filter.
Source: A. Gelman, J. Hwang, A. Vehtari, Stat. Comput. 24 (2014) 997 (comparison by predictive density, with the
standard error of the difference over what was left out).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from experiments.residual_loop.source import StreamResidual
from sensors.arrays import FloatArray, IntArray

#: Readings are withheld for so long [s], time about: a second pass withholds the others.
WINDOW = 5.0
#: Level at which a model counts as the better one.
LEVEL = 0.05


@dataclass(frozen=True)
class Gain:
    """By how much the log predictive density of withheld readings grows with an effect.

    Attributes
    ----------
    windows : (n,) growth in each window of a stream
    """

    windows: FloatArray

    @property
    def total(self) -> float:
        """Of all windows."""
        return float(np.sum(self.windows))

    @property
    def is_sure(self) -> bool:
        """Whether it is above zero beyond its own scatter, by Student's law of the windows' mean."""
        from scipy import stats

        n = len(self.windows)
        if n < 2:
            return self.total > 0.0
        error = float(np.std(self.windows, ddof=1)) * np.sqrt(n)
        return self.total > float(stats.t.isf(LEVEL, n - 1)) * error


def window_of(t: FloatArray, start: float) -> IntArray:
    """(n,) number of the window that an instant is in."""
    return np.floor((t - start) / WINDOW).astype(np.int64)


def withheld_in(start: float, end: float) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """Windows of two passes, which withhold time about; the first of all is given, from which a filter starts."""
    edges = start + WINDOW * np.arange(1, max(int((end - start) / WINDOW), 1))
    every = [(float(edge), float(edge) + WINDOW) for edge in edges]
    return every[::2], every[1::2]


def gain_of(before: Sequence[StreamResidual], after: Sequence[StreamResidual], start: float) -> Gain:
    """Of a model over another, from what both foretell of the same readings."""
    others, windows = {r.stream: r for r in after}, []
    for one in before:
        other = others.get(one.stream)
        if other is None:
            continue
        _, mine, same = np.intersect1d(one.row, other.row, return_indices=True)  # a lateness moves all stamps
        grown = 0.5 * (np.sum(one.whitened[mine] ** 2, axis=1) - np.sum(other.whitened[same] ** 2, axis=1))
        number = window_of(one.t[mine], start)
        windows.append(np.bincount(number - number.min(), grown)[np.unique(number) - number.min()])
    return Gain(np.concatenate([*windows, np.zeros(0)]))
