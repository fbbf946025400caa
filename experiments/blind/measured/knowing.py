"""What one who knows the answer gains by it: whether an effect that was put in can be seen at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.run_filter import run_filter
from sinan.experiments.blind.maker.catalogue import Hidden
from sinan.experiments.blind.measured.minute import Minute, put
from sinan.sensors.effects import effect


def gain(minute: Minute, hidden: Hidden) -> float | None:
    """Growth of 2 log L of a minute with an effect in it, when that very effect is put into the model.

    About lambda = beta' Lambda beta on average, by the levels of the untouched minute, and within 2 sqrt(lambda) of it;
    where their noise is white and is not, more than what there is to see. None for outliers, which no mean shows.
    """
    if hidden.name.endswith(".outliers"):
        return None
    # hard iron and disturbed stretches are taken off as in the untouched minute
    recording = put(replace(minute, recording=minute.ready.recording), hidden, np.random.default_rng(0))
    model = minute.ready.model.replace(gate_level=None, robust_level=None)
    entry = effect(hidden.name)
    term = entry if hidden.interval is None else entry.over(*hidden.interval)
    plain, knowing = (
        run_filter(Flight(recording, model), {term: share * hidden.beta}, engine="numba", stride=0)
        for share in (0.0, 1.0)
    )
    return 2.0 * (knowing.log_likelihood - plain.log_likelihood)
