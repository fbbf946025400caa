"""A gyroscope with other axes than the accelerometer is told, of simulated and of measured logs, and no other."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from sinan.experiments.datasets import resolve
from sinan.experiments.measured.flights import LOGS
from sinan.sensors.arrays import FloatArray
from sinan.sensors.formats import open_log
from sinan.sensors.formats.gyro_axes import turned
from sinan.sensors.formats.plain import write_recording
from sinan.sensors.formats.signed_axes import words_of
from sinan.sensors.recording import GYRO, Recording, Stream
from tests.sensors.test_compass_axes import ONE, log

#: One of each kind: two axes exchanged, all three, one sign, two, a mirror image.
OTHERS = (
    [[0, 1, 0], [1, 0, 0], [0, 0, 1]],
    [[0, 0, 1], [1, 0, 0], [0, 1, 0]],
    np.diag([1, -1, 1]),
    np.diag([-1, -1, 1]),
)


def with_gyro(recording: Recording, S: FloatArray) -> Recording:
    """The recording whose gyroscope is mounted with other axes: those of the body are S times its own."""
    imu = recording.streams["imu"]
    columns = {**imu.columns, **dict(zip(GYRO, (imu.array(GYRO) @ S).T, strict=True))}
    return recording.replace(streams={**recording.streams, "imu": Stream(imu.t, columns)})


def words_for(recording: Recording) -> str:
    """The axes that the sentence has; empty: there is no sentence."""
    said = turned(recording)[1]
    return re.findall(r"axes = (\[.*?\])", said[0])[0] if said else ""


@pytest.mark.parametrize("S", [np.array(S, dtype=float) for S in (*OTHERS, -np.eye(3))])
def test_a_turned_gyroscope_is_told_with_its_axes(S: FloatArray) -> None:
    whole = log()
    wrong = with_gyro(whole, S)
    mended, (said,) = turned(wrong)
    assert f"axes = {words_of(S)} in a map" in said or f"axes = {words_of(S)}, or" in said
    assert np.array_equal(mended.streams["imu"].array(GYRO), whole.streams["imu"].array(GYRO))


def test_as_read_and_without_turns_nothing_is_told() -> None:
    assert turned(log())[1] == []
    still = log(about=(0.0, 0.0, 0.0))
    assert turned(with_gyro(still, np.diag([1.0, -1.0, -1.0])))[1] == []
    short = log(seconds=8.0)
    assert turned(with_gyro(short, np.diag([1.0, -1.0, -1.0])))[1] == []


def test_turns_about_the_vertical_alone_leave_the_others_open() -> None:
    assert turned(with_gyro(log(about=ONE), np.diag([1.0, -1.0, -1.0])))[1] == []  # gravity is where it was
    (said,) = turned(with_gyro(log(about=(0.0, 0.0, 3.0)), np.array(OTHERS[1], dtype=float)))[1]
    assert "others that such turns do not tell from it" in said


def test_a_log_is_told_once_and_its_compass_is_not_blamed(tmp_path: Path) -> None:
    """Nor are the rates taken for deg/s, with which gravity would stay where it is, too."""
    write_recording(with_gyro(log(), np.diag([1.0, -1.0, 1.0])), tmp_path / "log")
    notes = [note for note in open_log(tmp_path / "log").notes if "axes" in note]
    assert len(notes) == 1
    assert notes[0].startswith("gyro: ")


@pytest.mark.measured
@pytest.mark.parametrize("name", ["BROAD 21, fast combined", "robot fast, LSM9DS0", "quad, laser"])
def test_measured_rates_are_right_as_read_and_told_when_turned(name: str, measured_data: Path) -> None:
    """The quadrotor turns about the vertical alone, by which some axes are not told from others."""
    recording = resolve(LOGS[name])
    assert turned(recording)[1] == []
    wrong = with_gyro(recording, np.array(OTHERS[1], dtype=float))
    (said,) = turned(wrong)[1]
    assert words_for(wrong) == words_of(np.array(OTHERS[1])) or "others that such turns do not tell" in said
