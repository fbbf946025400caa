"""Single wrong readings: where they are, and a recording without them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.run_filter import run_filter
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray, runs_of
from sinan.sensors.recording import Recording

#: A reading is called wrong when it leaves its neighbours by this many sigma, as 2 norm.sf(6) = 1 in 5e8 Gaussian
#: readings do.
OUTLIER = 6.0
#: In a coloured residual also by so many times the residual's own spread: 2 norm.sf(4) = 1 in 16,000.
_OUTLIER_SPREAD = 4.0
#: Readings of the shortest disturbance, or of wrong ones that are worth a word: one or two in a row are wrong readings,
#: since the median of seven about them does not follow them (`isolated_outliers`).
SHORTEST = 3


def isolated_outliers(residual: FloatArray, sigma: float | None, threshold: float = OUTLIER) -> BoolArray:
    """(n,) whether a residual leaves the median of its neighbours by more than `threshold` sigma, alone.

    Parameters
    ----------
    residual : (n,) in time order
    sigma : of one residual; None: 1.4826 times the median deviation, or the declared one where that is larger
    """
    from scipy.ndimage import median_filter

    if len(residual) < 8:
        return np.zeros(len(residual), dtype=bool)
    away = residual - median_filter(residual, size=7, mode="nearest")
    scale = 1.4826 * float(np.median(np.abs(away)))
    scale = max(scale, np.finfo(float).tiny) if sigma is None else max(scale, sigma)
    # heavy tails are no outliers: the scale is at least that of the ninth decile, which outliers hardly reach
    scale = max(scale, float(np.quantile(np.abs(away), 0.9)) / float(stats.norm.isf(0.05)))
    spread = 1.4826 * float(np.median(np.abs(residual - np.median(residual))))
    wrong = np.abs(away) > max(threshold * scale, _OUTLIER_SPREAD * spread)
    for start, stop in runs_of(wrong):
        wrong[start:stop] &= stop - start < SHORTEST
    return wrong


def wrong_rows(journal: Journal, sensor: str) -> IntArray:
    """Rows of a sensor's stream whose whitened innovation leaves its neighbours' by six sigma, alone."""
    one = journal.stream(sensor)
    order = np.argsort(one.t, kind="stable")
    wrong = np.zeros(len(one), dtype=bool)
    for component in np.nan_to_num(one.white[order].T):
        wrong[order] |= isolated_outliers(component, 1.0)
    return one.index[wrong]


def without_wrong_readings(flight: Flight) -> tuple[Flight, dict[str, tuple[int, int]]]:
    """The flight without isolated wrong readings, and how many of how many there were by stream.

    A reading is wrong when its whitened innovation leaves those of its neighbours by six sigma, alone: an effect of the
    catalogue, a step or a disturbance moves neighbours too.
    """
    streams = flight.recording.streams
    found = {name: (0, len(streams[name])) for name in flight.model.sensors if name in streams}
    for _ in range(2):  # what a gross one hides shows when it is gone
        journal = run_filter(flight.believing(relinearise=False), {}, engine="numba", stride=0)
        more = wrong_about(flight, journal)
        flight = flight.reading(without_rows(flight.recording, more))
        found = {name: (before + len(more.get(name, ())), count) for name, (before, count) in found.items()}
        if not more:
            break
    return flight, found


def wrong_about(flight: Flight, journal: Journal) -> dict[str, IntArray]:
    """The rows that are wrong in a flight's journal, by stream that has any."""
    wrong = {name: wrong_rows(journal, name) for name in flight.model.sensors if name in flight.recording.streams}
    return {name: rows for name, rows in wrong.items() if len(rows)}


def without_rows(recording: Recording, rows: Mapping[str, IntArray]) -> Recording:
    """The recording without some rows of its streams; itself where there are none."""
    if not rows:
        return recording
    kept = {
        name: recording.streams[name].rows(_all_but(len(recording.streams[name]), wrong))
        for name, wrong in rows.items()
    }
    return recording.replace(streams={**recording.streams, **kept})


def _all_but(count: int, rows: IntArray) -> BoolArray:
    keep = np.ones(count, dtype=bool)
    keep[rows] = False
    return keep
