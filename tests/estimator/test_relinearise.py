"""Readings that are linear about the smoothed motion: what they cure, and that both engines hold them alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sinan.estimator.evidence.consistency import nees
from sinan.estimator.evidence.sensitivity import sensitivity_pass
from sinan.estimator.filter.effect_forms import Along, Terms, linear_form, reference_motion
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.engine_filterpy import ReadableFilter
from sinan.estimator.filter.events import collect
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import flight_model
from sinan.estimator.filter.imu import imu_table
from sinan.estimator.filter.inputs import outputs_for, prepare
from sinan.estimator.filter.layout import DTHETA, Q_NB, StateLayout
from sinan.estimator.filter.relinearise import is_coarse, run_relinearised
from sinan.estimator.filter.run_filter import run_filter
from sinan.experiments.scenarios.loader import load_scenario
from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects import effect
from sinan.sensors.recording import Stream
from sinan.sensors.rotation import quaternion_exp, quaternion_multiply, rotate_back
from sinan.sensors.simulate import simulate
from tests.estimator.analytic_flight import fly
from tests.estimator.test_engines import AGREEMENT, difference

RUNS = 8
QUATERNION = ("qw", "qx", "qy", "qz")


def attitude_error(layout: StateLayout, truth: Stream, x: FloatArray) -> FloatArray:
    """(3,) dtheta_b at the end."""
    true = x.copy()
    true[Q_NB] = truth.array(QUATERNION)[-1]
    return layout.difference(true, x)[DTHETA]


def test_engines_agree_about_a_reference() -> None:
    recording, _ = fly(5, duration=3.0)
    model = flight_model(recording, gate_level=None)
    journal = run_filter(Flight(recording, model), engine="numba")
    motion = reference_motion(journal, Terms(), journal.run.imu)
    forms = {name: linear_form(Along(Flight(recording, model), Terms(), motion), name) for name in model.sensors}
    inputs = prepare(Flight(recording, model), events=collect(Flight(recording, model), forms))
    assert difference(run(inputs, "numba"), run(inputs, "filterpy")) < AGREEMENT


def test_a_coarse_heading_is_cured() -> None:
    """Hand-held, aligned through an unknown hard iron: only the plain filter's attitude is off its sigma."""
    plain, cured = [], []
    for seed in range(RUNS):
        recording, truth = simulate(load_scenario("no_aiding"), np.random.default_rng(100 + seed))
        model = flight_model(recording)
        for results, runner in ((plain, run_filter), (cured, run_relinearised)):
            journal = runner(Flight(recording, model), engine="numba", stride=0)
            error = attitude_error(model.layout, truth, journal.x_end)
            results.append(nees(error, journal.P_end[DTHETA, DTHETA]) / 3.0)
    assert np.mean(plain) > 2.0
    assert np.mean(cured) < 1.7  # 24 degrees of freedom: 99 % lie below 1.8


def test_a_good_start_needs_no_cure() -> None:
    recording, _ = fly(6, duration=10.0)
    model = flight_model(recording)
    plain, again = (runner(Flight(recording, model), engine="numba") for runner in (run_filter, run_relinearised))
    sigma = np.sqrt(np.diag(plain.P_end))
    assert np.max(np.abs(model.layout.difference(again.x_end[None], plain.x_end[None])[0]) / sigma) < 0.5


def test_it_holds_declared_effects() -> None:
    """The same flight with and without a current's field, the field declared: the same states."""
    scenario = load_scenario("hover_rough_start").replace(truth_rate=0.0)
    plain, _ = simulate(scenario, np.random.default_rng(7))
    field = {"mag.current": (0.002, -0.001, 0.003), "gps.latency": (0.1,)}
    declared, _ = simulate(scenario, np.random.default_rng(7), field, declare=True)
    ends = [run_relinearised(Flight.of(r), engine="numba", stride=0) for r in (plain, declared)]
    sigma = np.sqrt(np.diag(ends[0].P_end))
    moved = ends[0].model.layout.difference(ends[1].x_end[None], ends[0].x_end[None])[0] / sigma
    assert np.max(np.abs(moved)) < 0.2


def test_sensitivities_are_those_of_the_relinearised_filter() -> None:
    """Innovations with and without a small effect in the model, along one motion, differ by S_beta beta."""
    recording, _ = simulate(load_scenario("no_aiding"), np.random.default_rng(101))
    model = flight_model(recording, gate_level=None, relinearise=True)
    journal = run_relinearised(Flight(recording, model), engine="numba", stride=0)
    motion = reference_motion(journal, Terms(), imu_table(Flight(recording, model)))
    names, beta = ("mag.declination", "mag.cross_axis", "gyro.temperature"), 1e-5
    _, found = sensitivity_pass(Flight(recording, model), names, motion=motion, keep_rows=1, stride=0)
    for name in names:
        step = np.full(effect(name).size, beta)
        ends = []
        for sign in (1.0, -1.0):
            terms = Terms.of({name: sign * step})
            first = (journal.run.x, journal.run.P)
            along = Along(Flight(recording, model), terms, motion, first=first)
            ends.append(run(along.inputs, "numba", 0).white)
        slope = (ends[1] - ends[0]) / 2.0
        predicted = found.rows[:, found.of(name)] @ step
        assert np.max(np.abs(slope - predicted)) < 0.05 * np.max(np.abs(predicted))


def test_a_long_gap_makes_the_attitude_coarse() -> None:
    recording, _ = fly(8, duration=20.0)
    imu = recording.streams["imu"]
    holed = recording.replace(streams={**recording.streams, "imu": imu.rows((imu.t < 6.0) | (imu.t > 14.0))})
    assert not is_coarse(Flight.of(recording))
    assert is_coarse(Flight.of(holed))


def test_a_beam_above_the_horizon_has_no_prediction() -> None:
    recording, _ = fly(9, duration=3.0)
    model = flight_model(recording, relinearise=True)
    journal = run_filter(Flight(recording, model.replace(relinearise=False)), engine="numba")
    table = imu_table(Flight(recording, model))
    motion = reference_motion(journal, Terms(), table)
    over = (motion.t > 1.0) & (motion.t < 2.0)
    motion = replace(motion, q_nb=np.where(over[:, None], np.array([0.0, 1.0, 0.0, 0.0]), motion.q_nb))
    after = run(Along(Flight(recording, model), Terms(), motion, table).inputs, "numba")
    assert np.all(np.isfinite(after.x_end))
    assert after.counts()["laser"]["no prediction"] >= 18


def test_nothing_is_learnt_of_heading_and_field_turned_together() -> None:
    """Body and field turned about the vertical by the same angle change no reading of a magnetometer: so says H, also
    where the field was found to be another than believed, and the filter's own attitude is off.
    """
    recording, _ = fly(13, duration=2.0)
    model = flight_model(recording, field=0.1 * np.eye(3)).replace(relinearise=True)
    plain = run_filter(Flight(recording, model.replace(relinearise=False)), engine="numba")
    motion = reference_motion(plain, Terms(), plain.run.imu)
    found = model.m_n + np.array([-0.2, 0.3, 0.1])
    inputs = Along(Flight(recording, model), Terms(), replace(motion, m_n=found[None])).inputs
    engine, layout = ReadableFilter(inputs, outputs_for(inputs)), model.layout
    engine.x[Q_NB] = quaternion_multiply(engine.x[Q_NB], quaternion_exp(np.array([0.05, -0.1, 0.2])))
    down = np.array([0.0, 0.0, 1.0])
    for k in np.flatnonzero(inputs.events.sensor == inputs.events.sensors.index("mag"))[::20]:
        _, H = engine.prediction("mag", int(k))
        D = inputs.events.D[inputs.events.row[k] : inputs.events.row[k + 1], DTHETA]
        body = D @ rotate_back(inputs.events.ref[k, Q_NB], down)
        assert np.allclose(body + H[:, layout.slice("field")] @ np.cross(down, found), 0.0, atol=1e-12)


def test_engines_agree_about_a_reference_in_an_unsure_field() -> None:
    recording, _ = fly(14, duration=3.0)
    model = flight_model(recording, gate_level=None, field=0.1 * np.eye(3)).replace(relinearise=True)
    fast, slow = (
        run_relinearised(Flight(recording, model), engine=engine, passes=2) for engine in ("numba", "filterpy")
    )
    assert difference(fast, slow) < AGREEMENT
