"""Differential GPS in the range domain: a base at a known position measures what is wrong with each satellite's range.

    correction(t_b) = P_b - (|p_s - p_b| + modelled delays - c clock_sat + c clock_b)        to be taken off
    P_r - correction(t_b) - rate (t - t_b)

What both receivers see alike goes away: orbit and satellite clock, and of the atmosphere what the model leaves. As the
same effects are modelled at both ends, the rover keeps the *difference* of the modelled delays, which is what a long
base line needs. How wrong a correction becomes with its age the base itself has measured: it foretells its own later
corrections (`Growth`). Neglected: what the models leave of the difference between the two places.

The position domain (the base's position error as an observation of the GPS bias) is `sensors.gps.BaseReceiver`.

Source: B. W. Parkinson, J. J. Spilker, Global Positioning System: Theory and Applications II (1996), ch. 1.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.constants import SPEED_OF_LIGHT
from sinan.sensors.ephemeris import satellite_states
from sinan.sensors.errors import InputError
from sinan.sensors.formats.rinex_navigation import Navigation
from sinan.sensors.formats.rinex_text import WEEK
from sinan.sensors.pseudorange import (
    IONOSPHERE_LENGTH,
    IONOSPHERE_RAY,
    MODELLED,
    Pseudoranges,
    circumstances,
    modelled,
)
from sinan.sensors.range_noise import LOWEST_ELEVATION

SMOOTHING = 60.0  # s: correction and rate are those of a straight line through this span
FEWEST_FOR_RATE = 3  # corrections in the span; with fewer the rate counts as zero
LONGEST_AGE = 60.0  # s: beyond it a satellite's correction is not used
RECEIVER_NOISE = 0.3  # m, noise and multipath of one receiver that others do not share, each of the two parts
AGES, FEWEST_PAIRS = 16, 5  # ages of `growth`; pairs of corrections of a satellite for one of them
#: Elevation below which the base makes no corrections; where its noise stops growing is `LOWEST_ELEVATION`.
MASK = np.deg2rad(5.0)


@dataclass(frozen=True)
class Corrections:
    """Range corrections of a base, one row a satellite and epoch of the base.

    Attributes
    ----------
    base : the base's pseudoranges, the rows that have a correction
    position : (3,) of the base, ECEF [m]
    value : (n,) to be taken off a pseudorange [m]
    rate : (n,) of the correction [m/s]
    variance : (n,) of the correction's noise [m^2]
    measured : (n,) the same as `value`, of one epoch alone, without the line through the others [m]
    clock : (epochs, clocks) receiver clock error of the base times c [m]
    """

    base: Pseudoranges
    position: FloatArray
    value: FloatArray
    rate: FloatArray
    variance: FloatArray
    measured: FloatArray
    clock: FloatArray


def corrections(
    base: Pseudoranges,
    position: FloatArray,
    effects: Iterable[str] = tuple(MODELLED),
    lowest: float = MASK,
    past: bool = False,
    window: float = SMOOTHING,
) -> Corrections:
    """Corrections and their rates from the ranges of a base.

    The base's clock, one a constellation, is the weighted mean of what remains at each epoch; it is taken off, so that
    a clock that jumps leaves no mark on the rates.

    Parameters
    ----------
    base : pseudoranges of the base
    position : (3,) known position, ECEF [m]
    effects : names of the effects that are modelled at both ends
    lowest : elevation [rad]
    past : from what was measured until then alone, as a base that sends must
    window : length of the straight lines [s]
    """
    everywhere = np.broadcast_to(position, (len(base.t), 3))
    elevation = circumstances(base, everywhere).covariates["elevation"]
    base = base.rows(elevation > lowest)
    if not len(base):
        raise InputError(base.where, "no satellite in sight of the base position", "the base's ECEF position in metres")
    elevation = elevation[elevation > lowest]
    distance = np.linalg.norm(base.position - position, axis=1)
    value = base.value - distance - modelled(base, everywhere, effects)
    variance = receiver_variance(base, elevation)
    measured, clock = without_clock(base, value, variance)
    value, rate = straight_lines(base, measured, past, window)
    return Corrections(base, position, value, rate, variance, measured, clock)


def receiver_variance(ranges: Pseudoranges, elevation: FloatArray) -> FloatArray:
    """(n,) variance of what two receivers do not share, a receiver: noise and multipath (a^2 + b^2 / sin^2 E) [m^2]."""
    sine = np.sin(np.maximum(elevation, LOWEST_ELEVATION))
    return np.asarray(RECEIVER_NOISE**2 * (1.0 + 1.0 / sine**2))


def without_clock(base: Pseudoranges, value: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Take the weighted mean of each epoch and receiver clock off; also the (epochs, clocks) means."""
    group, names = base.clock_groups()
    key = base.epoch * len(names) + group
    size = len(base.t) * len(names)
    weight = np.bincount(key, 1.0 / variance, minlength=size)
    mean = np.bincount(key, value / variance, minlength=size) / np.where(weight > 0.0, weight, np.nan)
    return value - mean[key], mean.reshape(len(base.t), len(names))


def straight_lines(
    base: Pseudoranges, value: FloatArray, past: bool = False, window: float = SMOOTHING
) -> tuple[FloatArray, FloatArray]:
    """(n,) value and (n,) slope [m], [m/s] of a straight line through the corrections around each one.

    The line goes through the corrections of the same satellite and navigation message within half the window to either
    side, or with `past` a whole window before it: it averages the base's noise, and its slope is the rate. With fewer
    than three of them the value stays as it is and the rate counts as zero.
    """
    smooth, rate = value.copy(), np.zeros(len(base))
    t = base.time
    before, after = (window + 1e-6, 1e-6) if past else (window / 2.0, window / 2.0)
    for name in np.unique(base.satellite).tolist():
        of_satellite = np.flatnonzero(base.satellite == name)
        for message in np.unique(base.message[of_satellite]).tolist():
            rows = of_satellite[base.message[of_satellite] == message]
            time, offset = t[rows] - t[rows[0]], value[rows[0]]
            y = value[rows] - offset
            sums = np.cumsum(np.stack([np.ones_like(time), time, y, time * time, time * y]), axis=1)
            sums = np.concatenate([np.zeros((5, 1)), sums], axis=1)
            first = np.searchsorted(time, time - before, side="left")
            last = np.searchsorted(time, time + after, side="right")
            n, st, sy, stt, sty = sums[:, last] - sums[:, first]
            spread = n * stt - st**2
            enough = (n >= FEWEST_FOR_RATE) & (spread > 0.0)
            slope = np.divide(n * sty - st * sy, spread, out=np.zeros_like(spread), where=enough)
            rate[rows] = slope
            smooth[rows] = np.where(enough, offset + sy / n + slope * (time - st / n), value[rows])
    return smooth, rate


@dataclass(frozen=True)
class Growth:
    """What a correction gains in variance with its age.

    Attributes
    ----------
    age : (k,) rising, the first is zero [s]
    variance : (k,) beyond the base's noise, which `Corrections.variance` has [m^2]
    """

    age: FloatArray
    variance: FloatArray

    def at(self, age: FloatArray) -> FloatArray:
        """(n,) [m^2] at ages of either sign [s]; beyond the last age as there."""
        return np.asarray(np.interp(np.abs(age), self.age, self.variance))


def growth(given: Corrections, rate: bool = True, longest: float = LONGEST_AGE) -> Growth:
    """How wrong the base's own corrections are by an age: each predicts what the base measures later.

        D(a) = mean (measured(t + a) - value(t) - rate(t) a)^2 - 2 s_b^2,    growth(a) = max of 0 and D(a'), a' <= a

    s_b^2 is the base's own noise, of the reading and of the correction, which counts already. What the line through
    the past does not follow remains: satellite clocks, orbits, air, and the noise of its rate. The mean is that of the
    median satellite, so that one at fault counts for nothing.

    Parameters
    ----------
    given : corrections, those of a base that sends: of its past alone
    rate : whether corrections are aged by their rate
    longest : age [s]
    """
    base = given.base
    steps = np.diff(base.t)
    interval = float(np.median(steps)) if len(steps) else longest
    lags = np.append(0.0, np.unique(np.round(np.geomspace(1.0, max(longest / interval, 1.0), AGES))) * interval)
    table = [_prediction_error(given, name, lags, interval, rate) for name in np.unique(base.satellite).tolist()]
    seen = np.array(table).reshape(-1, len(lags))
    known = np.isfinite(seen).any(axis=0)
    if not known.any():
        return Growth(np.zeros(1), np.zeros(1))
    D = np.nanmedian(seen[:, known], axis=0)
    return Growth(lags[known], np.maximum.accumulate(np.maximum(D, 0.0)))


def _prediction_error(given: Corrections, name: str, lags: FloatArray, interval: float, rate: bool) -> FloatArray:
    """(k,) D of one satellite at each age [m^2]; NaN where it has too few pairs of readings so far apart."""
    base = given.base
    rows = np.flatnonzero(base.satellite == name)
    t, message = base.time[rows], base.message[rows]
    found = np.full(len(lags), np.nan)
    for k, lag in enumerate(lags.tolist()):
        later = np.minimum(np.searchsorted(t, t + lag - 0.5 * interval), len(t) - 1)
        pair = (np.abs(t[later] - t - lag) < 0.25 * interval) & (message[later] == message)
        a, b = rows[pair], rows[later[pair]]
        if len(a) >= FEWEST_PAIRS:
            aged = given.rate[a] * lag if rate else 0.0
            square = (given.measured[b] - given.value[a] - aged) ** 2
            found[k] = np.mean(square - given.variance[a] - given.variance[b])
    return found


@dataclass(frozen=True)
class Applied:
    """Corrections brought to the rows of a rover.

    Attributes
    ----------
    value : (n,) to be taken off the rover's pseudoranges [m]; NaN where the base has none that is young enough
    age : (n,) rover's time minus time of the correction [s]
    variance : (n,) of a corrected pseudorange [m^2], without what the distance adds
    """

    value: FloatArray
    age: FloatArray
    variance: FloatArray


def apply(given: Corrections, rover: Pseudoranges, navigation: Navigation, longest_age: float = LONGEST_AGE) -> Applied:
    """The correction that is nearest in time for each of the rover's rows, aged by its rate to the rover's own time.

    Where base and rover use different navigation messages of one satellite, the correction is computed anew with the
    rover's.

    Raises
    ------
    InputError : no correction is within `longest_age` of any of the rover's epochs
    """
    row, age = nearest(given, rover)
    usable = np.abs(age) <= longest_age
    if not usable.any():
        raise InputError(
            given.base.where,
            f"no satellite and epoch within {longest_age:g} s of those of {rover.where}",
            "a base and a rover with common satellites and epochs",
        )
    i = row[usable]
    value, total_age, variance = (np.full(len(rover), np.nan) for _ in range(3))
    value[usable] = given.value[i] + given.rate[i] * age[usable] + other_message(given, i, rover, usable, navigation)
    total_age[usable] = age[usable]
    variance[usable] = given.variance[i] + growth(given).at(age[usable])
    return Applied(value, total_age, variance)


def nearest(given: Corrections, rover: Pseudoranges) -> tuple[IntArray, FloatArray]:
    """(n,) row of the nearest correction in time of the same satellite, -1 where there is none; (n,) its age."""
    base = given.base
    row = np.full(len(rover), -1)
    age = np.full(len(rover), np.nan)
    t_base = base.time + (base.week - rover.week) * WEEK
    t_rover = rover.time
    for name in np.intersect1d(base.satellite, rover.satellite).tolist():
        theirs = np.flatnonzero(base.satellite == name)
        mine = np.flatnonzero(rover.satellite == name)
        times = t_base[theirs]
        chosen = np.searchsorted(0.5 * (times[1:] + times[:-1]), t_rover[mine])  # of two as near the earlier
        row[mine] = theirs[chosen]
        age[mine] = t_rover[mine] - times[chosen]
    return row, age


def other_message(
    given: Corrections, i: IntArray, rover: Pseudoranges, usable: BoolArray, navigation: Navigation
) -> FloatArray:
    """(rows,) what the correction changes when it is computed with the rover's navigation message [m]."""
    base = given.base
    change = np.zeros(len(i))
    wanted = rover.message[usable]
    differs = np.flatnonzero(wanted != base.message[i])
    rows = i[differs]
    states = satellite_states(
        navigation, base.satellite[rows], base.week, base.time[rows], base.value[rows], wanted[differs]
    )

    def geometry(position: FloatArray, clock: FloatArray) -> FloatArray:
        return np.asarray(SPEED_OF_LIGHT * clock - np.linalg.norm(position - given.position, axis=1))

    change[differs] = geometry(states.position, states.clock) - geometry(base.position[rows], base.clock[rows])
    return change


def corrected_variance(
    rover: Pseudoranges, applied: Applied, elevation: FloatArray, ionosphere: FloatArray, baseline: float
) -> FloatArray:
    """(n,) variance of a corrected pseudorange [m^2]: both receivers, and what the distance leaves of the ionosphere.

    What is particular to a ray of the ionosphere that the model leaves changes over the correlation length L: two
    receivers at the distance d share all but d / L of it.

    Parameters
    ----------
    rover : n rows
    applied : corrections on these rows
    elevation : (n,) [rad]
    ionosphere : (n,) modelled slant delay [m]
    baseline : distance d to the base [m]
    """
    left = IONOSPHERE_RAY * ionosphere * min(1.0, baseline / IONOSPHERE_LENGTH)
    return np.asarray(receiver_variance(rover, elevation) + np.nan_to_num(applied.variance) + left**2)


def common_left(left: FloatArray, baseline: float) -> FloatArray:
    """(n, 3) what a correction leaves of the ionosphere's common error: the field's change over the base line [m].

    Parameters
    ----------
    left : (n, 3) what the model leaves, of `sensors.pseudorange.ionosphere_left`
    baseline : distance to the base [m]
    """
    return left * min(1.0, baseline / IONOSPHERE_LENGTH)
