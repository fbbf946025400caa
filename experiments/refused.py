"""How much of each stream the filter does not believe; the sentences are `experiments.report.refused_words`."""

from __future__ import annotations

import numpy as np

from sinan.estimator.filter.events import ACCEPTED, GATED
from sinan.estimator.filter.journal import Journal

#: Fewer readings say nothing of a stream.
_LEAST = 5


def doubted_shares(journal: Journal) -> dict[str, float]:
    """Share of each sensor's readings that the gate refused, or that count less than half in its place.

    A law of innovations with a second kind of answer in it takes something off every weight.

    A filter that was lost believes right readings again once they have led it back; wrong ones it never does.
    """
    shares = {}
    for sensor in journal.sensors:
        one = journal.stream(sensor)
        judged = (one.status == GATED) | (one.status == ACCEPTED)
        doubted = (one.status == GATED) | ((one.status == ACCEPTED) & (one.weight < 0.5))
        if np.sum(judged) >= _LEAST:
            shares[sensor] = float(np.sum(doubted) / np.sum(judged))
    return shares
