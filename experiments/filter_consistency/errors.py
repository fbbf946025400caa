"""NEES of every block in every scenario, against the truth at the end of each flight.

The averages of all scenarios and blocks together are held against chi-square intervals at the family-wise level
(Bonferroni). Scenarios whose world is not the filter's are listed with what they show, outside the family.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.relinearise import is_coarse
from sinan.experiments.filter_consistency.scenarios import why_not
from sinan.experiments.monte_carlo.one_flight import cramer_rao, fly, rng_of
from sinan.experiments.monte_carlo.study import FAMILY_LEVEL, MonteCarlo, averaged, label
from sinan.experiments.scenarios import load_scenario, scenario_names
from sinan.sensors.scenario import Scenario
from sinan.sensors.simulate import simulate

RUNS = 100


def from_coarse(scenario: Scenario) -> bool:
    """Whether the scenario's first attitude calls for readings linear about the smoothed motion."""
    recording, _ = simulate(scenario, rng_of(0, 0))
    return is_coarse(Flight.of(recording))


def study(
    runs: int = RUNS, seed: int = 0, progress: Callable[[int, int], None] = lambda done, total: None
) -> dict[str, Any]:
    """Every flight scenario with the plain filter, and with the cure where its first attitude is coarse."""
    scenarios = {name: load_scenario(name) for name in scenario_names()}
    scenarios = {name: scenario for name, scenario in scenarios.items() if scenario.kind == "flight"}
    coarse = {name: from_coarse(scenario) for name, scenario in scenarios.items()}
    rows = [(name, cured) for name in scenarios for cured in ((False, True) if coarse[name] else (False,))]
    done, entries = 0, []
    for name, cured in rows:
        flown = []
        for run in range(runs):
            flown.append(fly(scenarios[name], seed, run, cured))
            done += 1
            progress(done, runs * len(rows))
        result = MonteCarlo(name, seed, tuple(flown), cramer_rao(scenarios[name], seed))
        reason = why_not(scenarios[name])
        if reason is None and coarse[name]:
            reason = "flown from an attitude too coarse to linearise about: shows where that breaks"
        entries.append(_entry(result, cured, reason))
    return judged({"format": 1, "runs": runs, "seed": seed, "rows": entries})


def _entry(result: MonteCarlo, cured: bool, reason: str | None) -> dict[str, Any]:
    runs = len(result.flights)
    nees = {name: (float(np.sum(result.nees(name)[:, -1])), runs * result.size(name)) for name in result.blocks}
    overall = (float(np.sum(result.nees("overall")[:, -1])), runs * result.size("overall"))
    return {"scenario": result.scenario, "relinearised": cured, "outside": reason, "overall": overall, "blocks": nees}


def judged(document: dict[str, Any]) -> dict[str, Any]:
    """The averages with their intervals at the family-wise level, and those that lie outside."""
    family = [entry for entry in document["rows"] if entry["outside"] is None]
    tests = sum(1 + len(entry["blocks"]) for entry in family)
    level = 1.0 - (1.0 - FAMILY_LEVEL) / max(tests, 1)
    found = []
    for entry in document["rows"]:
        entry["overall"] = averaged(entry["overall"][0], entry["overall"][1], level)
        entry["blocks"] = {label(name): averaged(total, dof, level) for name, (total, dof) in entry["blocks"].items()}
        if entry["outside"] is None:
            for name, value in {"overall": entry["overall"], **entry["blocks"]}.items():
                low, high = value["family_interval"]
                if not low <= value["mean_per_dof"] <= high:
                    found.append(f"{entry['scenario']}, {name}: {value['mean_per_dof']:.3f}")
    return {**document, "tests": tests, "level": level, "beyond": found}


def table(document: Mapping[str, Any]) -> str:
    """The study as Markdown."""
    blocks = list(dict.fromkeys(name for entry in document["rows"] for name in entry["blocks"]))
    lines = ["| scenario | all states | " + " | ".join(blocks) + " |", "| --- " * (2 + len(blocks)) + "|"]
    for entry in document["rows"]:
        name = entry["scenario"] + (", relinearised" if entry["relinearised"] else "")
        name = f"*{name}*" if entry["outside"] else name
        values = [entry["blocks"].get(block) for block in blocks]
        cells = [_cell(entry["overall"]), *("" if value is None else _cell(value) for value in values)]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    beyond = "; ".join(document["beyond"]) or "none"
    lines.append(f"\n{document['tests']} averages of {document['runs']} flights each; beyond their interval: {beyond}")
    outside = {e["scenario"]: e["outside"] for e in document["rows"] if e["outside"]}
    lines += [f"- *{name}*: {reason}" for name, reason in outside.items()]
    return "\n".join(lines)


def _cell(value: Mapping[str, Any]) -> str:
    low, high = value["family_interval"]
    text = f"{value['mean_per_dof']:.2f}"
    return text if low <= value["mean_per_dof"] <= high else f"**{text}**"
