"""Rows of a log that are no readings: they hold a slower sensor's last one, or lie on the line to its next.

A table of all sensors at the rate of the fastest, or a log that was resampled so, repeats what has not come anew, or
interpolates it. A sensor's next reading comes no sooner than its period, so that a run of such rows the likelier ends
the longer it has been. Readings of a coarse sensor that happen to be equal, or in line, end their runs at any row alike
where its noise is white, and the sooner the nearer they are to the edge of a step where it wanders.
"""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray, IntArray, runs_of
from sinan.sensors.last_digit import last_digit

#: Ratio of the odds that a run ends from its usual length on and before, from which on rows are no readings, at two
#: sigma: a choice. Equal readings by chance have 1 or less; a resampled log has 10 and more.
ODDS = 2.0
#: Steps of a row over the rounding of a bend, from which on being in line says something: a choice. What moves slowly
#: beside its last digit, as a laser of 1 cm does, is in line whatever it reads; a resampled log has 20 and more.
RESOLVED = 10.0
#: A number printed or stored to seven digits is in line with its neighbours to within this part of the largest.
_ROUNDING = 1e-7


def held(values: FloatArray) -> BoolArray:
    """(n,) rows that hold the reading of a row before; none where runs of equal rows are no sensor's period, or all
    steps are as large. What stands for long counts once, as nobody knows whether it was read again.

    Parameters
    ----------
    values : (n, k) all that one reading has; NaN equals NaN
    """
    old = np.zeros(len(values), dtype=bool)
    before, after = values[:-1], values[1:]
    old[1:] = np.all((before == after) | (np.isnan(before) & np.isnan(after)), axis=1)
    return _with_a_period(old) if not _is_staircase(values[~old]) else np.zeros(len(values), dtype=bool)


def interpolated(t: FloatArray, values: FloatArray) -> BoolArray:
    """(n,) rows on a straight line from one reading to the next, but for the last on each, which is the nearest before
    the next reading; none where the lines are not as long as a sensor's period.

    Parameters
    ----------
    t : (n,) [s]
    values : (n, k) all that one reading has; NaN: not told
    """
    old = np.zeros(len(values), dtype=bool)
    if len(values) < 3:
        return old
    step, largest = np.diff(t)[:, None], np.max(np.abs(values), axis=0, where=np.isfinite(values), initial=0.0)
    digits = np.array([last_digit(column) for column in values.T])
    rounded = np.maximum(2.0 * digits, 4.0 * _ROUNDING * largest)
    with np.errstate(all="ignore"):  # what is not told bends no line
        bend = np.diff(np.diff(values, axis=0) / step, axis=0) * np.minimum(step[1:], step[:-1])
        bent = np.any(np.abs(bend) > rounded, axis=1)
        along = np.any(np.abs(np.diff(values, axis=0))[:-1] > RESOLVED * rounded, axis=1)
    in_line = ~bent & along
    if np.mean(in_line) < 0.5:  # of four rows to a reading two are in line, and of fewer nothing is gained
        return old
    old[1:-1] = in_line
    for start, stop in runs_of(~old):
        old[start + 1 : stop : 2] = True  # a reading between two rows bends the line at both
    return _with_a_period(old)


def _is_staircase(values: FloatArray) -> bool:
    """Whether readings (n, k), none like the one before, mostly differ in one component by one and the same step, as
    what moves evenly does that is read coarsely.
    """
    steps = np.nan_to_num(np.diff(values, axis=0))
    if len(steps) < 2 or np.median(np.sum(steps != 0.0, axis=1)) > 1.0:
        return False
    steps = np.linalg.norm(steps, axis=1)
    sizes = np.round(steps / np.median(steps), 2)
    return bool(np.max(np.unique(sizes, return_counts=True)[1]) > 0.5 * len(steps))


def _with_a_period(old: BoolArray) -> BoolArray:
    """The rows that are no readings, if the runs of them after a reading are a sensor's period; else none."""
    runs = np.diff(np.append(np.flatnonzero(~old), len(old)))[1:-1]  # the first and the last are cut
    return old if len(runs) and _end_at_a_length(runs) else np.zeros(len(old), dtype=bool)


def _end_at_a_length(runs: IntArray) -> bool:
    """Whether runs end rather from a length on that three in four have than before.

    Of a run of L rows the row k = 1 .. L - 1 does not end it, row L does; with Jeffreys' prior of either chance.
    """
    usual = max(2, int(np.quantile(runs, 0.25)))
    ends = np.array([np.sum(runs < usual), np.sum(runs >= usual)]) + 0.5
    goes_on = np.array([np.sum(np.minimum(runs, usual - 1)), np.sum(np.maximum(runs - usual + 1, 0))]) + 1.0 - ends
    ratio = np.log(ends[1] / goes_on[1]) - np.log(ends[0] / goes_on[0])
    sigma = np.sqrt(np.sum(1.0 / ends + 1.0 / goes_on))
    return bool(ratio - 2.0 * sigma > np.log(ODDS))
