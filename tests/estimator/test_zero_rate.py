"""A body at rest does not turn: what the filter makes of it, by other derivations."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import sinan
from sinan.calibration.levels import zero_rate
from sinan.calibration.levels.levels import has_its_own_north
from sinan.calibration.levels.zero_rate import TURNS, zero_rate_of
from sinan.estimator.evidence.flights.passes import FlightPasses
from sinan.estimator.evidence.level_scores import level_scores
from sinan.estimator.evidence.sensitivity import sensitivity_pass
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import FlightModel, Stray, flight_model
from sinan.estimator.filter.inputs import prepare
from sinan.estimator.filter.layout import DTHETA, Q_NB
from sinan.estimator.filter.run_filter import run_filter
from sinan.estimator.filter.smoother import smooth
from sinan.experiments.refused import doubted_shares
from sinan.sensors.arrays import FloatArray
from sinan.sensors.bounds import Bounds
from sinan.sensors.noise import sample_std
from sinan.sensors.recording import ACCEL, GYRO, MAG, Initial, Recording, SensorSpec, Stream
from sinan.sensors.rotation import quaternion_conjugate, quaternion_log, quaternion_multiply
from sinan.sensors.zero_rate import ZeroRate
from tests.estimator.test_engines import AGREEMENT, difference

RATE, BIAS, REST, END = 100.0, np.array([0.01, -0.02, 0.015]), 20.0, 40.0
DENSITIES = {"gyro": 2e-4, "accel": 2e-3}
FIELD = np.array([0.2, 0.0, 0.4])
SIGMA = DENSITIES["gyro"] * np.ones(3)  # of a mean over one second
WALK = 1e-4


@cache
def turned(vibration: float = 0.0) -> tuple[Recording, FloatArray]:
    """Twenty seconds at rest, or shaken so much [rad/s], and twenty of turns about the vertical; the heading."""
    rng = np.random.default_rng(3)
    t = np.arange(0.0, END, 1.0 / RATE)
    moves = np.maximum(t - REST, 0.0)
    heading, w = 1.2 * (1.0 - np.cos(moves)), 1.2 * np.sin(moves)
    gyro = np.stack([0.0 * t, 0.0 * t, w], axis=1) + BIAS
    accel = np.stack([0.3 * np.sin(3.0 * moves), 0.2 * np.sin(2.0 * moves), -9.8 + 0.0 * t], axis=1)
    gyro = gyro + (sample_std(DENSITIES["gyro"], RATE) + vibration) * rng.standard_normal(gyro.shape)
    accel = accel + (sample_std(DENSITIES["accel"], RATE) + 30.0 * vibration) * rng.standard_normal(accel.shape)
    field = np.stack([FIELD[0] * np.cos(heading), -FIELD[0] * np.sin(heading), FIELD[2] + 0.0 * t], axis=1)
    mag = field[::10] + 0.01 * rng.standard_normal((len(t[::10]), 3))
    streams = {
        "imu": Stream(t, dict(zip((*ACCEL, *GYRO), np.concatenate([accel, gyro], axis=1).T, strict=True))),
        "mag": Stream(t[::10], dict(zip(MAG, mag.T, strict=True))),
    }
    return Recording("turned", "flight", streams), heading


def model_of(recording: Recording, walk: float = WALK, **passed: Any) -> FlightModel:
    specs = {
        "accel": SensorSpec(noise_density=DENSITIES["accel"], bias_std=0.05, bias_walk=1e-3),
        "gyro": SensorSpec(noise_density=DENSITIES["gyro"], bias_std=0.02, bias_walk=walk),
        "mag": SensorSpec(noise_std=0.01, bias_std=0.01, bias_walk=0.0),
    }
    given = {"magnetic_field": FIELD, "bounds": Bounds(0.5, 1.0), "gate_level": None, **passed}
    return flight_model(recording, specs=specs, **given)


def seconds(first: int, last: int) -> ZeroRate:
    """Windows of a second each."""
    begin = np.arange(first, last) + 0.0
    return ZeroRate(begin, begin + 0.99, SIGMA)


def test_what_lies_on_a_table_is_at_rest_and_what_is_held_or_shaken_is_not() -> None:
    found = zero_rate_of(turned()[0])
    assert found is not None
    assert np.array_equal(found[0].begin, np.arange(20.0))
    assert np.allclose(found[0].sigma, SIGMA, rtol=0.5)
    assert found[1].share < 0.1
    assert zero_rate_of(turned(vibration=0.05)[0]) is None


def test_an_axis_that_shows_no_noise_has_that_of_the_others() -> None:
    recording = turned()[0]
    imu = recording.streams["imu"]
    coarse = np.where(imu.t < REST, BIAS[0], imu["gyro_x"])
    streams = {**recording.streams, "imu": Stream(imu.t, {**imu.columns, "gyro_x": coarse})}
    recording = recording.replace(streams=streams)
    found = zero_rate_of(recording)
    assert found is not None
    assert len(found[0].end) == REST
    assert found[0].sigma[0] == max(found[0].sigma) > 0.0


@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("name", ["WINDOW", "MEAN", "GYRO_NOISE", "ACCEL_NOISE", "DECADES"])
def test_half_and_twice_of_what_is_taken_find_the_same_rest(
    name: str, factor: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zero_rate, name, factor * getattr(zero_rate, name))
    found = zero_rate_of(turned()[0])
    assert found is not None
    at_rest = found[0].end - found[0].begin
    assert np.sum(at_rest) == pytest.approx(REST, abs=2.0)
    assert np.max(found[0].end) <= REST
    assert zero_rate_of(turned(vibration=0.05)[0]) is None


@pytest.mark.parametrize(("factor", "seconds_at_most"), [(0.5, 0), (2.0, 2)])
def test_of_the_spread_twice_takes_two_shaken_seconds_for_rest(
    factor: float, seconds_at_most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zero_rate, "SPREAD", factor * zero_rate.SPREAD)
    found, shaken = zero_rate_of(turned()[0]), zero_rate_of(turned(vibration=0.05)[0])
    assert found is not None
    assert len(found[0].end) == REST
    assert (0 if shaken is None else len(shaken[0].end)) <= seconds_at_most


@pytest.mark.parametrize("turns", [0.5 * TURNS, TURNS, 2.0 * TURNS])
def test_a_smooth_turn_at_a_constant_rate_has_no_weight(turns: float) -> None:
    recording, _ = turned()
    imu = recording.streams["imu"]
    turning = {"gyro_z": imu["gyro_z"] + np.where((imu.t >= 10.0) & (imu.t < REST), 0.1, 0.0)}
    recording = recording.replace(streams={"imu": Stream(imu.t, {**imu.columns, **turning})})
    model = model_of(recording, zero_rate=seconds(0, 20), tail=4.0, stray={"zero_rate": Stray(0.05, turns)})
    weight = run_filter(Flight(recording, model), engine="numba").stream("zero_rate").weight
    early, late = np.split(weight, 2)
    assert np.all(early > 0.9)
    assert np.all(late < 1e-6)


def test_the_bias_is_known_from_rest_and_the_heading_after_it() -> None:
    recording, heading = turned()
    sure, unsure = (Flight(recording, model_of(recording, zero_rate=z)) for z in (seconds(0, 20), None))
    with_rest, without = (run_filter(flight, engine="numba") for flight in (sure, unsure))
    b = sure.model.layout.slice("b_gyro")
    at = int(np.searchsorted(with_rest.imu_t, REST))
    known, vague = (np.sqrt(one.imu_var[at, b]) for one in (with_rest, without))
    assert np.all(np.abs(with_rest.imu_x[at, sure.model.layout.nominal("b_gyro")] - BIAS) < 4.0 * known)
    assert known[2] < 0.6 * vague[2]
    errors = []
    for one in (with_rest, without):
        yaw = 2.0 * np.arctan2(one.imu_x[at:, Q_NB][:, 3], one.imu_x[at:, Q_NB][:, 0])
        errors.append(np.ptp(np.angle(np.exp(1j * (yaw - heading[at:])))))
    assert errors[0] < 0.75 * errors[1]


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("name", ["OF_GRAVITY", "ATTITUDE_TIME"])
def test_the_bias_of_one_attitude_is_not_that_of_others(
    name: str, factor: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Gravity adds 0.06 deg/s to the vertical rate at rest, and nothing afterwards."""
    monkeypatch.setattr(f"sinan.sensors.zero_rate.{name}", factor * getattr(sinan.sensors.zero_rate, name))
    recording, _ = turned()
    imu = recording.streams["imu"]
    more = {"gyro_z": imu["gyro_z"] + np.where(imu.t < REST, 1e-3, 0.0)}
    recording = recording.replace(streams={**recording.streams, "imu": Stream(imu.t, {**imu.columns, **more})})
    flight = Flight(recording, model_of(recording, zero_rate=seconds(0, 20)))
    journal, layout = run_filter(flight, engine="numba"), flight.model.layout
    at = int(np.searchsorted(journal.imu_t, REST)) - 1
    sigma = np.sqrt(journal.imu_var[at, layout.slice("b_gyro")][2])
    assert abs(journal.imu_x[at, layout.nominal("b_gyro")][2] - BIAS[2]) < 4.0 * sigma
    assert sigma < 1e-3


def test_engines_agree_and_a_turn_is_no_rest() -> None:
    recording, _ = turned()
    law: dict[str, Any] = {"tail": 4.0, "stray": {"zero_rate": Stray(0.05, 2.0)}}
    model = model_of(recording, zero_rate=seconds(15, 30), **law)
    fast, slow = (run_filter(Flight(recording, model), engine=engine) for engine in ("numba", "filterpy"))
    assert difference(fast, slow) < AGREEMENT
    weight = fast.stream("zero_rate").weight
    assert np.all(weight[:5] > 0.9)
    before = run_filter(Flight(recording, model_of(recording, **{**law, "zero_rate": seconds(0, 20)})), engine="numba")
    assert doubted_shares(before)["zero_rate"] == 0.0
    turning = [6, 7, 8]
    assert np.all(weight[turning] < 1e-3)  # it turns by up to 1.2 rad/s


def test_the_slope_by_the_walk_of_the_bias_is_exact() -> None:
    recording, _ = turned()

    def inputs_at(walk: float) -> Any:
        inputs = prepare(Flight(recording, model_of(recording, walk=walk, zero_rate=seconds(0, 20))))
        P = inputs.P.copy()
        P[DTHETA, :], P[:, DTHETA] = 0.0, 0.0
        P[DTHETA, DTHETA] = 1e-6 * np.eye(3)
        return replace(inputs, P=P)

    up, down = (run(inputs_at(WALK * np.exp(s)), "numba", 0).log_likelihood for s in (1e-3, -1e-3))
    inputs = inputs_at(WALK)
    found = 2.0 * float(np.sum(level_scores(inputs).bias[inputs.model.layout.slice("b_gyro")]))
    assert found == pytest.approx((up - down) / 2e-3, rel=0.03, abs=0.1)


def test_effects_of_the_gyroscope_are_in_what_it_reads_at_rest() -> None:
    """The rows of the sensitivity against differences of whole runs, for what at rest is a bias: force on the rate."""
    start = Initial(quaternion=np.array([1.0, 0.0, 0.0, 0.0]), attitude_std=0.02)
    recording = turned()[0].replace(initial=start)
    flight = Flight(recording, model_of(recording, zero_rate=seconds(0, 20)))
    name, beta, step = "gyro.g_sensitivity", np.full(9, 1e-4), 1e-5
    _, sensitivity = sensitivity_pass(flight, [name], {name: beta}, keep_rows=1)
    for k in (2, 5, 8):  # of the vertical force
        ends = [beta + sign * step * np.eye(9)[k] for sign in (1.0, -1.0)]
        runs = [run_filter(flight, {name: end}, engine="numba", stride=0) for end in ends]
        of_rate = runs[0].stream("zero_rate")
        events = np.flatnonzero(runs[0].sensor == runs[0].sensors.index("zero_rate"))
        slope = (of_rate.white - runs[1].stream("zero_rate").white) / (2.0 * step)
        rows = -sensitivity.rows[np.isin(sensitivity.event, events), k].reshape(-1, 3)
        assert np.max(np.abs(slope)) > 10.0
        assert np.max(np.abs(rows - slope)) < 0.05 * np.max(np.abs(slope))  # noise of the force is no signal


def test_north_is_that_of_the_first_heading_where_nothing_tells_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Likelihood and smoothed motion are those of a heading that is unsure, but for one turn about the vertical."""
    recording, _ = turned()
    model = model_of(recording, own_north=True, field=np.diag([1e-4, 0.0, 1e-4]), zero_rate=seconds(0, 20))
    flight = Flight(recording, model)
    journal = run_filter(flight, engine="numba")
    start = prepare(flight).P
    monkeypatch.setattr("sinan.estimator.filter.alignment._north_of_first_heading", lambda q, P, model: P)
    other = run_filter(flight, engine="numba")
    down, east = DTHETA.start + 2, model.layout.start("field") + 1
    before = prepare(flight).P
    assert start[down, down] < 1e-4 * before[down, down]
    assert before[east, east] < 1e-9
    assert start[east, east] == pytest.approx(FIELD[0] ** 2 * before[down, down], rel=0.02)
    assert journal.log_likelihood == pytest.approx(other.log_likelihood, abs=0.5)
    q, q_other = (smooth(one).x[:, Q_NB] for one in (journal, other))
    turn_n = quaternion_log(quaternion_multiply(q, quaternion_conjugate(q_other)))
    assert np.max(np.ptp(turn_n, axis=0)) < 1e-3 < np.max(np.abs(turn_n))
    assert np.max(np.abs(turn_n[:, :2])) < 1e-3


def test_rest_and_a_known_field_are_in_what_can_be_seen() -> None:
    said = sinan.observability(turned()[0]).summary()
    assert ", rest; rank" in said
    assert "weak: heading by itself" not in said


def test_what_tells_a_direction_has_its_north() -> None:
    recording = turned()[0]
    assert has_its_own_north(recording)
    t = recording.streams["mag"].t
    camera = Stream(t, {"point": t, "u": t, "v": t})
    for other in (
        recording.replace(origin=(47.0, 8.0, 400.0)),
        recording.replace(streams={**recording.streams, "camera": camera}),
        recording.replace(initial=Initial(velocity=np.zeros(3))),
        recording.replace(environment=replace(recording.environment, magnetic_field=FIELD)),
    ):
        assert not has_its_own_north(other)


def test_a_later_stretch_and_a_pass_of_a_trace_have_the_north_of_the_field() -> None:
    """A stretch of its own north jumped by what a compass errs; a pass had a heading without a declination."""
    recording = turned()[0]
    imu = recording.streams["imu"]
    cut = imu.rows((imu.t < 22.0) | (imu.t > 32.0))
    recording = recording.replace(streams={**recording.streams, "imu": cut})
    flight = Flight(recording, model_of(recording, own_north=True, field=np.diag([1e-4, 0.0, 1e-4])))
    inputs = prepare(flight)
    (_, P), down = inputs.later[0], DTHETA.start + 2
    assert inputs.P[down, down] < 1e-6 < 1e-4 < P[down, down]
    assert not FlightPasses(flight).flight.model.own_north
