"""Rows of a log that hold a slower sensor's last reading: they are no readings.

A table of all sensors at the rate of the fastest, or a log that was resampled so, repeats what has not come anew. A
sensor's next reading comes no sooner than its period, so that a run of equal rows the likelier ends the longer it has
been. Readings of a coarse sensor that happen to be equal end their runs at any row alike where its noise is white, and
the sooner the nearer they are to the edge of a step where it wanders.
"""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray, IntArray

#: Ratio of the odds that a run ends from its usual length on and before, from which on rows are held, at two sigma: a
#: choice. Equal readings by chance have 1 or less; a resampled log has 10 and more.
ODDS = 2.0


def held(values: FloatArray) -> BoolArray:
    """(n,) rows that hold the reading of a row before; none where runs of equal rows are no sensor's period.

    Parameters
    ----------
    values : (n, k) all that one reading has; NaN equals NaN
    """
    n = len(values)
    old = np.zeros(n, dtype=bool)
    if n < 2:
        return old
    before, after = values[:-1], values[1:]
    old[1:] = np.all((before == after) | (np.isnan(before) & np.isnan(after)), axis=1)
    runs = np.diff(np.append(np.flatnonzero(~old), n))[1:-1]  # the first and the last are cut
    return old if len(runs) and _end_at_a_length(runs) else np.zeros(n, dtype=bool)


def _end_at_a_length(runs: IntArray) -> bool:
    """Whether runs of equal rows end rather from a length on that three in four have than before.

    Of a run of L rows the row k = 1 .. L - 1 does not end it, row L does; with Jeffreys' prior of either chance.
    """
    usual = max(2, int(np.quantile(runs, 0.25)))
    ends = np.array([np.sum(runs < usual), np.sum(runs >= usual)]) + 0.5
    goes_on = np.array([np.sum(np.minimum(runs, usual - 1)), np.sum(np.maximum(runs - usual + 1, 0))]) + 1.0 - ends
    ratio = np.log(ends[1] / goes_on[1]) - np.log(ends[0] / goes_on[0])
    sigma = np.sqrt(np.sum(1.0 / ends + 1.0 / goes_on))
    return bool(ratio - 2.0 * sigma > np.log(ODDS))
