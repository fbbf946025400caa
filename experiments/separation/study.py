"""Which effects look alike in which manoeuvre: the table behind the advice of an ambiguous verdict.

    python -m sinan.experiments.separation.study [OUT.json]

flies every scenario of the catalogue once, with nothing missing, and scores all candidates jointly. Two candidates are
told apart by the squared canonical correlation r^2 of their signatures
(`estimator.evidence.score.squared_correlation`) with nothing else given: the right name leads the wrong one by lambda
(1 - r^2) in 2 log L. Pairs above `CLASS_BOUND` in some scenario are kept, with r^2 and the smallest detectable sizes
of both, each given the other, in every scenario that sees both.

The information hardly depends on the noise that is drawn, so one flight a scenario is enough: another seed moves r^2 by
some hundredths where it is not near 0 or 1. Scenarios that lack sensors of the common set (accel, gyro, mag, baro,
sonar, laser, gps) are flown as they are and, where a multicopter flies them, with that set as well: pairs of sensors
that a scenario lacks would else have no manoeuvre there. `motion.wind` needs a drag that is declared: where `level` is
on, a third run declares it.

Neglects time-localised effects, whose signature depends on the interval, and outliers, which have none.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from sinan.estimator.evidence.score import Evidence, squared_correlation, statistic_of
from sinan.estimator.filter.flight import Flight
from sinan.experiments.residual_loop.manoeuvre import CLASS_BOUND, TABLE
from sinan.experiments.scenarios import load_scenario, scenario_names
from sinan.sensors.files import write_text
from sinan.sensors.scenario import Scenario
from sinan.sensors.simulate import simulate

#: The sensors with which all scenarios can be compared.
COMMON = ("accel", "gyro", "mag", "baro", "sonar", "laser", "gps")
SEED = 1  # of the one flight a scenario


@dataclass(frozen=True)
class Run:
    """One way to make a recording for the table.

    Attributes
    ----------
    key : how the table calls it
    scenario : with the sensors that it has in this run
    declared : effects that the recording declares
    """

    key: str
    scenario: Scenario
    declared: dict[str, list[float]]

    @property
    def is_flight(self) -> bool:
        """Whether a filter runs on it; else a calibration."""
        return self.scenario.kind == "flight"

    @property
    def is_advised(self) -> bool:
        """Whether it can be asked for: neither a shaken vehicle nor an instrument beyond the common ones."""
        return not any(self.scenario.vibration.amplitude) and set(self.scenario.sensors) <= set(COMMON)


def runs() -> list[Run]:
    """Every scenario as it is; those that lack common sensors also with these, and with a declared drag."""
    instruments = load_scenario("figure_eight").sensors
    found = []
    for name in scenario_names():
        scenario = load_scenario(name)
        found.append(Run(name, scenario, {}))
        if scenario.kind == "flight" and scenario.turns is None and not set(COMMON) <= set(scenario.sensors):
            drag = [scenario.air.drag]
            found.append(Run(f"{name} (drag declared)", scenario, {"motion.rotor_drag": drag}))
            full = scenario.replace(sensors={s: instruments[s] for s in COMMON})
            found.append(Run(f"{name} (all sensors)", full, {}))
    return found


def evidence_of(run: Run) -> list[Evidence]:
    """Information of all candidates, of a flight jointly, of poses sensor by sensor."""
    from sinan.estimator.evidence.flights.source import FlightSource
    from sinan.estimator.evidence.source import Source
    from sinan.experiments.residual_loop.open_source import pose_source, sensors_in_poses

    recording, _ = simulate(run.scenario, np.random.default_rng(SEED), run.declared, declare=True)
    sources: list[Source]
    if run.is_flight:
        sources = [FlightSource(Flight.of(recording))]
    else:
        sensors = [s for s in sensors_in_poses(recording) if _calibrates(run.scenario, s)]
        sources = [pose_source(recording, sensor) for sensor in sensors]
    return [source.evidence(source.fit(())) for source in sources]


def _calibrates(scenario: Scenario, sensor: str) -> bool:
    """Whether the poses are made for the sensor: with a gyroscope, static poses tell the accelerometer's attitude."""
    return sensor in scenario.sensors and (sensor != "accel" or "gyro" not in scenario.sensors)


def seen_from(evidence: Evidence, name: str, given: str | None = None) -> float | None:
    """Smallest detectable size in plausible sizes, the median over the components; None: most are not seen at all."""
    sizes = statistic_of(evidence, name, [] if given is None else [given]).detectable_from
    typical = float(np.median(sizes / evidence.plausible[evidence.columns(name)]))
    return float(f"{typical:.2g}") if np.isfinite(typical) else None


def pairs_in(evidence: Evidence, seen: Sequence[str]) -> dict[tuple[str, str], list[float | None]]:
    """r^2 of every pair that is seen, and the smallest detectable size of each given the other."""
    found: dict[tuple[str, str], list[float | None]] = {}
    for first, second in combinations(sorted(seen), 2):
        r2 = squared_correlation(evidence, first, second)
        sizes = [seen_from(evidence, first, second), seen_from(evidence, second, first)]
        found[first, second] = [round(r2, 4), *sizes]
    return found


def table() -> dict[str, Any]:
    """The table: what each scenario sees, and the pairs above the bound in some scenario with their figures in all."""
    scenarios: dict[str, Any] = {}
    pairs: dict[tuple[str, str], dict[str, list[float | None]]] = {}
    for run in runs():
        scenario = run.scenario
        sees: dict[str, float] = {}
        for evidence in evidence_of(run):
            sizes = {str(name): seen_from(evidence, name) for name in evidence.names}
            seen = {name: size for name, size in sizes.items() if size is not None}
            sees |= seen
            for pair, figures in pairs_in(evidence, tuple(seen)).items():
                pairs.setdefault(pair, {})[run.key] = figures
        scenarios[run.key] = {
            "scenario": scenario.name,
            "kind": scenario.kind,
            "summary": scenario.summary,
            "sensors": list(scenario.sensors),
            "advised": run.is_advised,
            "sees": sees,
        }
    alike = {p: where for p, where in sorted(pairs.items()) if max(f[0] or 0.0 for f in where.values()) > CLASS_BOUND}
    return {
        "bound": CLASS_BOUND,
        "seed": SEED,
        "common_sensors": list(COMMON),
        "scenarios": scenarios,
        "pairs": [{"effects": list(pair), "in": where} for pair, where in alike.items()],
    }


def written(document: dict[str, Any]) -> str:
    """The table as JSON, one scenario and one pair a line, so that a change shows in a difference of files."""
    scenarios = ",\n".join(f"{json.dumps(key)}: {json.dumps(value)}" for key, value in document["scenarios"].items())
    pairs = ",\n".join(json.dumps(pair) for pair in document["pairs"])
    head = json.dumps({key: document[key] for key in ("bound", "seed", "common_sensors")})[:-1]
    return f'{head},\n"scenarios": {{\n{scenarios}}},\n"pairs": [\n{pairs}]}}\n'


def main(arguments: list[str]) -> None:
    """Compute the table and write it, by default where it is shipped."""
    out = Path(arguments[0]) if arguments else TABLE
    document = table()
    write_text(out, written(document))
    sys.stdout.write(
        f"{len(document['pairs'])} pairs above {CLASS_BOUND} in {len(document['scenarios'])} runs: {out}\n"
    )


if __name__ == "__main__":
    main(sys.argv[1:])
