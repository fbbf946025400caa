"""Which manoeuvre to fly: the same sensors and prior along every flight of the scenario catalogue, for equally long."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from sinan.estimator.evidence.observability import Information, first_state_information, information, posterior
from sinan.experiments.bias_observability.case import Case
from sinan.experiments.bias_observability.directions import HALVED
from sinan.experiments.scenarios import load_scenario, scenario_names
from sinan.sensors.arrays import FloatArray
from sinan.sensors.scenario import Scenario

#: Rate at which the motions are sampled [Hz]; readings and noise keep their own densities.
RATE = 50.0
#: Cells are as long as those of the case, within these bounds [s]: a comparison need not resolve everything.
SHORTEST_CELL, LONGEST_CELL = 0.05, 0.4
#: Flights shorter than this are left out, so that the others can be compared over a useful time [s].
SHORTEST = 30.0


@dataclass(frozen=True)
class Catalogue:
    """What each flight of the catalogue leaves of every state.

    Attributes
    ----------
    names, summaries : of the scenarios
    horizon : s that each is flown
    labels : of the states
    left : (scenarios, n) posterior over prior at the horizon
    halved_after : (scenarios, n) s until sigma halves; NaN: not within the horizon
    information : (scenarios, n, n) about the first state, in units of the prior sigmas
    """

    names: tuple[str, ...]
    summaries: tuple[str, ...]
    horizon: float
    labels: tuple[str, ...]
    left: FloatArray
    halved_after: FloatArray
    information: FloatArray

    def best(self, label: str) -> tuple[str, float]:
        """The flight that leaves least of a state, and how much."""
        column = self.left[:, self.labels.index(label)]
        k = int(np.argmin(column))
        return self.names[k], float(column[k])

    def shows(self, v: FloatArray) -> tuple[tuple[str, float], ...]:
        """Flights that narrow a direction (n,) to half its prior sigma: name and share left, the best first."""
        seen = np.einsum("i,kij,j->k", v, self.information, v)
        order = [int(k) for k in np.argsort(-seen) if seen[k] >= HALVED]
        return tuple((self.names[k], float(1.0 / np.sqrt(1.0 + seen[k]))) for k in order)


def flights() -> list[Scenario]:
    """The scenarios that are flown; those that are about other sensors fly nothing new."""
    loaded = [load_scenario(name) for name in scenario_names()]
    flown = [one for one in loaded if one.kind == "flight" and one.manoeuvres and one.duration >= SHORTEST]
    usual = Counter(frozenset(one.sensors) for one in flown).most_common(1)[0][0]
    return [one for one in flown if set(one.sensors) == usual]


def fly_catalogue(case: Case, cell: float) -> Catalogue:
    """Fly every scenario with the sensors, noise and prior of a case, all for as long as the shortest of them lasts.

    Parameters
    ----------
    case : the case
    cell : length of its cells [s]
    """
    cell = float(np.clip(2.0 * cell, SHORTEST_CELL, LONGEST_CELL))
    chosen = distinct(flights())
    horizon = min(scenario.duration for scenario in chosen)
    left, halved, Lambda = [], [], []
    for scenario in chosen:
        found = along(case, scenario, horizon, cell)
        course = posterior(found, [case.aboard])
        sigma = course.sigma[0]
        left.append(sigma[-1] / found.carried_prior(found.t[-1:])[0])
        reached = sigma <= 0.5 * sigma[0]
        first = np.argmax(reached, axis=0)
        Lambda.append(first_state_information(found, [case.aboard])[0])
        halved.append(np.where(reached.any(axis=0), course.t[first] - course.t[0], np.nan))
    names, summaries = zip(*[(scenario.name, scenario.summary) for scenario in chosen], strict=True)
    return Catalogue(names, summaries, horizon, found.labels, np.array(left), np.array(halved), np.array(Lambda))


def distinct(scenarios: list[Scenario]) -> list[Scenario]:
    """One of each flight: scenarios that differ in their sensors or circumstances only are the same motion."""
    kept: dict[str, Scenario] = {}
    for scenario in scenarios:
        kept.setdefault(repr((scenario.manoeuvres, scenario.start, scenario.smoothing)), scenario)
    return list(kept.values())


def along(case: Case, scenario: Scenario, horizon: float, cell: float) -> Information:
    """The sensors of a case along the start of a scenario's motion, in the case's own gravity and field; what a sensor
    has told once it tells in every reading.
    """
    model = case.model
    placed = scenario.replace(gravity=float(model.g_n[2]), magnetic_field=tuple(model.m_n), ground_down=0.0)
    motion = placed.trajectory().motion(np.linspace(0.0, horizon, round(horizon * RATE) + 1))
    readings = {}
    for name in case.aboard:
        instants = np.arange(0.5 / case.rates[name], horizon, 1.0 / case.rates[name])
        readings[name] = instants[case.heard[name](motion.at(instants))] if name in case.heard else instants
    told = {name: np.tile(np.any(case.told[name], axis=0), (len(readings[name]), 1)) for name in case.told}
    return information(model, motion, readings, case.P0, told=told, cell=cell)
