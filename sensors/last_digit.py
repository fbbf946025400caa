"""The step of the numbers in which readings were logged."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray

#: Readings that are nearer to each other than this, over the largest of them, are the same number: float arithmetic of
#: a unit's factor leaves 1e-15, of a turn into NED and back 1e-13.
SAME_NUMBER = 1e-10
#: Parts of a log at most, and readings in one at least: an offset from some time on hides the step in one part alone,
#: and the least difference of a hundred readings of many digits is a ten-thousandth of their range.
PARTS, LEAST = 8, 100


def last_digit(values: FloatArray) -> float:
    """Step of the numbers in which one component (n,) was logged: the smallest difference of two readings.

    Of readings with digits enough it is tiny, about their range over n^2, and so is the noise of such a step. It is the
    median over parts of the log.
    """
    found = []
    for part in np.array_split(values, int(np.clip(len(values) // LEAST, 1, PARTS))):
        gaps = np.diff(np.unique(part))
        gaps = gaps[gaps > SAME_NUMBER * np.max(np.abs(values), initial=0.0)]
        if len(gaps):
            found.append(float(np.min(gaps)))
    return float(np.median(found)) if found else 0.0


def rounding_variance(values: FloatArray) -> FloatArray:
    """(m,) variance of the error of rounding of each component of readings (n, m): uniform over a step q, q^2 / 12.

    Neglects that it stays the same while a reading moves by less than a step.
    """
    return np.array([last_digit(column) ** 2 / 12.0 for column in values.T])
