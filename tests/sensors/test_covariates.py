"""Covariates of a recording, and the vibration of its IMU."""

from __future__ import annotations

import numpy as np

from sinan.experiments.scenarios import load_scenario
from sinan.sensors.covariates import covariates_for
from sinan.sensors.recording import Recording, Stream
from sinan.sensors.simulate import simulate
from sinan.sensors.vehicle import Vehicle
from sinan.sensors.vibration import WINDOW, vibration_power


def test_each_sensor_has_its_own_temperature() -> None:
    scenario = load_scenario("warm_up")
    recording, _ = simulate(scenario, np.random.default_rng(0))
    vehicle = Vehicle(scenario, scenario.trajectory())
    for name in ("accel", "mag", "baro"):
        t = recording.streams["imu" if name == "accel" else name].t
        expected = vehicle.motion(t, name).covariates["temperature"]
        np.testing.assert_allclose(covariates_for(recording, name, t)["temperature"], expected, atol=1e-3)


def test_what_is_aboard_is_what_the_simulator_used() -> None:
    scenario = load_scenario("aerobatics")
    recording, _ = simulate(scenario, np.random.default_rng(0))
    t = recording.streams["mag"].t
    true = Vehicle(scenario, scenario.trajectory()).motion(t, "mag").covariates
    found = covariates_for(recording, "mag", t)
    for name in ("current", "throttle", "airspeed"):
        assert np.sqrt(np.mean((found[name] - true[name]) ** 2)) < 0.02 * np.std(true[name])
    assert "wind" not in found


def test_columns_of_the_poses_go_first() -> None:
    t = np.arange(3.0)
    poses = {"mag_x": t, "mag_y": t, "mag_z": t, "current": t + 5.0, "temperature": t + 20.0}
    recording = Recording("r", "poses", {"poses": Stream(t, poses)})
    found = covariates_for(recording, "mag", t)
    np.testing.assert_array_equal(found["current"], t + 5.0)
    np.testing.assert_array_equal(found["temperature"], t + 20.0)


def test_declared_rotor_drag_is_a_covariate() -> None:
    recording, _ = simulate(
        load_scenario("no_aiding_flight"), np.random.default_rng(0), {"motion.rotor_drag": [0.3]}, True
    )
    np.testing.assert_array_equal(covariates_for(recording, "level", np.arange(3.0))["rotor_drag"], 0.3)


def test_a_tone_has_half_its_squared_amplitude() -> None:
    t = np.arange(0.0, 20.0, 0.005)
    f_s = np.outer(np.sin(2.0 * np.pi * 61.0 * t), [1.0, 2.0, 0.5]) + np.array([0.0, 0.0, -9.8])
    power = vibration_power(t, f_s, 0.0)[500:-500]
    np.testing.assert_allclose(np.mean(power, axis=0), [0.5, 2.0, 0.125], rtol=2e-3)


def test_white_noise_is_no_vibration() -> None:
    rng, sigma = np.random.default_rng(3), 0.03
    t = np.arange(0.0, 100.0, 0.005)
    power = vibration_power(t, sigma * rng.standard_normal((len(t), 3)), sigma)
    # 20,000 readings: the mean of the squares is known to 1 % of sigma^2; 3.3 sigma
    assert np.all(np.abs(np.mean(power, axis=0)) < 0.033 * sigma**2)


def test_a_slow_motion_is_no_vibration() -> None:
    t = np.arange(0.0, 30.0, 0.005)
    f_s = np.outer(np.sin(2.0 * np.pi * 1.5 * t), [3.0, 3.0, 3.0])
    assert np.max(np.abs(vibration_power(t, f_s, 0.0)[200:-200])) < 1e-6


def test_the_vibration_found_is_the_one_simulated() -> None:
    scenario = load_scenario("vibration")
    recording, _ = simulate(scenario, np.random.default_rng(1))
    t = recording.streams["imu"].t
    true = Vehicle(scenario, scenario.trajectory()).motion(t, "accel").covariates["vibration"]
    error = covariates_for(recording, "accel", t)["vibration"] - true
    inner = (t > WINDOW) & (t < t[-1] - WINDOW)
    assert np.all(np.std(error[inner], axis=0) < 0.05 * np.std(true[inner], axis=0))
