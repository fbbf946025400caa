"""The first state from the data itself, and its covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import chdtrc

from sinan.estimator.evidence.consistency import chi_square, nees, nis
from sinan.estimator.filter.alignment import (
    UNKNOWN_POSITION,
    _slopes,
    align,
    attitude_from_vectors,
    first_state,
    with_first_motion,
)
from sinan.estimator.filter.engine import Engine, choose_engine
from sinan.estimator.filter.events import GATED, variances, white_shares
from sinan.estimator.filter.field import field_of_the_log
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import flight_model
from sinan.estimator.filter.inputs import prepare
from sinan.estimator.filter.layout import B_ACCEL, B_GYRO, DTHETA, P_N, PV, Q_NB, StateLayout
from sinan.estimator.filter.pieces import journal_pieces
from sinan.estimator.filter.run_filter import run_filter
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.geomagnetism import inclination
from sinan.sensors.recording import (
    ACCEL,
    GYRO,
    MAG,
    NO_HEIGHT,
    POSITION,
    VELOCITY,
    Initial,
    Recording,
    SensorSpec,
    Stream,
)
from sinan.sensors.rotation import (
    quaternion_conjugate,
    quaternion_from_rpy,
    quaternion_log,
    quaternion_multiply,
    rotate_back,
    rpy_from_quaternion,
)
from sinan.sensors.simulate import simulate
from tests.estimator.analytic_flight import FIELD, GRAVITY, analytic_motion, fly

MICRORADIAN = 1e-6
RUNS = 40
FALSE_ALARM = 0.001
B_MAG = StateLayout().nominal("b_mag")


@pytest.mark.parametrize("rpy", [(0.0, 0.0, 0.0), (0.3, -0.2, 2.0), (-1.2, 0.9, -2.8), (3.0, 0.1, 0.5)])
def test_two_vectors_give_the_attitude(rpy: tuple[float, float, float]) -> None:
    q = quaternion_from_rpy(np.array(rpy))
    found = attitude_from_vectors(rotate_back(q, -GRAVITY), rotate_back(q, FIELD), -GRAVITY, FIELD)
    assert np.linalg.norm(quaternion_log(quaternion_multiply(quaternion_conjugate(q), found))) < MICRORADIAN


@pytest.mark.parametrize("has_field", [True, False])
def test_slopes_of_the_attitude_are_those_of_differences(has_field: bool) -> None:
    rng = np.random.default_rng(7)
    for _ in range(10):
        f_b, m_b, f_n, m_n = (size * rng.normal(size=3) for size in (9.8, 0.5, 9.8, 0.5))
        q = attitude_from_vectors(f_b, m_b if has_field else None, f_n, m_n)
        found = _slopes(f_b, m_b if has_field else None, f_n, m_n)
        for k, J in enumerate(found[: 3 if has_field else 1]):
            vectors = [f_b, m_b, m_n]
            step = 1e-6 * float(np.linalg.norm(vectors[k]))
            for axis, expected in zip(step * np.eye(3), J.T, strict=True):
                ends = [attitude_from_vectors(*_moved(vectors, k, by, f_n, has_field)) for by in (axis, -axis)]
                turn = quaternion_log(quaternion_multiply(quaternion_conjugate(q), np.array(ends)))
                np.testing.assert_allclose((turn[0] - turn[1]) / (2.0 * step), expected, rtol=1e-5, atol=1e-6)


def _moved(
    vectors: list[np.ndarray], k: int, by: np.ndarray, f_n: np.ndarray, has_field: bool
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray, np.ndarray]:
    """What the attitude is made from, one vector of f_b, m_b, m_n moved."""
    f_b, m_b, m_n = (vector + by * (k == i) for i, vector in enumerate(vectors))
    return f_b, m_b if has_field else None, f_n, m_n


def test_covariance_of_the_alignment_is_honest() -> None:
    """At rest: error of attitude with the biases behind it, chi-square over runs."""
    total, size = 0.0, 0
    for seed in range(RUNS):
        recording, truth = fly(seed, duration=2.0, sensors=("mag",))
        still = truth[0]
        rng = np.random.default_rng(seed)
        imu, mag = recording.streams["imu"], recording.streams["mag"]
        f = rotate_back(still[Q_NB], -GRAVITY) + still[B_ACCEL] + 2e-3 * np.sqrt(200.0) * rng.normal(size=(len(imu), 3))
        m = (
            rotate_back(still[Q_NB], FIELD)
            + still[StateLayout().nominal("b_mag")]
            + 0.01 * rng.normal(size=(len(mag), 3))
        )
        w = still[B_GYRO] + 2e-4 * np.sqrt(200.0) * rng.normal(size=(len(imu), 3))
        at_rest = dict(zip((*ACCEL, *GYRO), np.concatenate([f, w], axis=1).T, strict=True))
        streams = {"imu": Stream(imu.t, at_rest), "mag": Stream(mag.t, dict(zip(MAG, m.T, strict=True)))}
        recording = recording.replace(streams=streams)
        model = flight_model(recording)
        q, P, _ = align(Flight(recording, model))
        error = quaternion_log(quaternion_multiply(quaternion_conjugate(q), still[Q_NB]))
        total, size = total + nees(error, P), size + 3
    statistic = chi_square(total, size, 1.0 - FALSE_ALARM)
    assert statistic.consistent, statistic


def test_what_is_declared_is_taken() -> None:
    recording, _ = fly(1, duration=1.0)
    x, P = first_state(Flight.of(recording))
    assert np.array_equal(x[P_N], recording.initial.position)
    assert P[6, 6] == pytest.approx(0.02**2)


def test_a_compass_that_begins_later_tells_the_heading_of_its_first_reading() -> None:
    """It was taken for that of the first second: of a body that had turned meanwhile the heading was off by that."""
    for seed in range(3):
        recording, truth = fly(seed, duration=12.0, sensors=("mag", "gps"))
        mag = recording.streams["mag"]
        late = {**recording.streams, "mag": mag.rows(mag.t > 8.0)}
        flight = Flight.of(recording.replace(streams=late, initial=Initial()))
        q, P, _ = align(flight)
        error = quaternion_log(quaternion_multiply(quaternion_conjugate(q), truth[0, Q_NB]))
        assert error @ np.linalg.solve(P, error) < 16.3  # chi2.isf(0.001, 3)
        assert np.linalg.norm(error) < 0.4


def test_fixes_from_before_the_imu_say_nothing_of_where_it_starts() -> None:
    """A receiver that is on 5 s before the IMU; the body is elsewhere by then."""
    whole, _ = fly(3, duration=15.0)
    imu, (then, there) = whole.streams["imu"], analytic_motion(np.array([0.0, 5.0])).p_n
    late = whole.replace(streams={**whole.streams, "imu": imu.rows(imu.t >= 5.0)}, initial=Initial())
    x, P = first_state(Flight.of(late))
    assert np.linalg.norm(then - there) > 5.0
    assert np.linalg.norm(x[:3] - there) < 3.0
    assert np.all(np.abs(x[:3] - there) < 3.0 * np.sqrt(np.diag(P)[:3]))


def test_without_a_declared_start_the_filter_finds_its_way() -> None:
    recording, truth = fly(2, duration=30.0)
    recording = recording.replace(initial=Initial())
    model = flight_model(recording)
    journal = run_filter(Flight(recording, model), engine="numba")
    error = model.layout.difference(truth[-1:], journal.x_end[None])[0]
    assert np.max(np.abs(error) / np.sqrt(np.diag(journal.P_end))) < 5.0


def test_a_fix_in_two_dimensions_leaves_the_height_to_the_barometer() -> None:
    """Whatever stands in the place of the height: north and east are those of the whole fix, both engines the same."""
    recording, truth = fly(2, duration=30.0, sensors=("gps", "mag", "baro"))
    gps = recording.streams["gps"]
    ends = []
    for down in (0.0, 500.0):
        flat = Stream(gps.t, {**gps.columns, "down": np.full(len(gps), down), "epv": np.full(len(gps), NO_HEIGHT)})
        without = recording.replace(initial=Initial(), streams={**recording.streams, "gps": flat})
        model = flight_model(without)
        x, P = first_state(Flight(without, model))
        assert x[2] == pytest.approx(truth[0, 2], abs=5.0 * np.sqrt(P[2, 2]))
        journals = [run_filter(Flight(without, model), engine=engine) for engine in ("numba", "filterpy")]
        np.testing.assert_allclose(journals[0].x_end, journals[1].x_end, rtol=1e-7, atol=1e-9)
        error = model.layout.difference(truth[-1:], journals[0].x_end[None])[0]
        assert np.max(np.abs(error) / np.sqrt(np.diag(journals[0].P_end))) < 5.0
        assert journals[0].P_end[2, 2] > 3.0 * journals[0].P_end[0, 0]
        assert nis(journals[0], 1.0 - FALSE_ALARM)["gps"].consistent  # of five components, not of six
        assert journals[0].nis_per_dof()["gps"] == nis(journals[0])["gps"].mean
        ends.append(journals[0].x_end)
    assert ends[0] == pytest.approx(ends[1], abs=0.02)


@pytest.mark.parametrize("engine", ["numba", "filterpy"])
def test_what_is_no_reading_makes_none_likelier_to_be_right(engine: Engine) -> None:
    """Of five components that tell something the law is that of five: weights, density and gate."""
    recording, _ = fly(2, duration=6.0, sensors=("gps", "mag", "baro"))
    gps = recording.streams["gps"]
    flat = {**gps.columns, "down": np.full(len(gps), 500.0), "epv": np.full(len(gps), NO_HEIGHT)}
    flat["north"] = gps["north"] + np.where(np.arange(len(gps)) % 7 == 6, 3.0, 0.0)
    log = recording.replace(streams={**recording.streams, "gps": Stream(gps.t, flat)})
    journal = run_filter(Flight(log, flight_model(log, tail=4.0, gate_level=None)), engine=engine)
    fixes = journal.stream("gps")
    assert np.min(fixes.weight) < 0.7
    np.testing.assert_allclose(fixes.weight, np.minimum(1.0, 9.0 / (4.0 + fixes.nis)))
    heavy = np.where(fixes.nis > 5.0, 5.0 + 9.0 * np.log((4.0 + fixes.nis) / 9.0), fixes.nis)
    np.testing.assert_allclose(2.0 * (journal.log_density - journal.loglik)[fixes.events], fixes.nis - heavy)
    model = flight_model(log, gate_level=None)
    worst = float(np.max(run_filter(Flight(log, model), engine=engine).stream("gps").nis))
    level = float(chdtrc(5, worst - 0.01))  # refused by five, and would not be by six
    assert run_filter(Flight(log, replace(model, gate_level=level)), engine=engine).rejected()["gps"] > 0


@pytest.mark.parametrize("others", [("gps", "mag"), ("gps", "mag", "baro")])
def test_a_height_that_later_fixes_tell_is_none_of_the_first(others: tuple[str, ...]) -> None:
    """Nor is what stands in its place: without a barometer it is that of the first fix that tells one."""
    recording, truth = fly(2, duration=1.5, sensors=others)
    gps = recording.streams["gps"]
    down, epv = np.where(gps.t < 1.0, 500.0, gps["down"]), np.where(gps.t < 1.0, NO_HEIGHT, 1.0)
    late = Stream(gps.t, {**gps.columns, "down": down, "epv": epv})
    x, P = first_state(Flight.of(recording.replace(initial=Initial(), streams={**recording.streams, "gps": late})))
    assert abs(x[2] - truth[0, 2]) < 2.0 * np.sqrt(P[2, 2]) < 50.0


def test_where_no_fix_tells_a_height_and_nothing_else_does_the_start_is_the_origin() -> None:
    recording, _ = fly(2, duration=1.5, sensors=("gps", "mag"))
    gps = recording.streams["gps"]
    flat = Stream(gps.t, {**gps.columns, "down": np.full(len(gps), 500.0), "epv": np.full(len(gps), NO_HEIGHT)})
    x, P = first_state(Flight.of(recording.replace(initial=Initial(), streams={**recording.streams, "gps": flat})))
    assert (x[2], P[2, 2]) == (0.0, UNKNOWN_POSITION**2)


def test_a_first_fix_that_is_poor_by_its_own_word_is_no_certain_start() -> None:
    """Else the good ones after it are refused: 1 s of fixes that are off by 3 m and 1 m/s, and say so."""
    recording, truth = fly(2, duration=10.0, sensors=("gps", "mag", "baro"))
    gps, specs = recording.streams["gps"], {**recording.sensors}
    poor, rng = gps.t < 1.0, np.random.default_rng(1)
    motion = analytic_motion(gps.t)
    precise = np.hstack([motion.p_n, motion.v_n]) + 0.02 * rng.standard_normal((len(gps), 6))
    precise[poor] += np.repeat([3.0, 1.0], 3)
    said = {name: np.where(poor, size, 0.02) for name, size in (("eph", 3.0), ("epv", 3.0), ("s_variance", 1.0))}
    fixes = Stream(gps.t, {**dict(zip((*POSITION, *VELOCITY), precise.T, strict=True)), **said})
    specs["gps"] = SensorSpec(noise_std=0.02, velocity_noise_std=0.02, bias_std=0.0, bias_walk=0.0)
    recording = recording.replace(initial=Initial(), sensors=specs, streams={**recording.streams, "gps": fixes})
    flight = Flight.of(recording, said=dict.fromkeys(said, 0.02))
    x, P = first_state(flight)
    assert np.all(np.abs(x[PV] - truth[0, PV]) < 3.0 * np.sqrt(np.diag(P)[PV]))
    status = run_filter(flight, engine="numba").stream("gps").status
    assert not np.any(status == GATED)


def test_a_first_velocity_is_as_wide_as_its_slow_error_and_its_noise() -> None:
    """It is one reading of both, and the readings after it count again."""
    recording, _ = fly(2, duration=10.0, sensors=("gps", "mag", "baro"))
    flight = Flight.of(recording.replace(initial=Initial()))
    slow = replace(recording.sensors["gps"], colour_std=0.2, velocity_colour_std=0.5, colour_time=2.0)
    coloured = Flight.of(flight.recording.replace(sensors={**recording.sensors, "gps": slow}))
    plain, wide = (np.sqrt(np.diag(first_state(one)[1])[PV][3:]) for one in (flight, coloured))
    assert np.all(wide > 5.0)
    assert np.all(wide > 2.0 * plain)
    x, P = first_state(coloured)
    P_narrow = P.copy()
    P_narrow[PV, PV] *= 0.1
    moved = with_first_motion(coloured, x, P_narrow)
    assert np.array_equal(moved[0], x)
    assert np.sqrt(np.diag(moved[1])[PV][3:]) == pytest.approx(wide)


def test_field_of_a_log_has_the_dip_of_the_field() -> None:
    recording, _ = fly(3, duration=10.0, noise=0.0)
    found = field_of_the_log(recording)
    assert np.linalg.norm(found) == pytest.approx(np.linalg.norm(FIELD), rel=1e-3)
    assert found[2] == pytest.approx(FIELD[2], abs=0.05)


def test_the_dip_of_a_log_is_that_of_the_field_in_a_hand_that_never_rests() -> None:
    """Swung by 0.1 m at 1.5 Hz along three axes, 9 m/s^2, with a gyroscope that is 2.8 deg/s off."""
    t, rng = np.arange(0.0, 20.0, 0.01), np.random.default_rng(6)
    q = quaternion_from_rpy(np.stack([0.3 * np.sin(2.0 * t), 0.2 * np.sin(3.0 * t), np.zeros(len(t))], axis=-1))
    half = quaternion_log(quaternion_multiply(quaternion_conjugate(q[:-1]), q[1:])) / 0.01
    w = np.vstack([half[:1], 0.5 * (half[1:] + half[:-1]), half[-1:]])
    swing = 9.0 * np.sin(2.0 * np.pi * 1.5 * t[:, None] + np.array([0.0, 1.0, 2.0]))
    f = rotate_back(q, swing - np.array([0.0, 0.0, 9.81]))
    m = rotate_back(q, np.broadcast_to(FIELD, (len(t), 3)))
    imu = np.hstack([f, w + 0.05 * np.array([0.6, -0.5, 0.6])]) + 1e-3 * rng.standard_normal((len(t), 6))
    streams = {
        "imu": Stream(t, dict(zip((*ACCEL, *GYRO), imu.T, strict=True))),
        "mag": Stream(t[::5], dict(zip(MAG, m[::5].T, strict=True))),
    }
    found = field_of_the_log(Recording("hand", "flight", streams))
    assert inclination(found) == pytest.approx(inclination(FIELD), abs=np.deg2rad(2.0))


def test_no_heading_aid_is_said_by_the_covariance() -> None:
    recording, _ = fly(4, duration=2.0, sensors=("baro",))
    recording = recording.replace(initial=Initial())
    _, P = first_state(Flight.of(recording))
    assert np.linalg.eigvalsh(P[DTHETA, DTHETA])[-1] > 3.0


def test_pieces_are_the_whole() -> None:
    recording, _ = fly(5, duration=12.0)
    model = flight_model(recording)
    whole = run_filter(Flight(recording, model), engine="numba")
    pieces = list(journal_pieces(Flight(recording, model), engine="numba", seconds=2.5))
    assert np.array_equal(np.concatenate([p.nu for p in pieces]), whole.nu)
    assert np.array_equal(pieces[-1].x_end, whole.x_end)
    assert max(len(p) for p in pieces) < 0.3 * len(whole)


def test_named_engine_is_taken() -> None:
    recording, _ = fly(6, duration=1.0)
    inputs = prepare(Flight.of(recording))
    assert choose_engine("filterpy", inputs) == "filterpy"
    assert choose_engine("auto", inputs) in ("numba", "filterpy")


@pytest.mark.parametrize("declared", [True, False], ids=["declared attitude", "found attitude"])
@pytest.mark.parametrize("name", ["sonar", "laser"])
def test_the_first_height_is_that_of_a_leaning_body(name: str, declared: bool) -> None:
    """A hover in 12 m/s of wind, leaning by 17 deg, at 5 m; a range finder alone, whose first beam looks aside."""
    scenario = load_scenario("hover")
    noise = replace(scenario.sensors[name].spec, noise_std=1e-3)
    beams = replace(noise, angles=np.deg2rad([30.0, -5.0])) if name == "laser" else noise
    sensors = {k: scenario.sensors[k] for k in ("accel", "gyro", "mag")}
    sensors[name] = replace(scenario.sensors[name], spec=beams)
    air = replace(scenario.air, drag=0.25, wind=(0.0, 12.0))
    recording, _ = simulate(scenario.replace(sensors=sensors, air=air), np.random.default_rng(1))
    assert recording.initial.quaternion is not None
    roll = np.rad2deg(rpy_from_quaternion(recording.initial.quaternion)[0])
    assert abs(abs(roll) - 17.0) < 3.0
    initial = (
        replace(recording.initial, position=None) if declared else Initial(quaternion=recording.initial.quaternion)
    )
    recording = recording.replace(initial=initial)
    x, _ = first_state(Flight.of(recording))
    assert x[2] == pytest.approx(-5.0, abs=0.15)  # 0.02 rad of the declared attitude across the outer beam


def test_a_receiver_says_itself_how_well_it_knows_a_fix() -> None:
    """Where nobody declares its noise: ten times the usual makes a hundred times the variance, on its own axes."""
    recording, _ = fly(2, duration=10.0, sensors=("gps", "mag", "baro"))
    gps = recording.streams["gps"]
    eph, s_variance = np.full(len(gps), 0.4), np.full(len(gps), 0.1)
    eph[5], s_variance[7], eph[9] = 4.0, 0.05, 0.0  # of the last it says nothing
    told = Stream(gps.t, {**gps.columns, "eph": eph, "s_variance": s_variance})
    recording = recording.replace(streams={**recording.streams, "gps": told})
    for said, shares in (({"eph": 0.4, "s_variance": 0.1}, (100.0, 0.25)), ({}, (1.0, 1.0))):
        flight = Flight(recording, flight_model(recording, said=said))
        expected = np.ones((len(gps), 6))
        expected[5, :2], expected[7, 3:] = shares
        np.testing.assert_allclose(white_shares(flight, "gps"), expected)
        level = np.diag(flight.model.sensors["gps"].R)
        np.testing.assert_allclose(variances(flight, "gps"), level * expected)
