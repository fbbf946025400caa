"""The weight of a residual in an RMS that people read: what a model can hardly predict counts for little."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray


def in_weight(
    residual: FloatArray, variance: FloatArray, tells: BoolArray | None = None, weight: FloatArray | None = None
) -> FloatArray:
    """(n, m) residuals times the root of their weight, so that their mean square is the weighted one.

        weight / variance, over the mean of 1 / variance

    Of a first innovation, from which a zero is found, hardly anything is left.

    Parameters
    ----------
    variance : (n, m) or (n, 1) that the model predicts of each
    tells : (n, m) which are readings at all; None: all
    weight : (n,) that a heavy tail gives doubtful readings; None: one
    """
    sure = 1.0 / variance
    sure = sure / np.mean(sure, where=True if tells is None else tells)
    return np.asarray(residual * np.sqrt(sure if weight is None else weight[:, None] * sure))
