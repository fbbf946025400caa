"""Differential positions: a base at a known position against a rover, in ranges and in positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sinan.estimator.positioning.location import Location, locate
from sinan.sensors import dgps
from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.data_link import DataLink, apply_link
from sinan.sensors.formats.rinex_navigation import Navigation
from sinan.sensors.formats.rinex_text import WEEK
from sinan.sensors.pseudorange import Pseudoranges, circumstances, ionosphere_left, sum_of

#: Effects whose difference between two receivers is geometry and broadcast data, not a guess about the air.
CERTAIN = (
    "pseudorange.satellite_clock",
    "pseudorange.earth_rotation",
    "pseudorange.relativity",
    "pseudorange.group_delay",
)
#: Delays whose modelled difference is applied where the rover's residuals call for it.
DELAYS = ("pseudorange.troposphere", "pseudorange.ionosphere")
CALLED = 6.635  # drop of the weighted sum of squares: chi-square of one at 1 %
IONOSPHERE = "pseudorange.ionosphere"


@dataclass(frozen=True)
class Differential:
    """Rover positions with the corrections of a base.

    Attributes
    ----------
    location : fixes from corrected ranges
    effects : whose difference between both ends is modelled
    age : (n,) of the correction of each row [s], NaN where there is none
    baseline : from the base to the rover's mean fix from corrected ranges [m]
    by_position : (epochs, 3) rover fix minus the base's position error, ECEF [m]; NaN where either is missing
    """

    location: Location
    effects: tuple[str, ...]
    age: FloatArray
    baseline: float
    by_position: FloatArray


def differential(
    rover: Pseudoranges,
    base: Pseudoranges,
    base_position: FloatArray,
    navigation: Navigation,
    mask: float,
    link: DataLink | None = None,
) -> Differential:
    """Correct the rover by the base.

    The differences of geometry and satellite are always modelled. Those of troposphere and ionosphere are models of
    what two places do not share; each is kept if it lowers the weighted residuals of the corrected ranges by more
    than chance. Over a short base line none of them does, and none matters.

    Parameters
    ----------
    rover, base : pseudoranges
    base_position : (3,) ECEF [m]
    navigation : messages, for satellites of which base and rover have chosen different ones
    mask : lowest elevation [rad]
    link : by which the corrections come; None: all of them are there, the nearest in time is taken
    """
    alone = locate(rover, mask=mask)
    fixed = np.nanmean(alone.fixes.position, axis=0)
    where = np.where(np.isfinite(alone.fixes.position), alone.fixes.position, fixed)
    baseline = float(np.linalg.norm(fixed - base_position))
    ionosphere = sum_of(circumstances(rover, where), [IONOSPHERE])
    names: tuple[str, ...] = CERTAIN
    given = (rover, base, base_position, navigation, mask)
    best, applied = corrected(*given, names, alone, ionosphere, baseline, where, link)
    for delay in DELAYS:
        trial, _ = corrected(*given, (*names, delay), alone, ionosphere, baseline, where, link)
        if np.nansum(best.fixes.sse) - np.nansum(trial.fixes.sse) > CALLED:
            best, names = trial, (*names, delay)
    by_position = position_domain(rover, base, base_position, applied, mask, best.fixes.used)
    seen = best.fixes.position if np.any(best.fixes.solved) else alone.fixes.position
    baseline = float(np.linalg.norm(np.nanmean(seen, axis=0) - base_position))
    return Differential(best, names, applied.age, baseline, by_position)


def corrected(
    rover: Pseudoranges,
    base: Pseudoranges,
    base_position: FloatArray,
    navigation: Navigation,
    mask: float,
    effects: Sequence[str],
    alone: Location,
    ionosphere: FloatArray,
    baseline: float,
    where: FloatArray,
    link: DataLink | None = None,
) -> tuple[Location, dgps.Applied]:
    """Fixes from corrected ranges with some effects modelled at both ends."""
    if link is None:
        applied = dgps.apply(dgps.corrections(base, base_position, effects), rover, navigation)
    else:
        applied = apply_link(base, base_position, link, rover, navigation, tuple(effects))
    variance, common = dgps.corrected_variance(rover, applied, alone.elevation, ionosphere, baseline), None
    if baseline > 1000.0:
        common = dgps.common_left(ionosphere_left(circumstances(rover, where), ionosphere), baseline)
    location = locate(rover, effects, mask=mask, correction=applied.value, variance=variance, common=common)
    return location, applied


def position_domain(
    rover: Pseudoranges,
    base: Pseudoranges,
    base_position: FloatArray,
    applied: dgps.Applied,
    mask: float,
    used: BoolArray,
) -> FloatArray:
    """(epochs, 3) the rover's fix minus the base's position error at the nearest epoch, from the same satellites.

    The base's error is an observation of the bias that both fixes share; it is one only if both use the same satellites
    with the same weights.
    """
    t_rover = rover.t + (rover.week - base.week) * WEEK
    after = np.clip(np.searchsorted(base.t, t_rover), 1, max(len(base.t) - 1, 1))
    after = np.minimum(after, len(base.t) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(t_rover - base.t[before]) <= np.abs(base.t[after] - t_rover), before, after)
    rows = used & np.isfinite(applied.value)
    pairs = set(zip(nearest[rover.epoch[rows]].tolist(), rover.satellite[rows].tolist(), strict=True))
    common = np.array([pair in pairs for pair in zip(base.epoch.tolist(), base.satellite.tolist(), strict=True)])
    if not common.any():
        return np.full((len(rover.t), 3), np.nan)
    at_base = locate(base, excluded=~common, mask=-np.pi, exclude=False)
    at_rover = locate(rover, excluded=~rows, mask=mask, exclude=False)
    error = at_base.fixes.position - base_position
    late = np.abs(t_rover - base.t[nearest]) > dgps.LONGEST_AGE
    return np.where(late[:, None], np.nan, at_rover.fixes.position - error[nearest])
