"""From pseudoranges to positions: a coarse fix, then mask, weights and modelled effects until it rests, then tests."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from sinan.estimator.positioning.integrity import Integrity, check, worst_rows
from sinan.estimator.positioning.point_positioning import CONVERGED, EARTH_RADIUS, Fixes, solve
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.constants import SPEED_OF_LIGHT
from sinan.sensors.motion import Motion
from sinan.sensors.pseudorange import (
    IONOSPHERE_LEFT,
    MODELLED,
    Pseudoranges,
    circumstances,
    code_variance,
    ionosphere_left,
    sum_of,
)
from sinan.sensors.range_noise import RangeNoise

MOST_PASSES = 8  # of mask, weights and modelled effects: bound of work (`bounds_of_work ranges`)
MOST_EXCLUDED = 6  # satellites of one epoch: bound of work (`bounds_of_work ranges`)
#: 1-sigma of a pseudorange before any effect but the satellite clocks is modelled [m]: all rows have the same, so that
#: the weights say nothing (`bounds_of_work ranges`).
COARSE = 30.0
IONOSPHERE, CLOCK = "pseudorange.ionosphere", "pseudorange.satellite_clock"


@dataclass(frozen=True)
class Location:
    """Fixes of a recording together with what they were computed from.

    Attributes
    ----------
    ranges : the pseudoranges, all rows
    fixes : position, clocks, residuals
    clock_names : the system of each receiver clock
    clock_group : (n,) number of the clock of each row
    effects : modelled effects, by name
    delay : (n,) sum of the modelled effects [m]
    variance : (n,) [m^2]
    elevation : (n,) [rad]
    integrity : tests and protection levels
    excluded : (n,) rows above the mask that a test took out
    """

    ranges: Pseudoranges
    fixes: Fixes
    clock_names: tuple[str, ...]
    clock_group: IntArray
    effects: tuple[str, ...]
    delay: FloatArray
    variance: FloatArray
    elevation: FloatArray
    integrity: Integrity
    excluded: BoolArray


def locate(
    ranges: Pseudoranges,
    effects: Iterable[str] = tuple(MODELLED),
    *,
    mask: float = np.deg2rad(10.0),
    exclude: bool = True,
    start: FloatArray | None = None,
    correction: FloatArray | None = None,
    variance: FloatArray | None = None,
    common: FloatArray | None = None,
    excluded: BoolArray | None = None,
    noise: RangeNoise | None = None,
) -> Location:
    """Fix every epoch: coarse position, then mask, weights and modelled effects there, until the position rests.

    Parameters
    ----------
    ranges : all rows
    effects : names of the effects to model at their full size; none: the plain model
    mask : lowest elevation [rad]
    exclude : test every epoch and leave out satellites that fail
    start : (3,) where to begin [m]; the Earth's centre if not given
    correction : (n,) further metres to take off the pseudoranges, such as those of a base; NaN leaves a row out
    variance : (n,) instead of `code_variance` [m^2]
    common : (n, k) with `variance`: errors that the rays have in common, 1-sigma a column [m]
    excluded : (n,) rows to leave out from the beginning
    noise : law of the errors instead of that of `code_variance`; without `variance`
    """
    names = tuple(effects)
    group, clock_names = ranges.clock_groups()
    z = ranges.value - (0.0 if correction is None else np.nan_to_num(correction))
    rays = _Rays(ranges, z, group, max(len(clock_names), 1))
    allowed = np.ones(len(ranges), dtype=bool) if excluded is None else ~excluded
    allowed &= True if correction is None else np.isfinite(correction)
    clock = -SPEED_OF_LIGHT * ranges.clock if CLOCK in names else np.zeros(len(ranges))
    position = filled(rays.coarse(allowed, clock, start, exclude).position)
    for _ in range(MOST_PASSES):
        motion = circumstances(ranges, position)
        delay = sum_of(motion, names)
        elevation = motion.covariates["elevation"]
        weight, field = (variance, common) if variance is not None else _noise(ranges, motion, names, noise)
        result = rays.fixes(allowed & (elevation > mask), delay, weight, position, field)
        moved = np.nan_to_num(np.abs(result.position - position)).max(initial=0.0)
        position = np.where(np.isfinite(result.position), result.position, position)
        if not moved > 10.0 * CONVERGED:
            break
    above = allowed & (elevation > mask)
    again = functools.partial(rays.fixes, delay=delay, weight=weight, begin=position, field=field)
    most = MOST_EXCLUDED if exclude else 0
    used, result, checks = exclude_faults(again, above, result, ranges, group, weight, field, most)
    return Location(
        ranges,
        result,
        clock_names,
        group,
        names,
        delay,
        weight,
        elevation,
        checks,
        above & ~used,
    )


@dataclass(frozen=True)
class _Rays:
    """Pseudoranges z (n,) [m], corrected where they are to be, and the receiver clock of each."""

    ranges: Pseudoranges
    z: FloatArray
    group: IntArray
    clocks: int

    def fixes(
        self,
        used: BoolArray,
        delay: FloatArray,
        weight: FloatArray,
        begin: FloatArray | None,
        field: FloatArray | None = None,
    ) -> Fixes:
        """Every epoch by the rows that are used, less delays [m], with variances [m^2] and errors in common [m]."""
        return solve(
            self.ranges.position,
            self.z - delay,
            self.ranges.epoch,
            len(self.ranges.t),
            clock_group=self.group,
            clocks=self.clocks,
            variance=weight,
            used=used,
            start=begin,
            field=field,
        )

    def coarse(self, allowed: BoolArray, clock: FloatArray, start: FloatArray | None, exclude: bool) -> Fixes:
        """Without any effect but the satellites' clocks, (n,) [m]: near enough to know the elevations."""
        begin = first_position(self.ranges, self.z - clock, self.group, allowed) if start is None else start
        variance = np.full(len(self.ranges), COARSE**2)
        found = self.fixes(allowed, clock, variance, begin)
        if not exclude:
            return found
        again = functools.partial(self.fixes, delay=clock, weight=variance, begin=begin)
        return exclude_faults(again, allowed, found, self.ranges, self.group, variance, None, MOST_EXCLUDED)[1]


def _noise(
    ranges: Pseudoranges, motion: Motion, names: tuple[str, ...], noise: RangeNoise | None
) -> tuple[FloatArray, FloatArray | None]:
    """(n,) variance [m^2], and (n, k) what a modelled ionosphere leaves in common [m]; None without it."""
    elevation = motion.covariates["elevation"]
    if IONOSPHERE not in names:
        return code_variance(ranges, elevation, np.zeros(len(ranges)), noise), None
    ionosphere = sum_of(motion, [IONOSPHERE])
    share = IONOSPHERE_LEFT if noise is None else noise.field
    return code_variance(ranges, elevation, ionosphere, noise), ionosphere_left(motion, ionosphere, share)


def first_position(ranges: Pseudoranges, z: FloatArray, group: IntArray, allowed: BoolArray) -> FloatArray | None:
    """(3,) where to begin: the fix of the epoch with the most satellites, from the Earth's centre; None: none."""
    count = np.bincount(ranges.epoch[allowed], minlength=len(ranges.t))
    rows = np.flatnonzero((ranges.epoch == int(np.argmax(count))) & allowed)
    zero = np.zeros(len(rows), dtype=np.int64)
    fix = solve(ranges.position[rows], z[rows], zero, 1, clock_group=group[rows], clocks=int(group.max(initial=0)) + 1)
    return fix.position[0] if fix.solved[0] else None


def filled(position: FloatArray) -> FloatArray:
    """(epochs, 3) with the last known position where there is none; the first known one before it."""
    known = np.flatnonzero(np.isfinite(position[:, 0]))
    if not len(known):
        return np.broadcast_to(np.array([EARTH_RADIUS, 0.0, 0.0]), position.shape).copy()
    latest = np.searchsorted(known, np.arange(len(position)), side="right") - 1
    return np.asarray(position[known[np.maximum(latest, 0)]])


def exclude_faults(
    solver: Callable[[BoolArray], Fixes],
    used: BoolArray,
    result: Fixes,
    ranges: Pseudoranges,
    group: IntArray,
    variance: FloatArray,
    field: FloatArray | None,
    most: int,
) -> tuple[BoolArray, Fixes, Integrity]:
    """Leave out, epoch by epoch, the satellite with the largest w until the test passes.

    With a redundancy of one all w are equal: an error is seen but cannot be ascribed, and nothing is left out.

    Parameters
    ----------
    solver : fixes with the given rows
    used, result : rows, and the fixes with them
    ranges, group, variance, field : of the fixes
    most : satellites that are left out of one epoch
    """
    used = used.copy()
    checks = check(result, ranges.position, ranges.epoch, group, variance, field)
    for _ in range(most):
        worst = worst_rows(checks, result, ranges.epoch)
        if not len(worst):
            break
        used[worst] = False
        result = solver(used)
        checks = check(result, ranges.position, ranges.epoch, group, variance, field)
    return used, result, checks
