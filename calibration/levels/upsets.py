"""Moments at which a filter loses its way: a shock beyond the IMU's range, iron that swings a compass for a while.

The model knows the noise of an IMU and the colour of a compass at any moment alike. What is worse for an instant leaves
a filter that is sure of a wrong attitude; from then on its positions err by more than it can believe, and it takes the
fixes for the outliers. So the motion may be upset: at an instant attitude and velocity are open again, by sizes that
are sought. When and by how much is a hypothesis about the log. Its rival is a lapse of the receiver, whose error walks
for a while: it jumps, drifts, or tells a velocity that is none, and is no matter of the motion. Both are Poisson
processes; where fixes in a row are doubted, an upset is in the model if it makes the log likelier than a lapse does,
and than neither.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student_t

from sinan.calibration.levels.declared_effects import Readings
from sinan.calibration.levels.levels import Levels
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.events import WITHHELD
from sinan.estimator.filter.flight_model import Upset
from sinan.estimator.filter.inputs import RunInputs
from sinan.estimator.filter.journal import Journal
from sinan.sensors.arrays import FloatArray, IntArray
from sinan.sensors.errors import InputError
from sinan.sensors.recording import Recording

#: Upsets of a vehicle, and lapses of a receiver [1/s], one in an hour: a choice, half and twice of which are worth
#: log(2) = 0.7 of log L and change nothing of a shock (`bounds_of_work shock`).
RATE = 1.0 / 3600.0
#: Sizes that are tried, of the attitude [rad] and of the velocity [m/s], as a log tells nothing finer of one instant: a
#: choice, half and twice of which move the end of a flight with a shock by 1 % of its sigma at most (`bounds_of_work
#: shock`).
ATTITUDE, VELOCITY = (0.1, 0.3, 1.0), (0.0, 1.0, 3.0, 10.0)
#: What is tried first at every instant, one of them that is near to any: a choice, half and twice of which change
#: nothing of that end (`bounds_of_work shock`).
FIRST = (0.3, 3.0)
#: Instants that are tried, in fixes from the first that is doubted, and then from the best of them: bound of work
#: (`test_upsets`): half of the first finds a shock 1 s late, and the attitude after it to 0.75 deg for 0.6, of 12.
INSTANTS, FINER = (-16.0, -8.0, -4.0, -2.0, -1.0, 0.0, 1.0), (-3.0, -1.5, -0.5, 0.0, 0.5, 1.5, 3.0)
#: So many fixes belong to each instant that is tried: the distance of `FINER` about the best, 0.5 - 0.0.
APART = 0.5
#: A fix is doubted where its noise is taken for so many times the nominal one: a choice. Half moves that end by 0.9 of
#: its sigma, twice not at all (`bounds_of_work shock`).
DOUBTED = 2.0
#: Steps of a receiver that errs, in units of its white noise, to 2^7 = 128 times it: a choice, half and twice of which
#: change nothing of a shock (`bounds_of_work shock`).
STEPS = 2.0 ** np.arange(8)
#: Upsets that are sought about one run of doubted fixes, as of a turn of 1.8 rad (`test_upsets`): bound of work
#: (`bounds_of_work shock`).
IN_A_ROW = 3
#: Fixes that tell the time between fixes, 2 + 1: of two there is one time, which is no median, since the first is the
#: start.
LEAST = 3
#: Runs of doubted fixes that are looked at, those first that cost most, upsets, lapses and neither alike: bound of work
#: (`test_upsets`, of a log with one upset).
MOST = 6


@dataclass(frozen=True)
class _Lapse:
    """Fixes in a row that tell nothing of the motion, since the receiver errs.

    Attributes
    ----------
    rows : (k,) of the events
    off : (3,) by how much the positions of all later fixes are off [m]
    """

    rows: IntArray
    off: FloatArray


@dataclass(frozen=True)
class _Log:
    """What a filter runs on at any levels, but for the lapses of the receiver that were found.

    Attributes
    ----------
    step : between fixes [s]
    """

    recording: Recording
    readings: Readings
    step: float
    lapses: tuple[_Lapse, ...] = ()

    def inputs(self, levels: Levels) -> RunInputs:
        """Of a run."""
        return _with_lapses(self.readings.inputs(levels.flight(self.recording)), self.lapses)


def _run(inputs: RunInputs) -> Journal | None:
    """A run; None where no state follows."""
    try:
        return run(inputs, "numba", 0)
    except InputError:
        return None


def with_upsets(recording: Recording, levels: Levels) -> Levels:
    """Levels with the upsets that make a log likelier; where no place is measured, or all noise is declared, as they
    are.

    Neglects that other sizes of noise follow from them. A lapse of the receiver that is likelier than upsets is in the
    model while further ones are sought, not in the levels.
    """
    if "gps" not in recording.streams or levels.tail is None or len(recording.streams["gps"]) < LEAST:
        return levels
    step = float(np.median(np.diff(recording.streams["gps"].t)))
    log, refused = _Log(recording, Readings.of(levels.flight(recording)), step), np.zeros(0, dtype=np.int64)
    for _ in range(MOST):
        inputs = log.inputs(levels)
        journal = run(inputs, "numba", 0)
        rows = _most_doubted(journal, refused)
        if not len(rows):
            break
        erred, lapse = _likeliest_lapse(inputs, rows)
        erred += float(np.log(RATE * step))
        upset, other = _likeliest_upsets(log, levels, journal, refused, erred)
        if max(upset, erred) <= journal.log_likelihood:
            refused = np.concatenate([refused, rows])
        elif upset > erred:
            levels = other
        else:
            log = replace(log, lapses=(*log.lapses, lapse))
    return levels


def _most_doubted(journal: Journal, refused: IntArray) -> IntArray:
    """(k,) events of the fixes in a row that are doubted most, by what their weights lack in all; none: no two."""
    mine = np.flatnonzero((journal.sensor == journal.sensors.index("gps")) & journal.accepted)
    spread = journal.model.spread("gps", journal.nis[mine], journal.freedom[mine], journal.loglik[mine])
    doubt = np.log(spread) - np.log(DOUBTED)
    doubt[np.isin(mine, refused)] = -np.inf
    best, begin, total, found = 0.0, 0, 0.0, mine[:0]
    for k, one in enumerate(doubt):
        if total <= 0.0:
            begin, total = k, 0.0
        total += one
        if total > best and k > begin:
            best, found = total, mine[begin : k + 1]
    return found


def _likeliest_upsets(
    log: _Log, levels: Levels, journal: Journal, refused: IntArray, rival: float
) -> tuple[float, Levels]:
    """Log-likelihood and prior with the likeliest upset of the fixes that are doubted most, and the levels with it.

    A large turn is more than one opening of a linearised filter can tell; so where the upset is likelier than none but
    not than a rival, another is sought behind it.
    """
    value = journal.log_likelihood
    prior = float(np.log(RATE * log.step * APART / (len(ATTITUDE) * len(VELOCITY))))
    for count in range(IN_A_ROW):
        rows = _most_doubted(journal, refused)
        if not len(rows):
            break
        found, other = _likeliest_upset(log, levels, journal, float(journal.t[rows[0]]))
        if found.log_likelihood + prior <= journal.log_likelihood:
            break
        value, levels, journal = found.log_likelihood + (count + 1) * prior, other, found
        if value > rival:
            break
    return value, levels


def _likeliest_upset(log: _Log, levels: Levels, journal: Journal, about: float) -> tuple[Journal, Levels]:
    """The run with the likeliest further upset about an instant, within the IMU's time, and the levels with it; the
    first that is tried, where none of those gains.
    """

    def tried(upset: Upset) -> tuple[float, Journal, Levels]:
        other = replace(levels, upsets=tuple(sorted((*levels.upsets, upset), key=lambda one: one.t)))
        found = _run(log.inputs(other))
        return (-np.inf, journal, levels) if found is None else (found.log_likelihood, found, other)

    def likeliest(upsets: Iterable[Upset]) -> tuple[Upset, tuple[float, Journal, Levels]]:
        within = [one for one in upsets if journal.t_start < one.t < journal.t_end]
        return max(((one, tried(one)) for one in within), key=lambda one: one[1][0])

    upset, best = likeliest(Upset(about + log.step * k, *FIRST) for k in INSTANTS)
    if best[0] > journal.log_likelihood:
        upset, best = likeliest(replace(upset, t=upset.t + log.step * k) for k in FINER)
        upset, best = likeliest(replace(upset, velocity=size) for size in VELOCITY)
        upset, best = likeliest(replace(upset, attitude=size) for size in ATTITUDE)
    return best[1:]


def _likeliest_lapse(inputs: RunInputs, rows: IntArray) -> tuple[float, _Lapse]:
    """Log-likelihood where the receiver erred in some fixes, its positions being right or as wrong as before after it;
    minus infinity where no state follows without them.

    What they are off by, against the motion that the readings before and those of other sensors tell, walks: each
    component's steps from one to the next are by Student's law, of the likeliest of some sizes. The end of a lapse is
    no step: the receiver is then right again, or its positions stay off by what they are.
    """
    events, back = inputs.events, _Lapse(rows, np.zeros(3))
    journal = _run(_with_lapses(inputs, [back]))
    if journal is None:
        return -np.inf, back
    stream = journal.stream("gps")
    off = stream.nu[np.isin(stream.events, rows)]
    white = np.sqrt(np.mean(events.r[events.row[rows][:, None] + np.arange(off.shape[1])], axis=0))
    steps, size = np.diff(off, axis=0, prepend=0.0), white * np.sqrt(2.0) * STEPS[:, None, None]
    law = student_t(journal.model.tail_of("gps"))
    each = np.sum(law.logpdf(steps / size) - np.log(size), axis=1)
    walked = float(np.sum(np.max(each, axis=0) - np.log(len(STEPS))))
    stays = _Lapse(rows, off[-1, :3])
    after = _run(_with_lapses(inputs, [stays]))
    if after is not None and after.log_likelihood > journal.log_likelihood:
        return after.log_likelihood + walked, stays
    return journal.log_likelihood + walked, back


def _with_lapses(inputs: RunInputs, lapses: Sequence[_Lapse]) -> RunInputs:
    """The same without the fixes in which the receiver errs, and the later ones where the motion has them."""
    if not lapses:
        return inputs
    events = inputs.events
    status, z = events.status.copy(), events.z.copy()
    fixes = np.flatnonzero(events.sensor == events.sensors.index("gps"))
    for lapse in lapses:
        status[lapse.rows] = WITHHELD
        z[events.row[fixes[fixes > lapse.rows[-1]]][:, None] + np.arange(3)] -= lapse.off
    return replace(inputs, events=replace(events, status=status, z=z))
