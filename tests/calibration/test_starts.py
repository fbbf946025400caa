"""A log that begins badly: a first reading far off, a compass that was never calibrated, no velocity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.calibration.levels import fields
from sinan.calibration.levels.preparation import Prepared, is_declared, prepared
from sinan.estimator.filter.layout import P_N, Q_NB
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import MAG, VELOCITY, Initial, Recording, Stream
from sinan.sensors.rotation import quaternion_conjugate, quaternion_log, quaternion_multiply
from tests.estimator.analytic_flight import RATES, fly


def undeclared(*sensors: str) -> tuple[Recording, FloatArray]:
    """Half a minute that declares nothing but its field, and the true states; an IMU of 50 Hz."""
    recording, truth = fly(1, duration=30.0, sensors=sensors, rates={**RATES, "imu": 50.0})
    return recording.replace(sensors={}, initial=Initial()), truth


@pytest.fixture(scope="module")
def flown() -> tuple[Recording, FloatArray]:
    return undeclared("mag", "gps")


def with_stream(recording: Recording, name: str, **columns: FloatArray) -> Recording:
    """With other columns in a stream."""
    stream = recording.streams[name]
    return recording.replace(streams={**recording.streams, name: Stream(stream.t, {**stream.columns, **columns})})


def attitude_error(ready: Prepared, truth: FloatArray) -> FloatArray:
    """(n,) of the filter [deg]."""
    off = quaternion_multiply(quaternion_conjugate(truth[:, Q_NB]), ready.run().imu_x[:, Q_NB])
    return np.asarray(np.rad2deg(np.linalg.norm(quaternion_log(off), axis=1)))


@pytest.mark.parametrize(("name", "column", "off"), [("gps", "north", 500.0), ("baro", "height", -1000.0)])
def test_one_first_reading_does_not_move_a_flight(name: str, column: str, off: float) -> None:
    """All readings after it were doubted: a first fix 500 m off moved an aeroplane by 490 m for good, a first height
    1000 m off lifted one by 840 m.
    """
    recording, truth = undeclared(*dict.fromkeys(("mag", name, "gps")))
    wrong = recording.streams[name][column].copy()
    wrong[0] += off
    ready = prepared(with_stream(recording, name, **{column: wrong}))
    assert (
        f"{name}: the first reading, far from what follows as no motion is, left out: it had not settled" in ready.notes
    )
    away = ready.run().imu_x[:, P_N] - truth[:, P_N]
    assert np.sqrt(np.mean(np.sum(away[len(away) // 2 :] ** 2, axis=1))) < 5.0


def test_velocities_of_zero_are_none(flown: tuple[Recording, FloatArray]) -> None:
    """Such a log was refused: its velocities are without any noise."""
    recording, truth = flown
    zero = np.zeros(len(recording.streams["gps"]))
    still = with_stream(recording, "gps", **dict.fromkeys(VELOCITY, zero))
    assert not is_declared(still)
    ready = prepared(still)
    assert "gps: its velocity never changes: it tells none, left out" in ready.notes
    assert np.max(attitude_error(ready, truth)[len(truth) // 2 :]) < 5.0


def test_velocities_of_zero_are_none_where_all_else_is_declared() -> None:
    """Such a log was refused for a velocity noise that it does not declare."""
    recording, _ = fly(1, duration=5.0)
    silent = replace(recording.spec("gps"), velocity_noise_std=None)
    recording = recording.replace(sensors={**recording.sensors, "gps": silent})
    zero = np.zeros(len(recording.streams["gps"]))
    ready = prepared(with_stream(recording, "gps", **dict.fromkeys(VELOCITY, zero)))
    assert "gps: its velocity never changes: it tells none, left out" in ready.notes


@pytest.mark.parametrize("turns_show_it", [True, False])
def test_a_compass_beside_iron_does_not_tell_the_first_heading(
    flown: tuple[Recording, FloatArray], turns_show_it: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was 91 deg off, and 4 after half a minute. The turns show the iron; else all headings are tried."""
    if not turns_show_it:
        monkeypatch.setattr(fields, "iron_of_turns", lambda recording, std, rate_std: (np.zeros(3), std))
    recording, truth = flown
    mag, gps = (recording.streams[name] for name in ("mag", "gps"))
    norm = np.median(np.linalg.norm(mag.array(MAG), axis=1))
    beside = with_stream(
        recording, "mag", **{axis: mag[axis] + norm * iron for axis, iron in zip(MAG, (-0.5, 0.4, 0.2), strict=True)}
    )
    places = Stream(gps.t, {name: column for name, column in gps.columns.items() if name not in VELOCITY})
    ready = prepared(beside.replace(streams={**beside.streams, "gps": places}))
    assert any(note.startswith("heading: ") for note in ready.notes) != turns_show_it
    error = attitude_error(ready, truth)
    assert error[0] < 25.0
    assert np.max(error[len(error) // 2 :]) < 2.0


def test_a_compass_that_tells_the_heading_is_left_alone(flown: tuple[Recording, FloatArray]) -> None:
    ready = prepared(flown[0])
    assert not any(note.startswith("heading: ") for note in ready.notes)
    assert ready.recording.initial.quaternion is None
