"""The low pass that is found of an IMU which shakes faster than it is logged."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from sinan.calibration.levels.declared_effects import Readings
from sinan.calibration.levels.fields import beforehand
from sinan.calibration.levels.fit import problem_of
from sinan.calibration.levels.levels import Levels
from sinan.calibration.levels.preparation import low_pass_notes, prepared
from sinan.calibration.levels.problem import Problem
from sinan.calibration.levels.sizes import sizes_of
from sinan.estimator.evidence.sensitivity import driver_regressors
from sinan.estimator.filter.effect_forms import Along, Terms, declared_terms, run_with_effects
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.flight_model import DRIVERS, LowPass
from sinan.estimator.filter.imu import ImuTable, imu_table
from sinan.estimator.filter.inputs import RunInputs, prepare
from sinan.estimator.filter.layout import V_N
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
    return recording.replace(streams={**recording.streams, "imu": Stream(imu.t, columns)}, sensors={}), truth[:, V_N]


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
    (note,) = low_pass_notes(levels, 0.1)
    assert note.startswith(f"accel: low pass of {1e3 * levels.low_pass.accel:.0f}"[:22])


def test_of_one_that_does_not_there_is_none() -> None:
    levels = found(0.0)
    sigma = levels.sigma_of
    for key in ("accel", "gyro"):
        assert getattr(levels.low_pass, key) < 0.05
        assert sigma["low_pass", key] < 0.2
    assert low_pass_notes(levels, 0.1) == []


def test_it_is_sought_where_a_log_is_slow_and_its_noise_is_open() -> None:
    def open_in(recording: Recording) -> set[str]:
        return {size.key for size in sizes_of(recording) if size.sensor == "low_pass"}

    slow = flown(0.0)[0]
    assert open_in(slow) == {"accel", "gyro"}
    assert open_in(flown(0.0, 50.0)[0]) == set()
    assert open_in(slow.replace(sensors={"gyro": SensorSpec(noise_density=1e-3)})) == {"accel"}


def test_where_nothing_measures_the_position_none_is_sought() -> None:
    """What holds a body to its place is the likelier the less it moves."""
    recording, _ = flown(0.0)
    alone = recording.replace(streams={n: s for n, s in recording.streams.items() if n != "gps"})
    levels = prepared(alone, late=False).levels
    assert levels.low_pass == LowPass()
    assert not any(size.sensor == "low_pass" for size in levels.found)


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
    said = shaken.replace(sensors={"accel": SensorSpec(noise_density=1e-3)})
    assert walk_of(alone) == walk_of(said) == walk_of(flown(6.0, 50.0)[0]) == (1e-3, 1.0)


def tables_along(recording: Recording, *others: Recording) -> tuple[list[ImuTable], Along]:
    """Of recordings behind one low pass; and the first one's flight along its motion, where biases hardly walk."""
    steady = {name: replace(spec, bias_walk=1e-6) for name, spec in found(6.0).specs.items() if name in DRIVERS}
    levels = replace(found(6.0), low_pass=LowPass(0.8, 0.5), specs={**found(6.0).specs, **steady})
    flights = [levels.flight(one) for one in (recording, *others)]
    journal = run(prepare(flights[0]), "numba", 1)
    motion = estimated_motion(journal, smoothed=smooth(journal))
    return [imu_table(flight) for flight in flights], Along(flights[0], Terms(), motion)


def with_more(recording: Recording, stream: str, more: FloatArray) -> Recording:
    """With (n, 3) more in the samples of accelerometer or gyroscope."""
    imu = recording.streams["imu"]
    added = {f"{stream}_{axis}": imu[f"{stream}_{axis}"] + more[:, k] for k, axis in enumerate("xyz")}
    return recording.replace(streams={**recording.streams, "imu": Stream(imu.t, {**imu.columns, **added})})


def with_gap(recording: Recording) -> Recording:
    """Without two seconds of its IMU."""
    imu = recording.streams["imu"]
    return recording.replace(streams={**recording.streams, "imu": imu.rows((imu.t < 21.0) | (imu.t > 23.0))})


@pytest.mark.parametrize("gap", [False, True])
@pytest.mark.parametrize("stream", ["accel", "gyro"])
def test_what_effects_add_to_the_samples_is_low_passed_too(stream: str, gap: bool) -> None:
    """Of an offset between two samples, in the readings and in the model: the samples without it. And its regressors
    are what it adds.
    """
    recording = with_gap(flown(6.0)[0]) if gap else flown(6.0)[0]
    begin, end, offset = 20.03, 24.06, np.array([0.3, -0.2, 0.5])
    t = recording.streams["imu"].t
    off = with_more(recording, stream, ((t > begin) & (t < end))[:, None] * offset)
    (read, clean), along = tables_along(off, recording)
    assert np.any(read.row < 0) == gap
    entry = effect(f"{stream}.transient").over(begin, end)
    corrected = replace(along, terms=Terms.of([(entry, offset)])).corrected
    np.testing.assert_allclose(corrected.u, clean.u, atol=1e-9)
    part = slice(0, 3) if stream == "accel" else slice(3, 6)
    regressors = driver_regressors(along, stream, [entry])
    np.testing.assert_allclose(regressors @ offset, (read.u - clean.u)[:, part], atol=1e-9)


@pytest.mark.parametrize("stream", ["accel", "gyro"])
def test_a_scale_is_that_of_the_samples_behind_the_low_pass(stream: str) -> None:
    """Once low-passed, not twice: against what the table has more of scaled samples, less that of the bias."""
    recording, _ = flown(6.0)
    imu, scale = recording.streams["imu"], np.array([0.05, -0.03, 0.04])
    read = np.stack([imu[f"{stream}_{axis}"] for axis in "xyz"], axis=1)
    (plain, more), along = tables_along(recording, with_more(recording, stream, read * scale))
    part = slice(0, 3) if stream == "accel" else slice(3, 6)
    expected = (more.u - plain.u)[:, part]
    added = (plain.u - replace(along, terms=Terms.of({f"{stream}.scale": scale})).corrected.u)[:, part]
    ratio = [np.polyfit(*both, 1)[0] for both in zip(expected.T, added.T, strict=True)]
    np.testing.assert_allclose(ratio, 1.0, atol=0.12)  # twice: 0.62 to 0.89


@pytest.mark.parametrize("name", ["accel.scale", "gyro.scale", "accel.lever_arm"])
def test_a_declared_effect_is_the_same_in_the_search_and_after_it(name: str) -> None:
    """The search has the motion of the first levels, whose samples pass no low pass."""
    declared = flown(6.0)[0].replace(effects={name: (0.05, 0.02, -0.04)})
    levels = found(6.0)
    first = replace(levels, low_pass=LowPass()).flight(declared)
    flight = levels.flight(declared)
    sought = Readings.of(first).inputs(flight).imu.u
    after = run_with_effects(flight, declared_terms(declared), engine="numba", stride=1).run
    assert isinstance(after, RunInputs)
    without = np.std(imu_table(first).u - Readings.of(first).inputs(first).imu.u, axis=0).max()
    assert np.max(np.std(sought - after.imu.u, axis=0)) < 0.25 * without
