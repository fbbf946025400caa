"""Information along a motion: transitions, Riccati limits, and the textbook's facts about what cannot be told apart."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
import pytest

from sinan.estimator.evidence.error_integrals import ErrorIntegrals, transitions
from sinan.estimator.evidence.observability import Information, first_state_information, information, posterior
from sinan.estimator.filter.error_dynamics import transition
from sinan.estimator.filter.flight_model import FlightModel, flight_model
from sinan.estimator.filter.strapdown import strapdown_step
from sinan.sensors.accelerometer import Accelerometer
from sinan.sensors.arrays import FloatArray
from sinan.sensors.gps import BaseReceiver, Gps
from sinan.sensors.laser import Laser
from sinan.sensors.manoeuvres import Manoeuvre
from sinan.sensors.motion import Motion
from sinan.sensors.recording import SensorSpec
from sinan.sensors.rotation import rpy_from_quaternion
from sinan.sensors.scenario import Instrument, Scenario
from sinan.sensors.simulate import simulate

HALVED = 3.0  # information, in units of the prior's, that halves a sigma
ROUNDING = 1e-6  # the same, of a direction that no reading shows
STEP = 2e-4  # of Phi: the trapezoid of the closed form against that of the strapdown step
CELL_NOISE = 0.02  # relative: what is neglected inside a cell
PROMISED = 0.8  # least share of the true sigma that too long cells may claim
NOISY = 0.05  # the same where the process noise is as loud as the readings
ATTITUDE_STD = 0.02

REST, TURN, DASH, LIVELY = "rest", "turn", "dash", "lively"
FLIGHTS = {
    REST: (Manoeuvre("hold", 20.0),),
    TURN: (Manoeuvre("hold", 4.0), Manoeuvre("leg", 12.0, {"yaw": 360.0}), Manoeuvre("hold", 4.0)),
    DASH: (
        Manoeuvre("hold", 4.0),
        Manoeuvre("shake", 12.0, {"north": 3.0, "east": 2.0}),
        Manoeuvre("hold", 4.0),
    ),
    LIVELY: (Manoeuvre("shake", 20.0, {"north": 3.0, "east": 2.0, "up": 1.0, "yaw": 60.0}),),
}

SPECS = {
    "accel": Instrument(SensorSpec(noise_density=2e-3, bias_walk=3e-4, bias_std=0.1), 100.0),
    "gyro": Instrument(SensorSpec(noise_density=2e-4, bias_walk=2e-5, bias_std=0.01), 100.0),
    "mag": Instrument(SensorSpec(noise_std=0.005, bias_walk=1e-4, bias_std=0.05), 20.0, 0.002),
    "baro": Instrument(SensorSpec(noise_std=0.3, bias_walk=0.02, bias_std=2.0), 10.0, 0.013),
    "sonar": Instrument(SensorSpec(noise_std=0.03, bias_walk=0.0, bias_std=0.0), 10.0, 0.021),
    "gps": Instrument(SensorSpec(noise_std=0.5, velocity_noise_std=0.1, bias_walk=0.05, bias_std=1.0), 5.0, 0.054),
}


@cache
def flown(flight: str) -> tuple[FlightModel, Motion, Mapping[str, FloatArray]]:
    """Model, true motion at the IMU's instants, and instants of the readings."""
    scenario = Scenario("test", SPECS, manoeuvres=FLIGHTS[flight], start=(0.0, 0.0, -5.0, 0.0, 1.0))
    recording, _ = simulate(scenario, np.random.default_rng(5))
    times = {name: recording.streams[name].t for name in ("gps", "mag", "baro", "sonar")}
    return flight_model(recording), scenario.trajectory().motion(recording.streams["imu"].t), times


def prior(model: FlightModel) -> FloatArray:
    """(n, n) prior of a flight whose first state is declared."""
    stds = [1.0] * 3 + [0.2] * 3 + [ATTITUDE_STD] * 3 + [0.1] * 3 + [0.01] * 3 + [0.05] * 3 + [1.0] * 3 + [2.0]
    return np.diag(np.square(stds))[: model.layout.n, : model.layout.n]


def found_on(flight: str, base: bool = False) -> Information:
    model, motion, times = flown(flight)
    extra = (BaseReceiver(0.3),) if base else ()
    return information(
        model, motion, times | ({"base": np.arange(0.0, 20.0, 1.0)} if base else {}), prior(model), extra=extra
    )


def seen(found: Information, direction: Mapping[str, float], sensors: tuple[str, ...]) -> float:
    """Information about a combination of states (in their own units) along which it is one prior sigma long."""
    v = np.zeros(len(found.scale))
    for label, amount in direction.items():
        v[found.index(label)] = amount / found.scale[found.index(label)]
    v /= np.linalg.norm(v)
    return float(v @ first_state_information(found, [sensors])[0] @ v)


def test_closed_form_is_the_product_of_the_filters_steps() -> None:
    model, motion, _ = flown(LIVELY)
    n, product, last = model.layout.n, np.eye(model.layout.n), 300
    x = np.concatenate([motion.p_n[0], motion.v_n[0], motion.q_nb[0], np.zeros(n - 9)])
    u = np.concatenate([motion.f_b, motion.w_ib_b], axis=1)
    for k in range(last):
        h = motion.t[k + 1] - motion.t[k]
        x, step = strapdown_step(x, u[k], u[k + 1], h, model.g_n, model.w_ie_n)
        product = transition(step, n) @ product
    whole = ErrorIntegrals.along(motion)
    Phi = transitions(whole.rows(slice(0, 1)), whole.rows(slice(last, last + 1)))[0]
    np.testing.assert_allclose(Phi, product[:15, :15], rtol=0.0, atol=STEP * np.abs(product).max())


def test_transitions_compose_and_run_backwards() -> None:
    whole = ErrorIntegrals.along(flown(LIVELY)[1])
    a, b, c = (whole.at(np.array([t])) for t in (2.0, 7.3, 15.1))
    np.testing.assert_allclose(transitions(a, c)[0], transitions(b, c)[0] @ transitions(a, b)[0], atol=1e-9)
    np.testing.assert_allclose(transitions(c, a)[0] @ transitions(a, c)[0], np.eye(15), atol=1e-9)


def test_a_fix_in_two_dimensions_says_nothing_of_the_height() -> None:
    """And of the rest as much as a whole one."""
    model, motion, times = flown(REST)
    told = {"gps": np.tile([True, True, False, True, True, True], (len(times["gps"]), 1))}
    flat = information(model, motion, times, prior(model), told=told)
    ups = [seen(found, {"position_down": 1.0}, ("gps",)) for found in (found_on(REST), flat)]
    assert ups[0] > HALVED
    assert ups[1] < ROUNDING
    norths = [seen(found, {"position_north": 1.0}, ("gps",)) for found in (found_on(REST), flat)]
    assert norths[1] == pytest.approx(norths[0])


def test_without_a_reading_a_bias_only_walks() -> None:
    found = found_on(REST)
    course = posterior(found, [()])
    rows = [i for i, label in enumerate(found.labels) if label.startswith("b_")]
    np.testing.assert_allclose(course.sigma[0, 1:, rows], found.carried_prior(found.t)[:, rows].T, rtol=1e-9)


def test_a_bias_that_is_read_directly_reaches_the_riccati_limit() -> None:
    """b walks with w^2 a second and is read every second: P (P + w^2) = R w^2 / (1 s) just after a reading."""
    sigma = posterior(found_on(REST, base=True), [("gps", "base")]).sigma[0]
    found = found_on(REST, base=True)
    w2, R = SPECS["gps"].spec.bias_walk ** 2, 0.3**2
    limit = np.sqrt(-0.5 * w2 + np.sqrt(0.25 * w2**2 + R * w2))
    base_only = posterior(found, [("base",)]).sigma[0, :, found.index("b_gps_north")]
    assert base_only[-10:].min() == pytest.approx(limit, rel=0.05)
    assert sigma[-1, found.index("b_gps_north")] < base_only[-1] * 1.01


def test_without_process_noise_forward_and_backward_agree() -> None:
    model, motion, times = flown(LIVELY)
    quiet = {
        name: Instrument(SensorSpec(**{**vars(one.spec), "bias_walk": 0.0}), one.rate) for name, one in SPECS.items()
    }
    scenario = Scenario("quiet", quiet, manoeuvres=FLIGHTS[LIVELY], start=(0.0, 0.0, -5.0, 0.0, 1.0))
    still = flight_model(simulate(scenario, np.random.default_rng(5))[0])
    none = (np.zeros(len(motion) - 1), np.zeros(len(motion) - 1))
    found = information(still, motion, times, prior(model), noise=none)
    Lambda = first_state_information(found, [tuple(times)])[0]
    whole = np.eye(len(found.scale))
    for Phi in found.Phi:
        whole = Phi @ whole
    P = whole @ np.linalg.inv(np.linalg.inv(found.P0) + Lambda) @ whole.T
    expected = np.sqrt(np.diag(P)) * found.scale
    np.testing.assert_allclose(posterior(found, [tuple(times)]).sigma[0, -1], expected, rtol=1e-4)


def test_process_noise_takes_information_away() -> None:
    model, motion, times = flown(LIVELY)
    none = (np.zeros(len(motion) - 1), np.zeros(len(motion) - 1))
    noisy = first_state_information(found_on(LIVELY), [tuple(times)])[0]
    less = first_state_information(information(model, motion, times, prior(model), noise=none), [tuple(times)])[0]
    assert np.linalg.eigvalsh(less - noisy).min() > -ROUNDING
    assert np.trace(noisy) < 0.9 * np.trace(less)


def test_declared_noise_is_that_of_the_imu_table() -> None:
    model, motion, times = flown(LIVELY)
    even = np.ones(len(motion) - 1) / model.rate
    found = information(
        model, motion, times, prior(model), noise=(model.accel.sigma**2 * even, model.gyro.sigma**2 * even)
    )
    np.testing.assert_allclose(found_on(LIVELY).Q, found.Q, rtol=1e-6, atol=1e-15)


def test_a_noisy_imu_beside_a_precise_sensor_gets_short_cells() -> None:
    """Two readings of a cell must not pass for two views of one and the same velocity."""
    model, motion, times = flown(LIVELY)
    loud = model.replace(
        accel=Accelerometer(10.0, 0.1, 3e-4), sensors={**model.sensors, "gps": Gps(0.002, 0.1, 1.0, 0.05)}
    )
    chosen = information(loud, motion, times, prior(model))
    fine = information(loud, motion, times, prior(model), cell=0.01)
    assert chosen.t[1] - chosen.t[0] < 0.1
    ends = [posterior(one, [ALL]).sigma[0, -1] for one in (chosen, fine)]
    np.testing.assert_allclose(ends[0], ends[1], rtol=NOISY)


def test_coarse_cells_do_not_make_a_noisy_imu_look_good() -> None:
    """Noise between a reading and its node counts as the reading's: too long a cell must not promise too much."""
    model, motion, times = flown(LIVELY)
    loud = model.replace(
        accel=Accelerometer(10.0, 0.1, 3e-4), sensors={**model.sensors, "gps": Gps(0.002, None, 1.0, 0.05)}
    )
    coarse, fine = (information(loud, motion, times, prior(model), cell=cell) for cell in (0.4, 0.01))
    ratio = posterior(coarse, [ALL]).sigma[0, -1] / posterior(fine, [ALL]).sigma[0, -1]
    assert ratio.min() > PROMISED


def test_a_further_sensor_never_hurts() -> None:
    course = posterior(
        found_on(LIVELY), [("gps",), ("gps", "mag"), ("gps", "mag", "baro"), ("gps", "mag", "baro", "sonar")]
    )
    assert np.all(np.diff(course.sigma[:, -1], axis=0) <= 1e-9)


def test_the_length_of_a_cell_hardly_matters() -> None:
    model, motion, times = flown(LIVELY)
    ends = [
        posterior(information(model, motion, times, prior(model), cell=cell), [tuple(times)]).sigma[0, -1]
        for cell in (0.05, 0.2)
    ]
    np.testing.assert_allclose(ends[1], ends[0], rtol=CELL_NOISE)


def tilt(model: FlightModel, angle: float = 1.0) -> dict[str, float]:
    """A pitch error, and the biases that make accelerometer and magnetometer read as if there were none."""
    g, m = model.g_n[2], model.m_n
    return {"attitude_y": angle, "b_accel_x": -g * angle, "b_mag_x": m[2] * angle, "b_mag_z": -m[0] * angle}


def heading(model: FlightModel) -> dict[str, float]:
    """A heading error, and the magnetometer bias that hides it (nose to the north)."""
    return {"attitude_z": 1.0, "b_mag_x": -model.m_n[1], "b_mag_y": model.m_n[0]}


ALL = ("gps", "mag", "baro", "sonar")


def test_at_rest_an_accelerometer_bias_is_a_tilt() -> None:
    assert seen(found_on(REST), tilt(flown(REST)[0]), ALL) < ROUNDING


@pytest.mark.parametrize("flight", [TURN, DASH])
def test_turning_or_accelerating_tells_an_accelerometer_bias_from_a_tilt(flight: str) -> None:
    assert seen(found_on(flight), tilt(flown(flight)[0]), ALL) > HALVED


def test_at_rest_a_magnetometer_bias_is_a_heading() -> None:
    assert seen(found_on(REST), heading(flown(REST)[0]), ALL) < ROUNDING


def test_rotation_separates_the_magnetometer_bias_from_the_field() -> None:
    assert seen(found_on(TURN), heading(flown(TURN)[0]), ("mag",)) > HALVED


@pytest.mark.parametrize("flight", [REST, LIVELY])
def test_a_height_bias_needs_a_second_height_sensor(flight: str) -> None:
    found, height = found_on(flight), {"position_down": 1.0, "b_baro": 1.0}
    assert seen(found, height, ("mag", "baro")) < ROUNDING
    assert seen(found, height, ("mag", "baro", "sonar")) > HALVED


@pytest.mark.parametrize("flight", [REST, LIVELY])
@pytest.mark.parametrize("axis", ["north", "east"])
def test_a_common_gps_bias_needs_a_base(flight: str, axis: str) -> None:
    found, place = found_on(flight, base=True), {f"position_{axis}": 1.0, f"b_gps_{axis}": -1.0}
    assert seen(found, place, ALL) < ROUNDING
    assert seen(found, place, (*ALL, "base")) > HALVED


def test_gyroscope_biases_are_seen_at_rest_by_what_holds_the_attitude() -> None:
    found = found_on(REST)
    sigma = posterior(found, [ALL]).sigma[0]
    for axis in "xyz":
        i = found.index(f"b_gyro_{axis}")
        assert sigma[-1, i] < 0.5 * sigma[0, i]


def test_an_unknown_sensor_is_named() -> None:
    with pytest.raises(KeyError, match="no sensor `radar`"):
        posterior(found_on(REST), [("radar",)])


def test_a_state_that_is_not_uncertain_is_named() -> None:
    with pytest.raises(KeyError, match="no uncertain state `b_sonar`"):
        found_on(REST).index("b_sonar")


def test_a_scan_with_a_beam_above_the_horizon_says_nothing_then() -> None:
    """Its outer beams lie 80 deg off body down: a lean of more than 10 deg to a side lifts one above the horizon."""
    model, motion, _ = flown(DASH)
    scan = Laser(0.03, angles=np.deg2rad([-80.0, 0.0, 80.0]))
    t = np.arange(0.0, 20.0, 0.05)
    at = motion.at(t)
    roll, pitch = np.abs(rpy_from_quaternion(at.q_nb))[:, :2].T
    down = np.minimum(np.cos(np.deg2rad(80.0) + roll), np.cos(np.deg2rad(80.0) - roll)) * np.cos(pitch)
    assert 0.1 < np.mean(down > 0.0) < 0.9
    every, seen = (information(model, motion, {"laser": x}, prior(model), extra=(scan,)) for x in (t, t[down > 0.0]))
    assert every.counts == seen.counts == {"laser": int(np.sum(down > 0.0))}
    assert np.all(np.isfinite(every.readings["laser"]))
    np.testing.assert_array_equal(every.readings["laser"], seen.readings["laser"])
