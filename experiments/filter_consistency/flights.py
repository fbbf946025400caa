"""NIS of every sensor and the p-value of every candidate effect, on flights that lack nothing.

Under a filter that tells the truth the innovations are white with the covariance it states, so that each effect's
statistic is chi-square and its p-value uniform. The scores sum thousands of readings: they see a flaw of 0.5 % that the
NIS hides.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sinan.estimator.evidence.alpha import ALPHA
from sinan.estimator.evidence.score import statistic_of
from sinan.experiments.filter_consistency.scenarios import matched_scenarios
from sinan.experiments.monte_carlo.study import FAMILY_LEVEL, averaged
from sinan.experiments.residual_loop.open_flight import flight_source
from sinan.sensors.recording import Recording
from sinan.sensors.scenario import Scenario
from sinan.sensors.simulate import simulate

FLIGHTS = 200
NIS_MARGIN = 0.02  # of the average NIS of each sensor about 1


@dataclass(frozen=True)
class Scored:
    """One clean flight.

    Attributes
    ----------
    scenario : that was flown
    nis : by sensor, sum of squares and its dof
    effects : by candidate, (statistic, dof, scatter, p-value as it is, p-value after the scatter)
    """

    scenario: str
    nis: Mapping[str, tuple[float, int]]
    effects: Mapping[str, tuple[float, int, float, float, float]]


def score(recording: Recording, scenario: str) -> Scored:
    """The plain filter over a recording, and every candidate about it."""
    source = flight_source(recording, slow_gps=False)  # of the filter, not of what else the trace knows
    fit = source.fit(())
    evidence = source.evidence(fit)
    effects = {}
    for entry in source.candidates:
        s = statistic_of(evidence, entry.name)
        effects[entry.name] = (s.statistic, s.dof, s.scatter, float(np.exp(s.log_p)), s.p_value)
    nis = {r.stream: (float(np.sum(r.whitened**2)), int(np.sum(r.dof))) for r in source.residuals(fit)}
    return Scored(scenario, nis, effects)


def fly(
    flights: int = FLIGHTS,
    seed: int = 0,
    scenarios: Mapping[str, Scenario] | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[Scored]:
    """Clean flights, the scenarios in turn, each with a seed of its own."""
    scenarios = matched_scenarios() if scenarios is None else scenarios
    names, scored = list(scenarios), []
    for k in range(flights):
        name = names[k % len(names)]
        recording, _ = simulate(scenarios[name], np.random.default_rng([seed, k]))
        scored.append(score(recording, name))
        progress(k + 1, flights)
    return scored


def nis_table(scored: Sequence[Scored]) -> dict[str, dict[str, Any]]:
    """By sensor: average NIS per dof, its interval at the family-wise level, and whether it lies within the margin."""
    sensors = sorted({name for flight in scored for name in flight.nis})
    family = 1.0 - (1.0 - FAMILY_LEVEL) / len(sensors)
    table = {}
    for name in sensors:
        parts = [flight.nis[name] for flight in scored if name in flight.nis]
        table[name] = averaged(sum(p[0] for p in parts), sum(p[1] for p in parts), family)
        table[name]["flights"] = len(parts)
        table[name]["within"] = abs(table[name]["mean_per_dof"] - 1.0) <= NIS_MARGIN
    return table


def uniformity(scored: Sequence[Scored]) -> dict[str, dict[str, Any]]:
    """By effect: Kolmogorov and Smirnov's distance of the p-values from uniform, and the p-value of that.

    Flights in which an effect cannot be seen at all (dof 0, p = 1) do not count.
    """
    from scipy import stats

    names = sorted({name for flight in scored for name in flight.effects})
    table = {}
    for name in names:
        seen = [flight.effects[name] for flight in scored if name in flight.effects and flight.effects[name][1] > 0]
        if not seen:
            continue
        values = np.array(seen)
        plain, divided = (stats.kstest(values[:, column], "uniform") for column in (3, 4))
        table[name] = {
            "flights": len(seen),
            "statistic_per_dof": float(np.sum(values[:, 0]) / np.sum(values[:, 1])),
            "scatter": float(np.mean(values[:, 2])),
            "below_5_percent": float(np.mean(values[:, 4] < 0.05)),
            "distance": float(divided.statistic),
            "p_value": float(divided.pvalue),
            "p_value_plain": float(plain.pvalue),
        }
    level = (1.0 - FAMILY_LEVEL) / max(len(table), 1)
    for entry in table.values():
        entry["uniform"] = min(entry["p_value"], entry["p_value_plain"]) > 0.5 * level
    return table


def false_alarms(scored: Sequence[Scored], alpha: float = ALPHA) -> int:
    """Flights in which some candidate passes at family-wise error alpha."""
    return sum(any(e[4] < alpha / len(flight.effects) for e in flight.effects.values()) for flight in scored)


def report(scored: Sequence[Scored]) -> dict[str, Any]:
    """The whole study as JSON."""
    flown = [flight.scenario for flight in scored]
    return {
        "format": 1,
        "flights": len(scored),
        "scenarios": {name: flown.count(name) for name in sorted(set(flown))},
        "nis": nis_table(scored),
        "effects": uniformity(scored),
        "false_alarms": false_alarms(scored),
    }


def table(document: Mapping[str, Any]) -> str:
    """The study as Markdown."""
    lines = ["| sensor | flights | dof | NIS a dof | interval | within 0.02 |", "| --- | --- | --- | --- | --- | --- |"]
    for name, e in document["nis"].items():
        low, high = e["family_interval"]
        within = "yes" if e["within"] else "no"
        lines.append(
            f"| {name} | {e['flights']} | {e['dof']} | {e['mean_per_dof']:.4f} | {low:.4f} to {high:.4f} | {within} |"
        )
    lines += ["", "| effect | flights | chi-square a dof | scatter | p < 5 % | KS distance | KS p, plain | KS p |"]
    lines.append("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for name, e in document["effects"].items():
        marked = name if e["uniform"] else f"**{name}**"
        cells = [f"{e['statistic_per_dof']:.2f}", f"{e['scatter']:.2f}", f"{100 * e['below_5_percent']:.1f} %"]
        cells += [f"{e[key]:.3f}" for key in ("distance", "p_value_plain", "p_value")]
        lines.append(f"| {marked} | {e['flights']} | " + " | ".join(cells) + " |")
    lines.append(
        f"\n{document['false_alarms']} of {document['flights']} flights with a candidate beyond 1 % family-wise"
    )
    return "\n".join(lines)
