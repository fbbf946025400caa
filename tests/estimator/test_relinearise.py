"""Readings that are linear about the smoothed motion: what they cure, and that both engines hold them alike."""

from __future__ import annotations

import numpy as np

from estimator.consistency import nees
from estimator.effect_forms import Terms, reference_motion
from estimator.events import collect
from estimator.filter import prepare, run, run_filter
from estimator.flight_model import flight_model
from estimator.layout import StateLayout
from estimator.relinearise import linear_form, run_relinearised
from experiments.scenarios.loader import load_scenario
from sensors.arrays import FloatArray
from sensors.recording import Stream
from sensors.simulate import simulate
from tests.estimator.analytic_flight import fly
from tests.estimator.test_engines import AGREEMENT, difference

RUNS = 8
QUATERNION = ("qw", "qx", "qy", "qz")


def attitude_error(layout: StateLayout, truth: Stream, x: FloatArray) -> FloatArray:
    """(3,) dtheta_b at the end."""
    true = x.copy()
    true[6:10] = truth.array(QUATERNION)[-1]
    return layout.difference(true, x)[6:9]


def test_engines_agree_about_a_reference() -> None:
    recording, _ = fly(5, duration=3.0)
    model = flight_model(recording, gate_level=None)
    journal = run_filter(recording, model, engine="numba")
    motion = reference_motion(recording, journal, Terms(), journal.run.imu)
    forms = {name: linear_form(recording, model, name, motion, Terms()) for name in model.sensors}
    inputs = prepare(recording, model, events=collect(recording, model, forms))
    assert difference(run(inputs, "numba"), run(inputs, "filterpy")) < AGREEMENT


def test_a_coarse_heading_is_cured() -> None:
    """Hand-held, aligned through an unknown hard iron: only the plain filter's attitude is off its sigma."""
    plain, cured = [], []
    for seed in range(RUNS):
        recording, truth = simulate(load_scenario("no_aiding"), np.random.default_rng(100 + seed))
        model = flight_model(recording)
        for results, runner in ((plain, run_filter), (cured, run_relinearised)):
            journal = runner(recording, model, engine="numba", stride=0)
            error = attitude_error(model.layout, truth, journal.x_end)
            results.append(nees(error, journal.P_end[6:9, 6:9]) / 3.0)
    assert np.mean(plain) > 2.0
    assert np.mean(cured) < 1.7  # 24 degrees of freedom: 99 % lie below 1.8


def test_a_good_start_needs_no_cure() -> None:
    recording, _ = fly(6, duration=10.0)
    model = flight_model(recording)
    plain, again = (runner(recording, model, engine="numba") for runner in (run_filter, run_relinearised))
    sigma = np.sqrt(np.diag(plain.P_end))
    assert np.max(np.abs(model.layout.difference(again.x_end[None], plain.x_end[None])[0]) / sigma) < 0.5
