"""Readings of one stream that are withheld for seconds and predicted without them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sinan.estimator.filter.events import ACCEPTED, WITHHELD
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.run_filter import run_filter
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray

Window = tuple[float, float]


@dataclass(frozen=True)
class Predicted:
    """Readings of a stream that the filter was not given, against what it predicted.

    Attributes
    ----------
    t : (k,) stamps [s]
    age : (k,) s since the last reading of the stream that it used
    nu : (k, m) reading less prediction
    log_density : (k,) of the reading under the prediction
    """

    t: FloatArray
    age: FloatArray
    nu: FloatArray
    log_density: FloatArray

    def rows(self, keep: BoolArray | IntArray) -> Predicted:
        """Some of the readings."""
        return Predicted(self.t[keep], self.age[keep], self.nu[keep], self.log_density[keep])

    @property
    def distance(self) -> FloatArray:
        """(k,) norm of what the first three components are off: of a fix the position [m]."""
        return np.asarray(np.linalg.norm(self.nu[:, :3], axis=1))


def windows(t: FloatArray, length: float, every: float, first: float) -> tuple[Window, ...]:
    """Windows of stamps: `length` seconds once in `every`, from `first` seconds after the first stamp on [s]."""
    return tuple((float(begin), float(begin) + length) for begin in np.arange(t[0] + first, t[-1], every))


def predicted(
    flight: Flight,
    stream: str,
    held: Sequence[Window],
    betas: Mapping[Any, FloatArray] | None = None,
) -> Predicted:
    """Run the filter without a stream's readings of some windows, and say what it predicted of them.

    Parameters
    ----------
    betas : effects in the model, see `run_filter`
    """
    journal = run_filter(flight.believing(withheld={stream: held}), betas, engine="numba", stride=0)
    one, stamps = journal.stream(stream), flight.recording.streams[stream].t
    rows = (one.status == WITHHELD) & np.isfinite(one.nis)
    given = np.sort(stamps[one.index[one.status == ACCEPTED]])
    t = stamps[one.index[rows]]
    before = np.searchsorted(given, t) - 1
    age = np.where(before >= 0, t - given[np.maximum(before, 0)], np.inf)
    return Predicted(t, age, one.told[rows], journal.loglik[one.events[rows]])
