"""Streams that the filter does not believe, wholly or nearly: no fault does that, a wrong unit, axis or frame does."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sinan.estimator.filter.events import ACCEPTED, GATED
from sinan.estimator.filter.journal import Journal
from sinan.experiments.report.words import SENSORS

#: Share of a stream's readings from which on it is said to be refused.
NEARLY_ALL = 0.95
#: Fewer readings say nothing of a stream.
_LEAST = 5


def doubted_shares(journal: Journal) -> dict[str, float]:
    """Share of each sensor's readings that the gate refused, or that were given less weight in its place.

    A filter that was lost believes right readings again once they have led it back; wrong ones it never does.
    """
    shares = {}
    for sensor in journal.sensors:
        one = journal.stream(sensor)
        judged = (one.status == GATED) | (one.status == ACCEPTED)
        doubted = (one.status == GATED) | ((one.status == ACCEPTED) & (one.weight < 1.0))
        if np.sum(judged) >= _LEAST:
            shares[sensor] = float(np.sum(doubted) / np.sum(judged))
    return shares


def refused(shares: Mapping[str, float]) -> dict[str, str]:
    """A sentence for each stream of which the filter believes hardly a reading; the level is no sensor of its own."""
    return {
        sensor: f"the filter believes {_few(share)} of the {SENSORS.get(sensor, sensor)} readings: their unit, axis or "
        "frame is another than the recording says"
        for sensor, share in shares.items()
        if share >= NEARLY_ALL and sensor != "level"
    }


def _few(share: float) -> str:
    return "none" if share == 1.0 else f"{100.0 * (1.0 - share):.2g} %"
