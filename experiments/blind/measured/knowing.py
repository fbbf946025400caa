"""What one who knows the answer gains by it: whether an effect that was put in can be seen at all, by the noise of the
untouched minute and by what the minute itself has for noise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sinan.calibration.levels.problem import Problem
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.run_filter import run_filter
from sinan.experiments.blind.maker.catalogue import Hidden
from sinan.experiments.blind.measured.minute import Minute, put
from sinan.sensors.effects import effect
from sinan.sensors.recording import Recording
from sinan.sensors.window import between


def gain(minute: Minute, hidden: Hidden) -> float | None:
    """Growth of 2 log L of a minute with an effect in it, when that very effect is put into the model.

    About lambda = beta' Lambda beta on average, by the levels of the untouched minute, and within 2 sqrt(lambda) of it;
    where their noise is white and is not, more than what there is to see. None for outliers, which no mean shows.
    """
    if hidden.name.endswith(".outliers"):
        return None
    recording = _put(minute, hidden)
    model = minute.ready.model.replace(gate_level=None, robust_level=None)
    entry = effect(hidden.name)
    term = entry if hidden.interval is None else entry.over(*hidden.interval)
    plain, knowing = (
        run_filter(Flight(recording, model), {term: share * hidden.beta}, engine="numba", stride=0)
        for share in (0.0, 1.0)
    )
    return 2.0 * (knowing.log_likelihood - plain.log_likelihood)


def told(minute: Minute, hidden: Hidden) -> float | None:
    """The same by what the minute itself shows: growth of twice its log-posterior, the sizes of its noise sought
    without the effect in the model and with it, each from where the untouched minute has them.

    With the very effect in the model the readings are those of the untouched minute. An effect that noise takes up has
    less than `gain`; where nothing is sought it is that. None for outliers.

    Neglects that the search may end in another maximum, and then the figure may be negative, or a few too large.
    """
    if hidden.name.endswith(".outliers"):
        return None
    levels, untouched = minute.ready.levels, between(minute.ready.recording, minute.begin, minute.end)
    if not levels.found:
        return gain(minute, hidden)

    def log_posterior(recording: Recording) -> float:
        problem = Problem(recording, levels.found, levels)
        return problem.maximise(problem.theta(levels))[1]

    return 2.0 * (log_posterior(untouched) - log_posterior(_put(minute, hidden)))


def _put(minute: Minute, hidden: Hidden) -> Recording:
    """An effect in the prepared minute: hard iron and disturbed stretches are taken off as in the untouched one."""
    return put(replace(minute, recording=minute.ready.recording), hidden, np.random.default_rng(0))
