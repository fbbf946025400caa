"""The likeliest lateness, where log L goes up and down with the samples of the IMU."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.estimator.evidence.comb import best_tooth, whole_moves
from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.evidence.term import Term
from sinan.estimator.filter.flight import Flight
from sinan.experiments.scenarios import parse_effect
from sinan.sensors.simulate import simulate
from tests.flights import scenario_at

STEP = 0.02  # of an IMU of 50 Hz [s]


@pytest.mark.parametrize("lateness", [-0.12, 0.04, 0.16])
def test_the_highest_tooth_is_found_where_a_slope_ends_at_the_nearest(lateness: float) -> None:
    """A hill by 2 to 38 above the start, with teeth of 60: uphill from the first guess alone is no way there."""

    def value(x: float) -> float:
        return -0.5 * ((x - lateness) / 0.1) ** 2 * 30.0 - 30.0 * np.cos(2.0 * np.pi * x / STEP + np.pi)

    assert best_tooth(value, 0.0, whole_moves(0.2, STEP)) == pytest.approx(lateness, abs=1e-9)
    halves = [0.5**k * STEP / 4.0 for k in range(5)]
    assert best_tooth(value, 0.0, halves) == pytest.approx(0.0, abs=0.5 * STEP)  # a foot of the comb keeps it


def test_steps_end_where_a_sigma_is_no_shorter() -> None:
    asked: list[float] = []

    def value(x: float) -> float:
        asked.append(x)
        return -0.5 * (x - 0.3) ** 2

    best_tooth(value, 0.0, [4.0, 2.0, 1.0, 0.5, 0.25], narrowing=True)
    assert min(abs(a - b) for a in asked for b in asked if a != b) == 1.0


@pytest.mark.parametrize("declared", [False, True])
def test_a_lateness_of_a_flight_is_looked_for_from_another_tooth(declared: bool) -> None:
    scenario = scenario_at(50.0, "figure_eight")
    recording, _ = simulate(scenario, np.random.default_rng(3), [parse_effect("gps.latency=0.15")])
    source, term = FlightSource(Flight.of(recording), None if declared else recording), Term("gps.latency")
    fit = source.fit((term,))
    astray = replace(fit, beta={term: fit.beta[term] - 3.0 * STEP})
    moved, start = source.relocated(astray, term)
    assert moved == term
    assert start == pytest.approx(fit.beta[term], abs=1e-9)
    assert start == pytest.approx(0.15, abs=4.0 * float(fit.std[term][0]))
