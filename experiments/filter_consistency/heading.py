"""Where linearisation breaks: NEES over the 1-sigma of the first heading, of the plain filter and of the cure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.inputs import prepare
from sinan.estimator.filter.layout import DTHETA, Q_NB
from sinan.experiments.monte_carlo.one_flight import Score, fly, inputs_of, rng_of, scored
from sinan.experiments.monte_carlo.study import FAMILY_LEVEL, averaged
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.arrays import FloatArray
from sinan.sensors.rotation import quaternion_exp, quaternion_multiply
from sinan.sensors.simulate import simulate

RUNS = 40
SIGMAS = (2.0, 5.0, 10.0, 20.0, 30.0, 45.0, 60.0, 90.0)  # deg
HOVER_SIGMAS = (0.3, 0.6, 1.1, 1.7, 3.0, 6.0)  # deg
BLOCKS = ("overall", "attitude", "b_accel", "b_gyro", "b_mag")


def off_heading(flight: Flight, sigma: float, draw: float) -> tuple[FloatArray, FloatArray]:
    """The first state with its heading off by `draw` sigmas, and the covariance that says so.

    Parameters
    ----------
    sigma : rad
    """
    inputs = prepare(flight)
    x, P = inputs.x.copy(), inputs.P.copy()
    x[Q_NB] = quaternion_multiply(quaternion_exp(np.array([0.0, 0.0, sigma * draw])), x[Q_NB])
    w, a, b, c = x[Q_NB]
    down_b = np.array([2 * (a * c - w * b), 2 * (b * c + w * a), 1 - 2 * (a * a + b * b)])
    P[DTHETA, DTHETA] += sigma**2 * np.outer(down_b, down_b)
    return x, P


def study(
    runs: int = RUNS,
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda done, total: None,
    scenario: str = "figure_eight",
    sigmas: tuple[float, ...] = SIGMAS,
) -> dict[str, Any]:
    """A scenario flown from first headings of several 1-sigma, plain and relinearised."""
    base = load_scenario(scenario).replace(truth_rate=0.0)
    rows, done = [], 0
    for sigma in sigmas:
        flown: dict[bool, list[Score]] = {False: [], True: []}
        for run in range(runs):
            rng = rng_of(seed, run)
            recording, truth = simulate(base, rng)
            draw = float(rng.standard_normal())
            for cured, flights in flown.items():
                flight = Flight.of(recording, gate_level=None, relinearise=cured)
                first = off_heading(flight, float(np.deg2rad(sigma)), draw)
                flights.append(scored(inputs_of(flight, first), truth, run))
            done += 1
            progress(done, runs * len(sigmas))
        rows += [{"sigma": sigma, "relinearised": cured, **_averages(flights)} for cured, flights in flown.items()]
    return {"format": 1, "scenario": scenario, "runs": runs, "seed": seed, "rows": rows}


def hover_study(
    runs: int = RUNS,
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda done, total: None,
    sigmas: tuple[float, ...] = HOVER_SIGMAS,
) -> dict[str, Any]:
    """A hover, which nothing moves on from, from first attitudes of several 1-sigma about every axis."""
    base = load_scenario("hover").replace(truth_rate=0.0)
    rows, done = [], 0
    for sigma in sigmas:
        scenario = base.replace(initial=(1.0, 0.2, float(np.deg2rad(sigma))))
        for cured in (False, True):
            flights = []
            for run in range(runs):
                flights.append(fly(scenario, seed, run, cured))
                done += 1
                progress(done, 2 * runs * len(sigmas))
            rows.append({"sigma": sigma, "relinearised": cured, **_averages(flights)})
    return {"format": 1, "scenario": "hover", "runs": runs, "seed": seed, "rows": rows}


def _averages(flights: list[Score]) -> dict[str, Any]:
    """By block: mean NEES a dof at the end, its interval, and the median."""
    found = {}
    for name in BLOCKS:
        dof = 3 if name != "overall" else len(flights[0].error[0])
        values = np.array([flight.nees[name][-1] for flight in flights])
        found[name] = {
            **averaged(float(values.sum()), dof * len(values), FAMILY_LEVEL),
            "median_per_dof": float(np.median(values) / dof),
        }
    return found


def table(document: Mapping[str, Any]) -> str:
    """The study as Markdown."""
    heads = {"overall": "all states", "attitude": "attitude", "b_accel": "accel bias", "b_gyro": "gyro bias"}
    heads["b_mag"] = "mag bias"
    lines = ["| sigma | filter | " + " | ".join(heads.values()) + " |", "| --- " * (2 + len(heads)) + "|"]
    for row in document["rows"]:
        name = "relinearised" if row["relinearised"] else "plain"
        cells = []
        for block in heads:
            low, high = row[block]["family_interval"]
            text = f"{row[block]['mean_per_dof']:.2f}"
            cells.append(text if low <= row[block]["mean_per_dof"] <= high else f"**{text}**")
        lines.append(f"| {row['sigma']:g} deg | {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)
