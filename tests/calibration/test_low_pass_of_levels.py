"""The low pass that is found of an IMU which shakes faster than it is logged."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from sinan.calibration.levels.fields import beforehand
from sinan.calibration.levels.fit import problem_of
from sinan.calibration.levels.levels import Levels
from sinan.calibration.levels.preparation import level_notes, prepared
from sinan.calibration.levels.problem import Problem
from sinan.calibration.levels.sizes import sizes_of
from sinan.estimator.evidence.sensitivity import driver_regressors
from sinan.estimator.filter.effect_forms import Along, Terms
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.flight_model import LowPass
from sinan.estimator.filter.imu import imu_table
from sinan.estimator.filter.inputs import prepare
from sinan.estimator.filter.smoother import estimated_motion, smooth
from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects import effect
from sinan.sensors.recording import ACCEL, Recording, SensorSpec, Stream
from tests.estimator.analytic_flight import fly

RATES = {"imu": 10.0, "mag": 10.0, "baro": 5.0, "gps": 5.0}


@cache
def flown(shaken: float, rate: float = 10.0) -> tuple[Recording, FloatArray]:
    """A minute that declares nothing, and its true velocities; the accelerometer's samples are off by `shaken`
    [m/s^2], each by itself.
    """
    recording, truth = fly(3, duration=60.0, sensors=("mag", "baro", "gps"), rates={**RATES, "imu": rate})
    imu = recording.streams["imu"]
    off = shaken * np.random.default_rng(4).standard_normal((len(imu.t), 3))
    columns = {**imu.columns, **{name: imu[name] + off[:, k] for k, name in enumerate(ACCEL)}}
    return recording.replace(streams={**recording.streams, "imu": Stream(imu.t, columns)}, sensors={}), truth[:, 3:6]


@cache
def found(shaken: float) -> Levels:
    return prepared(flown(shaken)[0], late=False).levels


def off_by(levels: Levels, shaken: float) -> float:
    """RMS error of the smoothed velocity [m/s]."""
    recording, velocity = flown(shaken)
    journal = run(prepare(levels.flight(recording)), "numba", 1)
    return float(np.sqrt(np.mean((estimated_motion(journal, smoothed=smooth(journal)).v_n - velocity) ** 2)))


def test_of_an_imu_that_shakes_it_is_found_and_makes_the_velocity_better() -> None:
    recording, _ = flown(6.0)
    levels = found(6.0)
    believed = beforehand(recording)
    whole = problem_of(recording, believed.m_n, believed.covariance, believed.compass)
    without = Problem(recording, [size for size in whole.sizes if size.sensor != "low_pass"], whole.first)
    plain = without.fitted(np.zeros(len(without.sizes)))
    assert levels.low_pass.accel > 0.15
    assert levels.low_pass.gyro < 0.1
    assert levels.log_posterior > plain.log_posterior + 30.0
    assert off_by(levels, 6.0) < 0.8 * off_by(plain, 6.0)
    assert any(note.startswith("accel: low pass of") for note in level_notes(levels))
    assert not any(note.startswith("gyro: low pass of") for note in level_notes(levels))


def test_of_one_that_does_not_there_is_none() -> None:
    levels = found(0.0)
    sigma = levels.sigma_of
    for key in ("accel", "gyro"):
        assert getattr(levels.low_pass, key) < 2.0 * sigma["low_pass", key]
    assert levels.low_pass.accel < 0.06


def test_it_is_sought_where_a_log_is_slow_and_its_noise_is_open() -> None:
    def open_in(recording: Recording) -> set[str]:
        return {size.key for size in sizes_of(recording) if size.sensor == "low_pass"}

    slow = flown(0.0)[0]
    assert open_in(slow) == {"accel", "gyro"}
    assert open_in(flown(0.0, 50.0)[0]) == set()
    assert open_in(slow.replace(sensors={"gyro": SensorSpec(noise_density=1e-3)})) == {"accel"}


def test_a_bias_may_walk_as_vibration_makes_it_where_a_position_tells() -> None:
    def walk_of(recording: Recording) -> tuple[float, float]:
        (size,) = (size for size in sizes_of(recording) if (size.sensor, size.key) == ("accel", "bias_walk"))
        return size.median, size.spread

    shaken = flown(6.0)[0]
    (white,) = (s.median for s in sizes_of(shaken) if (s.sensor, s.key) == ("accel", "noise_density"))
    median, spread = walk_of(shaken)
    assert median * np.exp(2.0 * spread) == pytest.approx(white)
    assert median * np.exp(-2.0 * spread) == pytest.approx(1e-3)
    alone = shaken.replace(streams={n: s for n, s in shaken.streams.items() if n != "gps"})
    assert walk_of(alone) == walk_of(flown(6.0, 50.0)[0]) == (1e-3, 1.0)


@pytest.mark.parametrize("stream", ["accel", "gyro"])
def test_what_effects_add_to_the_samples_is_low_passed_too(stream: str) -> None:
    """Of an offset between two samples, in the readings and in the model: the samples without it. And its regressors
    are what it adds.
    """
    recording, _ = flown(6.0)
    begin, end, offset = 20.03, 24.06, np.array([0.3, -0.2, 0.5])
    imu = recording.streams["imu"]
    within = (imu.t > begin) & (imu.t < end)
    names = [f"{stream}_{axis}" for axis in "xyz"]
    columns = {**imu.columns, **{name: imu[name] + x * within for name, x in zip(names, offset, strict=True)}}
    off = recording.replace(streams={**recording.streams, "imu": Stream(imu.t, columns)})
    levels = replace(found(6.0), low_pass=LowPass(0.8, 0.5))
    flights = [levels.flight(one) for one in (recording, off)]
    clean, read = (imu_table(flight).u for flight in flights)
    journal = run(prepare(flights[1]), "numba", 1)
    motion = estimated_motion(journal, smoothed=smooth(journal))
    along = Along(flights[1], Terms.of([(effect(f"{stream}.transient").over(begin, end), offset)]), motion)
    np.testing.assert_allclose(along.corrected.u, clean, atol=1e-9)
    part = slice(0, 3) if stream == "accel" else slice(3, 6)
    regressors = driver_regressors(replace(along, terms=Terms()), stream, along.terms.effects)
    np.testing.assert_allclose(regressors @ offset, (read - clean)[:, part], atol=1e-9)
