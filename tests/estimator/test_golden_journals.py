"""Journals of fixed recordings, kept as text in tests/golden: a change of the filter is reviewed as a diff."""

from __future__ import annotations

from collections.abc import Callable

import pytest

import sinan
from sinan.testing import Bounds

#: Simulated flights: scenario, effects that the recording declares, and so many seconds of it.
FLIGHTS = {
    "figure_eight": ({}, 20.0),
    "climb_descent": ({"mag.current": (0.003, 0.0, 0.001), "baro.airspeed": (0.02,)}, 20.0),
    "no_aiding_flight": ({}, 20.0),
}
STEP = 5.0  # s
#: A hand-held sensor that declares no noise: what is found of it is where a search ends, on every machine a little
#: elsewhere.
MEASURED, SECONDS = "broad_orientation/01_undisturbed_slow_rotation_A.mat", 15.0
SEARCHED = Bounds(innovation=0.05, nis=0.05, state=0.1, sigma=0.02)


@pytest.mark.parametrize("scenario", FLIGHTS)
def test_simulated_flights(scenario: str, journal_regression: Callable[..., None]) -> None:
    effects, seconds = FLIGHTS[scenario]
    flight = sinan.cut(sinan.simulate(scenario, seed=1, effects=effects, declare=bool(effects)), 0.0, seconds)
    journal_regression(sinan.estimate(flight, engine="numba"), scenario, every=STEP)


@pytest.mark.usefixtures("measured_data")
def test_a_measured_log(journal_regression: Callable[..., None]) -> None:
    log = sinan.read(MEASURED, start=0.0, stop=SECONDS)
    journal_regression(sinan.estimate(log, engine="numba"), "hand_held", bounds=SEARCHED, every=STEP)
