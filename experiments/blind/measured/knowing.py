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
from sinan.experiments.blind.maker.measure import DELAYS
from sinan.experiments.blind.measured.minute import Minute, put
from sinan.sensors.effects import effect
from sinan.sensors.recording import Recording

#: An effect of which nothing is drawn: of outliers nothing is asked here.
_NOT_DRAWN = np.random.default_rng(0)


def gain(minute: Minute, hidden: Hidden) -> float | None:
    """Growth of 2 log L of a minute with an effect in it, when that very effect is put into the model.

    About lambda = beta' Lambda beta on average, by the levels of the untouched minute, and within 2 sqrt(lambda) of it;
    where their noise is white and is not, more than what there is to see. None for outliers, which no mean shows.
    """
    if hidden.name.endswith(".outliers"):
        return None
    recording = put(_prepared(minute), hidden, _NOT_DRAWN)
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
    levels = minute.ready.levels
    if not levels.found:
        return gain(minute, hidden)
    both = _of_readings_in_both(_prepared(minute), hidden)

    def log_posterior(recording: Recording) -> float:
        problem = Problem(recording, levels.found, levels)
        return problem.maximise(problem.theta(levels))[1]

    return 2.0 * (log_posterior(both.control) - log_posterior(put(both, hidden, _NOT_DRAWN)))


def _prepared(minute: Minute) -> Minute:
    """The prepared minute: hard iron and disturbed stretches are taken off, and so they are with an effect in it."""
    return replace(minute, recording=minute.ready.recording)


def _of_readings_in_both(minute: Minute, hidden: Hidden) -> Minute:
    """The minute without readings that a lateness may move out of it: one more in either has a density of its own."""
    if hidden.effect not in DELAYS:
        return minute
    name, _ = minute.columns(hidden.stream)
    stream = minute.recording.streams[name]
    moved = abs(float(hidden.beta[0])) + abs(minute.ready.levels.latency.get(name, 0.0))
    kept = stream.rows((stream.t > minute.begin + moved) & (stream.t < minute.end - moved))
    return replace(minute, recording=minute.recording.replace(streams={**minute.recording.streams, name: kept}))
