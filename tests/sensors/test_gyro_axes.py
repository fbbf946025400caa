"""A gyroscope with other axes than the accelerometer is told, of simulated and of measured logs, and no other."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from sinan.experiments.datasets import resolve
from sinan.experiments.measured.flights import LOGS
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats import open_log
from sinan.sensors.formats.gyro_axes import with_axes_of_force
from sinan.sensors.formats.plain import write_recording
from sinan.sensors.formats.signed_axes import words_of
from sinan.sensors.recording import GYRO, Recording, Stream
from tests.sensors.test_compass_axes import ONE, log

#: Two axes exchanged, all three, one sign, two.
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
    said = with_axes_of_force(recording)[1]
    return re.findall(r"axes = (\[.*?\])", said[0])[0] if said else ""


@pytest.mark.parametrize("S", [np.array(S, dtype=float) for S in (*OTHERS, -np.eye(3))])
def test_a_turned_gyroscope_is_told_with_its_axes(S: FloatArray) -> None:
    whole = log()
    wrong = with_gyro(whole, S)
    mended, (said,) = with_axes_of_force(wrong)
    assert f"axes = {words_of(S)} in a map" in said or f"axes = {words_of(S)}, or" in said
    assert np.array_equal(mended.streams["imu"].array(GYRO), whole.streams["imu"].array(GYRO))


def test_as_read_and_without_turns_nothing_is_told() -> None:
    assert with_axes_of_force(log())[1] == []
    still = log(about=(0.0, 0.0, 0.0))
    assert with_axes_of_force(with_gyro(still, np.diag([1.0, -1.0, -1.0])))[1] == []
    short = log(seconds=8.0)
    assert with_axes_of_force(with_gyro(short, np.diag([1.0, -1.0, -1.0])))[1] == []


def test_turns_about_the_vertical_alone_leave_the_others_open() -> None:
    assert with_axes_of_force(with_gyro(log(about=ONE), np.diag([1.0, -1.0, -1.0])))[1] == []  # gravity is where it was
    (said,) = with_axes_of_force(with_gyro(log(about=(0.0, 0.0, 3.0)), np.array(OTHERS[1], dtype=float)))[1]
    assert "others that such turns do not tell from it" in said


def test_a_log_is_told_once_and_its_compass_is_not_blamed(tmp_path: Path) -> None:
    write_recording(with_gyro(log(), np.array(OTHERS[1], dtype=float)), tmp_path / "log")
    notes = [note for note in open_log(tmp_path / "log").notes if "axes" in note]
    assert len(notes) == 1
    assert notes[0].startswith("gyro: ")


def in_degrees(recording: Recording) -> Recording:
    """The recording whose rates are in deg/s, and nobody says so."""
    imu = recording.streams["imu"]
    columns = {**imu.columns, **{name: np.rad2deg(imu[name]) for name in GYRO}}
    return recording.replace(streams={**recording.streams, "imu": Stream(imu.t, columns)})


@pytest.mark.parametrize("about", [(1.0, 0.05, 0.05), (0.05, 1.0, 0.05), (1.0, 1.0, 1.0)])
def test_rates_in_degrees_are_refused_whatever_the_axes(about: tuple[float, ...], tmp_path: Path) -> None:
    """Turned to and fro about one level axis, other axes may leave gravity where it is as well."""
    write_recording(in_degrees(log(about=about)), tmp_path / "log")
    with pytest.raises(InputError, match="looks like deg/s"):
        open_log(tmp_path / "log")


def test_where_both_would_do_both_are_named(tmp_path: Path) -> None:
    """One sign is wrong of a body that turns to and fro: as deg/s gravity would stay where it is, too."""
    write_recording(with_gyro(log(), np.diag([1.0, -1.0, 1.0])), tmp_path / "log")
    with pytest.raises(InputError, match=r'looks like deg/s .*has other axes .*axes = \["x", "-y", "z"\]'):
        open_log(tmp_path / "log")


@pytest.mark.measured
@pytest.mark.parametrize(
    ("name", "alone"), [("BROAD 21, fast combined", True), ("robot fast, LSM9DS0", True), ("quad, laser", False)]
)
def test_measured_rates_are_right_as_read_and_told_when_turned(name: str, alone: bool, measured_data: Path) -> None:
    """The quadrotor turns about the vertical alone, by which some axes are not told from others."""
    recording = resolve(LOGS[name])
    assert with_axes_of_force(recording)[1] == []
    wrong = with_gyro(recording, np.array(OTHERS[1], dtype=float))
    (said,) = with_axes_of_force(wrong)[1]
    assert ("others that such turns do not tell" in said) != alone
    if alone:
        assert words_for(wrong) == words_of(np.array(OTHERS[1]))
