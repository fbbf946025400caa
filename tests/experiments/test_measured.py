"""Measured logs: errors against mounted references; the filter on real flights."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sinan.calibration.levels.preparation import as_declared, prepared
from sinan.estimator.filter.flight_model import FlightModel, flight_model
from sinan.estimator.filter.run_filter import run_filter
from sinan.experiments.datasets import resolve
from sinan.experiments.measured import flights
from sinan.experiments.reference import (
    Mounted,
    attitude_error,
    errors_of,
    gyro_error,
    mounted,
    without_jumps,
)
from sinan.experiments.residual_loop.open_flight import flight_source, source_of
from sinan.experiments.scenarios import load_scenario, parse_effect
from sinan.sensors.recording import GYRO, Environment, Initial, Recording, SensorSpec, Stream
from sinan.sensors.rotation import (
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    rpy_from_quaternion,
)
from sinan.sensors.simulate import simulate
from sinan.sensors.window import between
from tests.flights import scenario_at

DEGREE = np.deg2rad(1.0)
QUATERNION = ("qw", "qx", "qy", "qz")


@pytest.fixture(scope="module")
def handheld() -> tuple[Recording, Stream]:
    return simulate(load_scenario("no_aiding"), np.random.default_rng(6))


def test_what_declares_everything_is_prepared_as_it_is(handheld: tuple[Recording, Stream]) -> None:
    recording = handheld[0]
    ready = as_declared(recording)
    assert ready.recording is recording
    assert ready.notes == ()
    assert all(
        np.array_equal(a, b) for a, b in zip(vars_of(ready.model), vars_of(flight_model(recording)), strict=True)
    )


def vars_of(model: FlightModel) -> list[np.ndarray]:
    """What the filter computes with."""
    sizes = [(p.sigma, p.bias_std, p.bias_walk) for p in (model.accel, model.gyro)]
    return [*(np.array(size) for size in sizes), model.m_n, model.g_n, *(s.R for s in model.sensors.values())]


@pytest.mark.parametrize("late", [0.0, 0.03])
def test_estimate_and_trace_prepare_a_bare_log_alike(handheld: tuple[Recording, Stream], late: float) -> None:
    """But for lateness, which a trace has to name, less than half a step of which may be the IMU's own and has no name,
    and but for what effects may explain of its noise: nothing to speak of here.
    """
    flown = between(handheld[0], 0.0, 40.0)
    mag = flown.streams["mag"]
    streams = {**flown.streams, "mag": Stream(mag.t + late, mag.columns)}
    recording = flown.replace(sensors={}, environment=Environment(), streams=streams)
    ready, source = prepared(recording), flight_source(recording)
    assert ready.recording.notes == (*recording.notes, *ready.notes)
    said = [note for note in ready.recording.notes if late == 0.0 or "ms late" not in note]
    for own, of_trace in zip(said, source.recording.notes, strict=True):  # sizes may be others in the last digit
        assert re.sub(r"[\d.e-]+", "", of_trace) == re.sub(r"[\d.e-]+", "", own)
    beside = prepared(recording, effects=lambda flight: source_of(flight, recording).explained_by_all)
    assert list(source.recording.notes) == [n for n in beside.recording.notes if late == 0.0 or "ms late" not in n]
    assert len(said) == len(ready.recording.notes) - (late > 0.0)
    assert ready.model.latency["mag"] == pytest.approx(late, abs=0.004)
    on_time = ready.model if late == 0.0 else ready.model.replace(latency={})
    for own, of_trace in zip(vars_of(on_time), vars_of(source.model), strict=True):
        np.testing.assert_allclose(of_trace, own, rtol=0.2, atol=1e-9)
    alike = beside.model if late == 0.0 else beside.model.replace(latency={})
    assert all(np.array_equal(a, b) for a, b in zip(vars_of(alike), vars_of(source.model), strict=True))
    assert [note.split(":")[0] for note in ready.notes][:2] == ["mag", "mag"]


def test_a_lateness_that_is_declared_is_taken_off_once() -> None:
    """20 s of a bare log of 50 Hz, its GPS 0.25 s late: found or declared, its fixes are predicted alike."""
    hidden = [parse_effect("gps.latency=0.25")]
    flown, _ = simulate(scenario_at(50.0, "figure_eight"), np.random.default_rng(8), hidden)
    recording = between(flown.replace(streams={n: flown.streams[n] for n in ("imu", "gps", "mag", "baro")}), 0.0, 20.0)
    angles = {name: SensorSpec(angles=spec.angles) for name, spec in recording.sensors.items()}
    bare = recording.replace(sensors=angles, initial=Initial())
    told = bare.replace(effects={"gps.latency": (0.25,)})
    found, declared = prepared(bare), prepared(told)
    assert found.model.latency["gps"] == pytest.approx(0.25, abs=0.03)
    assert "gps" not in declared.model.latency
    assert declared.levels.lead == pytest.approx(0.0, abs=0.03)  # 0.25 of positions if 0.5 s were declared, or none
    sizes = [np.sqrt(np.mean(one.run().stream("gps").nu[20:, :3] ** 2)) for one in (found, declared)]
    on_time = run_filter(replace(found.levels, latency={}).flight(found.recording), engine="numba")
    late = np.sqrt(np.mean(on_time.stream("gps").nu[20:, :3] ** 2))
    assert sizes[1] == pytest.approx(sizes[0], rel=0.05)
    assert sizes[1] < 0.8 * late


def test_a_field_that_was_found_is_not_declared(handheld: tuple[Recording, Stream]) -> None:
    """Declination and scale are asked against a declared field alone."""
    ready = prepared(handheld[0].replace(environment=Environment()))
    assert ready.recording.environment.magnetic_field is None
    assert np.linalg.norm(ready.model.m_n) > 0.0
    assert ready.levels.specs["mag"] == handheld[0].spec("mag")


def turned(truth: Stream, mounting: np.ndarray, delay: float) -> Stream:
    """The truth as a reference on another body and an earlier clock."""
    q = quaternion_multiply(truth.array(QUATERNION), np.broadcast_to(quaternion_conjugate(mounting), (len(truth), 4)))
    return Stream(truth.t - delay, dict(zip(QUATERNION, q.T, strict=True)))


@pytest.mark.parametrize("every", [1, 20, 50])
def test_mounting_and_delay_come_from_the_rates(handheld: tuple[Recording, Stream], every: int) -> None:
    """However rare the reference is: here once in 0.02, 0.4 and 1 s, in which a hand turns by half a turn."""
    recording, truth = handheld
    mounting = quaternion_exp(np.array([0.1, -0.2, 0.3]))
    found = mounted(recording, turned(truth, mounting, 0.08).rows(slice(None, None, every)))
    assert found.delay == pytest.approx(0.08, abs=0.011)
    error = quaternion_log(quaternion_multiply(quaternion_conjugate(mounting), found.mounting))
    assert np.linalg.norm(error) < 0.5 * DEGREE


def test_scale_and_crookedness_of_a_gyroscope_come_from_the_rates(handheld: tuple[Recording, Stream]) -> None:
    """A per cent of scale is seen to a tenth of it."""
    recording, truth = handheld
    imu = recording.streams["imu"]
    K = np.array([[1.02, 0.005, 0.0], [0.005, 0.97, 0.0], [0.0, 0.0, 1.0]])
    wrong = {**imu.columns, **dict(zip(GYRO, (imu.array(GYRO) @ K.T).T, strict=True))}
    recording = recording.replace(streams={**recording.streams, "imu": Stream(imu.t, wrong)})
    mounting = quaternion_exp(np.array([0.1, -0.2, 0.3]))
    found = gyro_error(recording, mounted(recording, turned(truth, mounting, 0.0)))
    assert found.scale == pytest.approx([0.02, -0.03, 0.0], abs=1e-3)
    assert found.cross_axis == pytest.approx([0.005, 0.0, 0.0], abs=1e-3)


def test_a_reference_on_another_body_becomes_one_of_this_recording(handheld: tuple[Recording, Stream]) -> None:
    recording, truth = handheld
    estimate = truth.array(QUATERNION)
    other = turned(truth, quaternion_exp(np.array([0.1, -0.2, 0.3])), 0.08)
    north = np.array([np.cos(0.4), 0.0, 0.0, np.sin(0.4)])
    away = quaternion_multiply(np.broadcast_to(north, (len(other), 4)), other.array(QUATERNION))
    other = Stream(other.t, dict(zip(QUATERNION, away.T, strict=True)))
    states = np.hstack([np.zeros((len(truth), 6)), estimate])
    errors = errors_of(mounted(recording, other), truth.t, states)
    assert errors.keys() == {"attitude_rms", "tilt_rms", "heading_rms"}
    assert errors["attitude_rms"] < 1.0 * DEGREE


def test_roll_and_pitch_score_the_tilt_alone(handheld: tuple[Recording, Stream]) -> None:
    truth = handheld[1]
    q = truth.array(QUATERNION)
    rpy = rpy_from_quaternion(q)
    level = Stream(truth.t, {"roll": rpy[:, 0] + 0.01, "pitch": rpy[:, 1]})
    errors = errors_of(mounted(handheld[0], level), truth.t, np.hstack([np.zeros((len(q), 6)), q]))
    off = 0.01 * np.cos(rpy[:, 1])  # a turn about the body's x tilts by less where that stands up
    assert errors == pytest.approx({"tilt_rms": np.sqrt(np.mean(off**2))}, rel=1e-3)


def test_error_of_the_truth_is_none_but_a_north(handheld: tuple[Recording, Stream]) -> None:
    truth = handheld[1]
    turn = np.array([np.cos(0.2), 0.0, 0.0, np.sin(0.2)])
    q = quaternion_multiply(np.broadcast_to(turn, (len(truth), 4)), truth.array(QUATERNION))
    error = attitude_error(truth.t, q, Mounted(truth, np.array([1.0, 0.0, 0.0, 0.0]), 0.0))
    assert error.north == pytest.approx(0.4)
    assert np.max(error.total) < 1e-6


def test_a_jump_of_the_reference_is_left_out(handheld: tuple[Recording, Stream]) -> None:
    truth = handheld[1]
    columns = {name: truth[name].copy() for name in QUATERNION}
    k = len(truth) // 2
    columns["qw"][k], columns["qx"][k], columns["qy"][k], columns["qz"][k] = 0.0, 1.0, 0.0, 0.0
    kept = without_jumps(Stream(truth.t, columns))
    assert truth.t[k] not in kept.t
    assert len(kept) > len(truth) - 60


def test_withheld_fixes_are_predicted(handheld: tuple[Recording, Stream]) -> None:
    recording, _ = simulate(load_scenario("figure_eight"), np.random.default_rng(8))
    found = flights.predictions(prepared(recording))
    assert [p.age for p in found] == list(flights.AGES)
    assert found[0].rms < 2.0
    assert found[-1].rms < 10.0


@pytest.fixture
def data(measured_data: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    if "SINAN_DATA" not in os.environ:
        monkeypatch.setenv("SINAN_DATA", str(measured_data))
    return measured_data


@pytest.mark.measured
def test_a_walk_without_magnetometer_is_predicted(data: Path) -> None:
    """RTK positions withheld for 10 s: a metre after five seconds of walking with a consumer IMU; of its first 70 s."""
    entry = flights.measured("walk, RTK", prepared(between(resolve(flights.LOGS["walk, RTK"]), 0.0, 70.0)))
    assert entry["withheld"][0]["rms"] < 0.3
    assert entry["withheld"][2]["rms"] < 1.0


@pytest.mark.measured
def test_gps_of_an_autopilot_is_late(data: Path) -> None:
    """The author of the log set 210 ms for position and 230 ms for velocity; of its first lively minute. Where the
    height beside the fixes, another instrument's, was read with them, the search ended at 78 ms.
    """
    ready = prepared(between(resolve(flights.LOGS["quad, slow"]), 30.0, 90.0))
    assert ready.model.latency["gps"] == pytest.approx(0.22, abs=0.07)
    assert all(np.isfinite(value) for value in ready.run().nis_per_dof().values())
