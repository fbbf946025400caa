"""The study of one case: what is weak, what each manoeuvre and each sensor brings, what another flight would bring."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from sinan.estimator.evidence.observability import Course, Information, first_state_information, posterior
from sinan.experiments.bias_observability.case import Case
from sinan.experiments.bias_observability.catalogue import Catalogue, fly_catalogue
from sinan.experiments.bias_observability.directions import (
    HALVED,
    Direction,
    floor_of,
    physical,
    spectrum,
    weak_directions,
)
from sinan.experiments.bias_observability.segments import columns
from sinan.sensors.arrays import FloatArray

#: A state counts as seen when the readings halve its sigma.
SEEN = 0.5


@dataclass(frozen=True)
class Weakness:
    """A weak direction of some set of sensors.

    Attributes
    ----------
    direction : the direction
    sensors : with which it is weak
    removed_by : smallest sets of sensors that narrow the direction to half its prior sigma
    """

    direction: Direction
    sensors: tuple[str, ...]
    removed_by: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class BiasStudy:
    """What is learnt about one state.

    Attributes
    ----------
    label : of `StateLayout.labels`
    prior, carried, posterior : 1-sigma at the start; at the end without a reading; at the end
    halved_after : s until sigma is half the prior; None: not in this flight
    bits : by column of the manoeuvre table, log2(sigma before / sigma after)
    confused_with : the state with which its remaining error is correlated most, and that correlation
    needs : smallest sets of sensors that halve its sigma
    """

    label: str
    prior: float
    carried: float
    posterior: float
    halved_after: float | None
    bits: Mapping[str, float]
    confused_with: tuple[str, float]
    needs: tuple[tuple[str, ...], ...]

    @property
    def left(self) -> float:
        """Posterior over prior, both at the end of the flight."""
        return self.posterior / self.carried

    @property
    def brought_by(self) -> str | None:
        """The manoeuvre that brought the most, if any brought half a bit."""
        best = max(self.bits, key=lambda name: self.bits[name])
        return best if self.bits[best] >= 0.5 else None


@dataclass(frozen=True)
class Study:
    """Everything about one case.

    Attributes
    ----------
    case, found : the question, and the information along its motion
    subsets : of sensors; the first is all that are aboard
    course : posterior over time for every subset
    singular_values : (n,) of the first state's information, with all sensors aboard, in units of the prior
    physical_values : (n,) the same in physical units
    states : one a state
    weaknesses : of all sensors together, then those that appear where one sensor is taken away
    left : (subsets, n) posterior over prior at the end
    catalogue : what other flights with the same sensors would leave
    """

    case: Case
    found: Information
    subsets: tuple[tuple[str, ...], ...]
    course: Course
    singular_values: FloatArray
    physical_values: FloatArray
    states: tuple[BiasStudy, ...]
    weaknesses: tuple[Weakness, ...]
    left: FloatArray
    catalogue: Catalogue | None

    @property
    def rank(self) -> int:
        """Directions of the first state of which the readings say anything."""
        return int(np.sum(self.singular_values > floor_of(self.singular_values)))

    @property
    def strong(self) -> int:
        """Directions of the first state whose sigma the readings alone would halve."""
        return int(np.sum(self.singular_values >= HALVED))

    @property
    def biases(self) -> tuple[BiasStudy, ...]:
        """The states that are biases."""
        return tuple(state for state in self.states if state.label.startswith("b_"))

    def place_of(self, subset: tuple[str, ...]) -> int:
        """Row of a subset."""
        return self.subsets.index(tuple(name for name in self.found.readings if name in subset))


def all_subsets(case: Case) -> tuple[tuple[str, ...], ...]:
    """Every subset of the sensors, those aboard first; the base receiver only together with a GPS."""
    names = tuple(case.readings)
    made = [subset for size in range(len(names), -1, -1) for subset in combinations(names, size)]
    made = [subset for subset in made if "base" not in subset or "gps" in subset]
    made.remove(case.aboard)
    return (case.aboard, *made)


def study(case: Case, with_catalogue: bool = True) -> Study:
    """Study a case."""
    found = case.information()
    subsets = all_subsets(case)
    course = posterior(found, subsets)
    Lambda = first_state_information(found, subsets)
    carried = found.carried_prior(found.t[-1:])[0]
    left = course.sigma[:, -1] / carried
    values, _ = spectrum(Lambda[0])
    compared = with_catalogue and case.model.translation
    table = columns(case.segments)
    return Study(
        case=case, found=found, subsets=subsets, course=course, singular_values=values,
        physical_values=spectrum(physical(found, Lambda[0]))[0],
        states=tuple(_state(case, found, course, subsets, left, i, table) for i in range(len(found.scale))),
        weaknesses=_weaknesses(case, found, subsets, Lambda), left=left,
        catalogue=fly_catalogue(case, float(found.t[1] - found.t[0])) if compared else None,
    )  # fmt: skip


def _state(
    case: Case,
    found: Information,
    course: Course,
    subsets: tuple[tuple[str, ...], ...],
    left: FloatArray,
    i: int,
    table: Mapping[str, list[int]],
) -> BiasStudy:
    sigma = course.sigma[0, :, i]
    halved = np.flatnonzero(sigma <= 0.5 * sigma[0])
    rows = [(course.row_at(segment.start), course.row_at(segment.stop)) for segment in case.segments]
    gained = [float(np.log2(sigma[start] / sigma[stop])) for start, stop in rows]
    P = course.P_end[0]
    correlation = P[i] / np.sqrt(P[i, i] * np.diag(P))
    correlation[i] = 0.0
    other = int(np.argmax(np.abs(correlation)))
    return BiasStudy(
        label=found.labels[i],
        prior=float(sigma[0]),
        carried=float(sigma[-1] / left[0, i]),
        posterior=float(sigma[-1]),
        halved_after=float(course.t[halved[0]] - course.t[0]) if len(halved) else None,
        bits={name: float(sum(gained[k] for k in places)) for name, places in table.items()},
        confused_with=(found.labels[other], float(correlation[other])),
        needs=smallest({subset for subset, share in zip(subsets, left[:, i], strict=True) if share <= SEEN}),
    )


def smallest(sets: set[tuple[str, ...]]) -> tuple[tuple[str, ...], ...]:
    """The sets of which no other is a part, small ones first."""
    kept = [one for one in sets if not any(set(other) < set(one) for other in sets)]
    return tuple(sorted(kept, key=lambda one: (len(one), one)))


def _weaknesses(
    case: Case, found: Information, subsets: tuple[tuple[str, ...], ...], Lambda: FloatArray
) -> tuple[Weakness, ...]:
    """Weak directions with all sensors aboard, then the new ones with one of them away."""
    fewer = [tuple(other for other in case.aboard if other != name) for name in case.aboard]
    made: list[Weakness] = []
    for sensors in [case.aboard, *fewer]:
        if sensors not in subsets:  # a base receiver without its GPS
            continue
        absent = [name for name in (*found.readings, *case.model.sensors) if name not in sensors]
        for direction in weak_directions(found, Lambda[subsets.index(sensors)], absent):
            if direction.title in {known.direction.title for known in made}:
                continue
            seen = {
                subset
                for subset, matrix in zip(subsets, Lambda, strict=True)
                if float(direction.v @ matrix @ direction.v) >= HALVED
            }
            made.append(Weakness(direction, sensors, smallest(seen)))
    return tuple(made)
