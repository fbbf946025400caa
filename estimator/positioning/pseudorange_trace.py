"""From the plain pseudorange model to the one that the data call for, in the order of evidence.

1. Faults: about the model with every known effect, because what these explain is no fault. First those that come or
   change while the log runs, then those that are there all the time (`estimator.positioning.steady_fault`).
2. Effects: from the plain model on, without the faulty satellites, the strongest that passes is modelled at its known
   size, and all are scored again.
3. Proof: the last third of the time decides whether an effect of step 2 stays; the rest alone is asked, too.
4. A known position, where there is one, then shows what one epoch's residuals cannot: the rotation of the Earth moves
   every fix to the east and leaves the residuals nearly as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sinan.estimator.evidence.alpha import ALPHA
from sinan.estimator.evidence.score import Statistic
from sinan.estimator.positioning.location import Location, locate
from sinan.estimator.positioning.pseudoranges import Called, next_effect, next_fault, next_steady_fault
from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.pseudorange import Pseudoranges

#: Faults that are looked for: bound of work (`bounds_of_work ranges`).
MOST_FAULTS = 4


@dataclass(frozen=True)
class RangeTrace:
    """What was found in a recording of pseudoranges.

    Attributes
    ----------
    called : in the order of evidence; those that took a known position come last
    rolled_back : names of effects that did not improve the held-out residuals
    faulty : (n,) rows of faulty satellites from the onset on
    left : statistics of what was not called for by the ranges, about the last model
    same_on_fitting_part : whether the first two thirds alone call for the same effects
    """

    called: tuple[Called, ...]
    rolled_back: tuple[str, ...]
    faulty: BoolArray
    left: tuple[Statistic, ...]
    same_on_fitting_part: bool

    @property
    def verdict(self) -> str:
        """`no_effect`, `ambiguous` or `effects`."""
        if not self.called:
            return "no_effect"
        return "ambiguous" if self.called[0].confused_with else "effects"


def trace_ranges(
    ranges: Pseudoranges, mask: float, alpha: float = ALPHA, known_position: FloatArray | None = None
) -> RangeTrace:
    """Run the loop.

    Parameters
    ----------
    ranges : all rows
    mask : lowest elevation [rad]
    alpha : family-wise error
    known_position : (epochs, 3) ECEF [m], NaN where it is not known; None: nowhere
    """
    faults, faulty = find_faults(ranges, mask, alpha)
    effects, left = find_effects(ranges, mask, alpha, faulty)
    kept, dropped = keep_what_holds(ranges, mask, faulty, effects)
    on_fitting, _ = find_effects(ranges, mask, alpha, faulty, fitting=True)
    same = {c.name for c in on_fitting} == {c.name for c in effects}
    called = in_order(faults, kept)
    if known_position is not None and np.isfinite(known_position).any():
        modelled = [c.name for c in kept]
        called += find_effects(ranges, mask, alpha, faulty, known_position, modelled)[0]
    return RangeTrace(tuple(called), tuple(dropped), faulty, tuple(left), same)


def find_faults(ranges: Pseudoranges, mask: float, alpha: float) -> tuple[list[Called], BoolArray]:
    """Faults, strongest first, and the rows that they concern."""
    faulty = np.zeros(len(ranges), dtype=bool)
    found: list[Called] = []
    while len(found) < MOST_FAULTS:
        location = locate(ranges, mask=mask, excluded=faulty)
        keep = (location.elevation > mask) & ~faulty
        fault = next_fault(location, location.fixes.position, keep, alpha) or next_steady_fault(location, keep, alpha)
        if fault is None or fault.interval is None:
            break
        found.append(fault)
        faulty |= (ranges.satellite == fault.satellite) & (ranges.time - ranges.t[0] >= fault.interval[0])
    return found, faulty


def find_effects(
    ranges: Pseudoranges,
    mask: float,
    alpha: float,
    faulty: BoolArray,
    known_position: FloatArray | None = None,
    modelled: Sequence[str] = (),
    fitting: bool = False,
) -> tuple[list[Called], list[Statistic]]:
    """Forward selection from a model on; what was taken, and the statistics of the rest at the end."""
    names, found = list(modelled), list[Called]()
    while True:
        location = locate(ranges, names, mask=mask, exclude=False, excluded=faulty)
        position = location.fixes.position if known_position is None else known_position
        keep = (location.elevation > mask) & ~faulty
        effect, statistics = next_effect(location, position, keep, alpha, known_position is not None, fitting)
        if effect is None:
            return found, statistics
        names.append(effect.name)
        found.append(effect)


def keep_what_holds(
    ranges: Pseudoranges, mask: float, faulty: BoolArray, effects: Sequence[Called]
) -> tuple[list[Called], list[str]]:
    """Roll back effects that do not lower the weighted residuals of the last third of the time."""
    weights = locate(ranges, mask=mask, exclude=False, excluded=faulty).variance
    kept: list[Called] = []
    dropped: list[str] = []
    before = held_out_sse(locate(ranges, (), mask=mask, exclude=False, excluded=faulty, variance=weights))
    for effect in effects:
        names = [c.name for c in kept] + [effect.name]
        after = held_out_sse(locate(ranges, names, mask=mask, exclude=False, excluded=faulty, variance=weights))
        if after < before:
            kept.append(effect)
            before = after
        else:
            dropped.append(effect.name)
    return kept, dropped


def held_out_epochs(ranges: Pseudoranges) -> BoolArray:
    """(epochs,) the last third of the time."""
    t = ranges.t
    return np.asarray(t >= t[0] + 2.0 / 3.0 * (t[-1] - t[0]))


def held_out_sse(location: Location) -> float:
    """Weighted sum of squared residuals of the last third."""
    return float(np.nansum(location.fixes.sse[held_out_epochs(location.ranges)]))


def in_order(faults: Sequence[Called], effects: Sequence[Called]) -> list[Called]:
    """Effects in the order in which they were taken, each fault before the first effect with less evidence."""
    called = list(effects)
    for fault in faults:
        place = next(
            (k for k, c in enumerate(called) if c.statistic.statistic < fault.statistic.statistic), len(called)
        )
        called.insert(place, fault)
    return called
