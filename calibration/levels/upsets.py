"""Moments at which a filter loses its way: a shock beyond the IMU's range, iron that swings a compass for a while.

The model knows the noise of an IMU and the colour of a compass at any moment alike. What is worse for an instant leaves
a filter that is sure of a wrong attitude; from then on its positions err by more than it can believe, and it takes the
fixes for the outliers. So the motion may be upset: at an instant attitude and velocity are open again, by sizes that
are sought. When and by how much is a hypothesis about the log. Upsets are a Poisson process; where fixes in a row are
doubted, one is in the model if it makes the log likelier than none does, and likelier than that the receiver jumped,
which is an effect (`gps.step`, `gps.transient`) for a trace to find.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np

from sinan.calibration.levels.declared_effects import Readings
from sinan.calibration.levels.fit import Levels
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.flight_model import Upset
from sinan.estimator.filter.inputs import RunInputs
from sinan.estimator.filter.journal import Journal
from sinan.sensors.arrays import runs_of
from sinan.sensors.errors import InputError
from sinan.sensors.recording import Recording

#: Upsets of a vehicle [1/s]: a choice, one in an hour; ten times as many are worth 2.3 of log L.
RATE = 1.0 / 3600.0
#: Sizes that are tried: of the attitude [rad] and of the velocity [m/s]; a log tells nothing finer of one instant.
ATTITUDE, VELOCITY = (0.1, 0.3, 1.0), (0.0, 1.0, 3.0, 10.0)
#: What is tried first at every instant: it is near to any.
FIRST = (0.3, 3.0)
#: Instants that are tried, in fixes from the first that is doubted, and then from the best of them.
INSTANTS, FINER = (-16.0, -8.0, -4.0, -2.0, -1.0, 0.0, 1.0), (-3.0, -1.5, -0.5, 0.0, 0.5, 1.5, 3.0)
#: So many fixes belong to each instant that is tried, about the best.
APART = 0.5
#: Fixes that tell the time between fixes, and that two of them are in a row.
LEAST = 3
#: Runs of doubted fixes that are looked at, those first that cost most: bound of work (`test_upsets`, of a log with one
#: upset); a log that has more keeps six.
MOST = 6


@dataclass(frozen=True)
class _Doubted:
    """Fixes in a row that are doubted more than believed.

    Attributes
    ----------
    rows : of the events, from the one before the first on
    t : of the first [s]
    lost : sum of the logarithms of what their weights lack
    """

    rows: tuple[int, ...]
    t: float
    lost: float


def with_upsets(recording: Recording, levels: Levels) -> Levels:
    """Levels with the upsets that make a log likelier; where no place is measured, or all noise is declared, as they
    are.

    Neglects that other sizes of noise follow from them, and receivers that err otherwise than by a jump: where one
    drifts, or its velocity is wrong for seconds, upsets are found that are none.
    """
    if "gps" not in recording.streams or levels.tail is None:
        return levels
    if len(recording.streams["gps"]) < LEAST:
        return levels
    readings = Readings.of(levels.flight(recording))
    step, asked = float(np.median(np.diff(recording.streams["gps"].t))), set[float]()

    def log_likelihood(inputs: RunInputs) -> float:
        try:
            return run(inputs, "numba", 0).log_likelihood
        except InputError:  # no state follows from that
            return -np.inf

    def of(one: Levels) -> float:
        return log_likelihood(readings.inputs(one.flight(recording)))

    for _ in range(MOST):
        inputs = readings.inputs(levels.flight(recording))
        journal = run(inputs, "numba", 0)
        doubted = _most_doubted(journal, asked)
        if doubted is None:
            break
        asked.add(doubted.t)
        value, other = _likeliest_upset(levels, doubted.t, step, (journal.t_start, journal.t_end), of)
        prior = float(np.log(RATE * step * APART / (len(ATTITUDE) * len(VELOCITY))))
        rivals = [journal.log_likelihood - prior, *map(log_likelihood, _jumps(inputs, journal, doubted))]
        if value > max(rivals):
            levels = other
    return levels


def _most_doubted(journal: Journal, asked: Collection[float]) -> _Doubted | None:
    """The run of doubted fixes, of those that were not asked yet, that costs most of the likelihood."""
    mine = np.flatnonzero((journal.sensor == journal.sensors.index("gps")) & journal.accepted)
    weight = 1.0 / journal.model.spread("gps", journal.nis[mine])
    lost = -np.log(weight)
    runs = [
        _Doubted(tuple(mine[max(a - 1, 0) : b].tolist()), float(journal.t[mine[a]]), float(np.sum(lost[a:b])))
        for a, b in runs_of(weight < 0.5)
        if b - a > 1
    ]
    return max((one for one in runs if one.t not in asked), key=lambda one: one.lost, default=None)


def _likeliest_upset(
    levels: Levels, about: float, step: float, within: tuple[float, float], of: Callable[[Levels], float]
) -> tuple[float, Levels]:
    """Log-likelihood with the likeliest upset about an instant, within the IMU's time, and the levels with it."""

    def tried(upset: Upset) -> tuple[float, Levels]:
        other = replace(levels, upsets=tuple(sorted((*levels.upsets, upset), key=lambda one: one.t)))
        return of(other), other

    upset = Upset(about, *FIRST)
    for fixes in (INSTANTS, FINER):
        each = [replace(upset, t=upset.t + step * k) for k in fixes]
        upset = max((one for one in each if within[0] < one.t < within[1]), key=lambda one: tried(one)[0])
    for key, sizes in (("velocity", VELOCITY), ("attitude", ATTITUDE)):
        upset = max((replace(upset, **{key: size}) for size in sizes), key=lambda one: tried(one)[0])
    return tried(upset)


def _jumps(inputs: RunInputs, journal: Journal, doubted: _Doubted) -> list[RunInputs]:
    """The same readings without a jump of the receiver's, that begins with one of the first doubted fixes: it is what
    that fix is off by, and is over with the last doubted one or stays.
    """
    events, stream, found = inputs.events, journal.stream("gps"), []
    later = np.flatnonzero((events.sensor == journal.sensors.index("gps")) & journal.accepted)
    for first in doubted.rows[:3]:
        off = stream.nu[stream.index == events.index[first]][0, :3]
        for last in (doubted.rows[-1], later[-1]):
            z = events.z.copy()
            z[events.row[later[(later >= first) & (later <= last)]][:, None] + np.arange(3)] -= off
            found.append(replace(inputs, events=replace(events, z=z)))
    return found
