"""Rows that hold a slower sensor's last reading, or interpolate to its next, are told from readings that happen to be
equal or in line.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sinan.calibration.levels.preparation import Prepared, is_declared, prepared, with_readings_alone
from sinan.calibration.levels.sizes import sizes_of
from sinan.experiments.datasets import resolve
from sinan.experiments.measured.flights import LOGS
from sinan.sensors.arrays import FloatArray
from sinan.sensors.held import held, interpolated
from sinan.sensors.recording import Recording, Stream
from tests.estimator.analytic_flight import fly

ROWS = 3000
#: Of a hundred logs of equal readings by chance.
MISTAKEN = 0.02


def as_held(t: FloatArray, t_rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """For each row the reading that is the newest then, and whether it was there in the row before."""
    newest = np.searchsorted(t, t_rows, side="right") - 1
    return newest, np.append(False, np.diff(newest) == 0)


@pytest.mark.parametrize("jitter", [0.0, 0.1, 0.3])
@pytest.mark.parametrize("ratio", [1.33, 1.5, 2.0, 2.5, 7.0, 20.3])
def test_held_rows_are_found(ratio: float, jitter: float) -> None:
    rng = np.random.default_rng(1)
    t = np.cumsum(ratio * np.maximum(0.2, 1.0 + jitter * rng.standard_normal(ROWS)))
    newest, old = as_held(t, np.arange(ROWS) + t[0])
    assert np.array_equal(held(rng.standard_normal((ROWS, 3))[newest]), old)


def test_readings_that_are_lost_make_longer_runs() -> None:
    rng = np.random.default_rng(2)
    t = 20.0 * np.flatnonzero(rng.random(ROWS) < 0.5)
    newest, old = as_held(t, np.arange(ROWS) + t[0])
    assert np.array_equal(held(rng.standard_normal((ROWS, 1))[newest]), old)


@pytest.mark.parametrize("changes", [0.1, 0.5, 0.9])
def test_equal_readings_by_chance_are_readings(changes: float) -> None:
    rng = np.random.default_rng(3)
    logs = [np.cumsum(rng.random(n) < changes).astype(float)[:, None] for n in (30, 100, 300, 1000) for _ in range(100)]
    assert np.mean([np.any(held(log)) for log in logs]) < MISTAKEN


@pytest.mark.parametrize("step", [0.5, 1.0, 3.0])
@pytest.mark.parametrize("wanders", [False, True])
def test_a_coarse_sensor_reads_in_every_row(step: float, wanders: bool) -> None:
    noise = np.random.default_rng(4).standard_normal((ROWS, 1))
    fine = np.cumsum(0.1 * noise, axis=0) if wanders else noise
    readings = step * np.round(fine / step)
    assert not np.any(held(readings))
    assert not np.any(interpolated(np.arange(ROWS) * 0.01, readings))


@pytest.mark.parametrize(("step", "speed", "noise"), [(1.0, 2.0, 0.05), (0.5, 3.0, 0.05), (0.1, 1.0, 0.005)])
def test_a_climb_that_is_read_coarsely_has_no_period(step: float, speed: float, noise: float) -> None:
    t = np.arange(ROWS) * 0.04
    readings = step * np.round((speed * t + noise * np.random.default_rng(8).standard_normal(ROWS)) / step)
    assert not np.any(held(readings[:, None]))
    assert not np.any(interpolated(t, readings[:, None]))


def test_readings_in_every_row_among_interpolated_ones_stay_for_the_most() -> None:
    rng = np.random.default_rng(9)
    t = np.arange(6000) * 0.01
    between = np.interp(t[:4000], t[:4000:20], rng.standard_normal(200))
    old = interpolated(t, np.concatenate([between, rng.standard_normal(2000)])[:, None])
    assert np.mean(old[:3980]) == pytest.approx(0.95, abs=0.01)
    assert np.mean(old[4010:]) <= 0.5


@pytest.mark.parametrize("digits", [4, 5, 6, 15])
def test_what_is_printed_with_some_digits_is_in_line_with_its_rounding(digits: int) -> None:
    rng = np.random.default_rng(10)
    t = np.arange(4000) * 0.01
    readings = np.round(np.interp(t, t[::10], rng.standard_normal(400)), digits)
    assert np.mean(interpolated(t, readings[:, None])) == pytest.approx(0.9, abs=0.01)


@pytest.mark.filterwarnings("error")
def test_a_column_that_is_never_told_bends_no_line() -> None:
    t = np.arange(1000) * 0.01
    known = np.interp(t, t[::10], np.random.default_rng(11).standard_normal(100))
    assert np.mean(interpolated(t, np.column_stack([known, np.full(1000, np.nan)]))) > 0.85


@pytest.mark.parametrize("ratio", [4.0, 5.3, 20.3])
def test_interpolated_rows_are_found_and_the_nearest_to_a_reading_stay(ratio: float) -> None:
    rng = np.random.default_rng(6)
    t = np.cumsum(0.01 * ratio * (1.0 + 0.1 * rng.standard_normal(ROWS)))
    readings = rng.standard_normal((ROWS, 3))
    rows = np.arange(t[0], t[-1], 0.01) + 0.001 * rng.uniform(-1.0, 1.0, size=len(np.arange(t[0], t[-1], 0.01)))
    between = np.stack([np.interp(rows, t, column) for column in readings.T], axis=-1)
    stay = np.flatnonzero(~interpolated(rows, between))[1:-1]
    before = rows[stay[:, None]] - t[None, :]
    assert abs(len(stay) - ROWS) < 0.01 * ROWS
    assert np.max(np.min(np.abs(before), axis=1)) < 0.013


def test_what_moves_smoothly_or_evenly_is_read() -> None:
    t = np.arange(ROWS) * 0.01
    for readings in (np.sin(0.3 * t), 2.0 * t, 0.0 * t, np.random.default_rng(7).standard_normal(ROWS)):
        assert not np.any(interpolated(t, readings[:, None]))


def test_what_is_not_told_is_held_as_a_number_is() -> None:
    rows = np.repeat(np.random.default_rng(5).standard_normal((ROWS // 4, 2)), 4, axis=0)
    rows[:, 1] = np.nan
    assert np.sum(held(rows)) == ROWS - ROWS // 4
    assert not any(np.any(held(np.zeros((n, 3)))) for n in (0, 1, 2, 50))


def at_the_rate_of_the_imu(recording: Recording, by: str = "held") -> Recording:
    """A table of all sensors at one rate."""
    streams = dict(recording.streams)
    for name in ("gps", "mag", "baro"):
        one, imu = streams[name], streams["imu"].t
        t = imu[(imu >= one.t[0]) & (imu <= one.t[-1])]
        newest, _ = as_held(one.t, t)
        columns = one.columns.items()
        streams[name] = Stream(t, {c: v[newest] if by == "held" else np.interp(t, one.t, v) for c, v in columns})
    return recording.replace(streams=streams)


@pytest.fixture(scope="module")
def apart() -> tuple[Recording, Prepared]:
    """A flight whose sensors have rows of their own, and as it is prepared."""
    recording = fly(21, duration=15.0, sensors=("gps", "mag", "baro"))[0].replace(sensors={})
    return recording, prepared(recording)


@pytest.mark.parametrize("by", ["held", "interpolated"])
def test_a_table_at_one_rate_is_estimated_as_its_readings_are(apart: tuple[Recording, Prepared], by: str) -> None:
    recording, alone = apart
    together = prepared(at_the_rate_of_the_imu(recording, by))
    for name in ("gps", "mag", "baro"):
        rows = [one.recording.streams[name] for one in (alone, together)]
        assert abs(len(rows[0]) - len(rows[1])) < 2
        assert sum(note.startswith(f"{name}: ") and "left out" in note for note in together.notes) == 1
    for size in alone.levels.found:
        off = abs(alone.levels.value(size) - together.levels.value(size))
        assert off < (0.015 if size.linear else 0.5 * alone.levels.value(size)), size


def test_rows_of_declared_noise_stay() -> None:
    recording = at_the_rate_of_the_imu(fly(21, duration=10.0, sensors=("gps", "mag", "baro"))[0])
    assert is_declared(recording)
    partly = recording.replace(sensors={"baro": replace(recording.spec("baro"))})
    assert not any(size.sensor == "baro" for size in sizes_of(partly))
    assert len(prepared(partly).recording.streams["baro"]) == len(recording.streams["baro"])


@pytest.mark.measured
@pytest.mark.parametrize("name", ["quad, laser", "quad, 14 m/s", "F450", "PX4, IMU at 10 Hz", "strapped to a Phantom"])
def test_no_row_of_a_measured_log_is_taken_for_held_or_interpolated(name: str, measured_data: Path) -> None:
    """A laser of 1 cm moves in lines, to its last digit."""
    assert with_readings_alone(resolve(LOGS[name]))[1] == []
