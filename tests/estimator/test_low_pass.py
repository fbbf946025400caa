"""Samples of an IMU that shakes faster than it is logged."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from sinan.estimator.filter.flight_model import FlightModel, LowPass, flight_model
from sinan.estimator.filter.low_pass import low_passed_imu
from sinan.sensors.arrays import FloatArray
from tests.estimator.analytic_flight import fly

STEP = 0.1
EVEN = STEP * np.arange(400.0)


@cache
def plain() -> FlightModel:
    """Of a flight whose IMU is logged ten times a second."""
    recording, _ = fly(1, duration=2.0, sensors=("gps",), rates={"imu": 1.0 / STEP, "gps": 5.0})
    return replace(flight_model(recording), rate=1.0 / STEP)


def with_times(accel: float = 0.0, gyro: float = 0.0) -> FlightModel:
    return replace(plain(), low_pass=LowPass(accel, gyro))


def of_accel(t: FloatArray, force: FloatArray, tau: float, breaks: tuple[float, ...] = ()) -> FloatArray:
    """(n,) what is left of one axis of the accelerometer."""
    u = np.zeros((len(t), 6))
    u[:, 0] = force
    return low_passed_imu(t, u, with_times(tau), breaks)[:, 0]


def test_it_is_the_likeliest_force_that_walks() -> None:
    """Against the conditional mean of a random walk given white readings, by covariances written down in full."""
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.05, 0.3, 60))
    white, walk = 4.0, 0.7
    u = np.cumsum(rng.standard_normal(60)) + 2.0 * rng.standard_normal(60)
    wide = 1e8  # where it begins
    prior = wide + walk * np.minimum(t[:, None], t)
    expected = prior @ np.linalg.solve(prior + white * np.eye(60), u)
    np.testing.assert_allclose(of_accel(t, u, np.sqrt(white * STEP / walk)), expected, atol=1e-4)


@pytest.mark.parametrize("frequency", [0.1, 0.2, 0.5])
def test_a_frequency_is_left_as_far_as_it_is_slow(frequency: float) -> None:
    tau, wave = 0.5, np.sin(2.0 * np.pi * frequency * EVEN)
    left = of_accel(EVEN, wave, tau)[100:300]
    share = left @ wave[100:300] / (wave[100:300] @ wave[100:300])
    assert share == pytest.approx(1.0 / (1.0 + (2.0 * tau / STEP * np.sin(np.pi * frequency * STEP)) ** 2), rel=1e-3)
    assert share == pytest.approx(1.0 / (1.0 + (2.0 * np.pi * frequency * tau) ** 2), rel=0.03)


def test_what_all_samples_have_in_common_stays() -> None:
    t = np.delete(EVEN, slice(100, 150))
    force = np.random.default_rng(2).standard_normal(len(t))
    assert np.mean(of_accel(t, force, 0.7)) == pytest.approx(np.mean(force), abs=1e-12)
    np.testing.assert_allclose(of_accel(t, np.full(len(t), 9.8), 0.7), 9.8, rtol=1e-12)


def test_without_a_time_constant_samples_are_as_read_and_each_instrument_has_its_own() -> None:
    u = np.random.default_rng(3).standard_normal((len(EVEN), 6))
    assert low_passed_imu(EVEN, u, with_times()) is u
    left = low_passed_imu(EVEN, u, with_times(gyro=0.3))
    assert np.array_equal(left[:, :3], u[:, :3])
    assert np.all(np.std(left[:, 3:], axis=0) < 0.5 * np.std(u[:, 3:], axis=0))


def test_logs_that_follow_each_other_have_nothing_in_common() -> None:
    force = np.random.default_rng(4).standard_normal(len(EVEN)) + np.where(EVEN >= 20.0, 100.0, 0.0)
    both = of_accel(EVEN, force, 0.7, breaks=(float(EVEN[200]),))
    each = [of_accel(EVEN[part], force[part], 0.7) for part in (slice(0, 200), slice(200, 400))]
    np.testing.assert_allclose(both, np.concatenate(each), rtol=1e-12)
    assert abs(of_accel(EVEN, force, 0.7)[199] - both[199]) > 10.0


def test_a_log_whose_first_samples_are_missing_is_still_another_one() -> None:
    """The stamp at which it began is none of the table's."""
    force = np.random.default_rng(5).standard_normal(len(EVEN)) + np.where(EVEN >= 20.0, 100.0, 0.0)
    t, left = np.delete(EVEN, slice(200, 203)), np.delete(force, slice(200, 203))
    assert abs(of_accel(t, left, 0.7, breaks=(float(EVEN[200]),))[199]) < 5.0


def test_stamps_that_nearly_agree_do_no_harm() -> None:
    t = np.insert(EVEN, 101, EVEN[100] + 1e-12)
    np.testing.assert_allclose(of_accel(t, np.full(len(t), 9.8), 4.0), 9.8, rtol=1e-9)
