"""A recording that is being written: what is in it after every row, and after any cut."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sinan.sensors.errors import InputError
from sinan.sensors.formats.growing import GrowingRecording
from sinan.sensors.formats.plain import read_recording
from sinan.sensors.recording import ACCEL, GYRO, QUATERNION, Environment, Stream

PART = "a part: what wrote it was cut off, or goes on; rows that are not whole are left out"


def imu(t: np.ndarray) -> Stream:
    values = np.column_stack(
        [0.1 * np.sin(t), 0.1 * np.cos(t), -9.8 + 0.0 * t, *(0.01 * np.sin(k * t) for k in range(3))]
    )
    return Stream(t, dict(zip((*ACCEL, *GYRO), values.T, strict=True)))


def growing(folder: Path) -> GrowingRecording:
    return GrowingRecording(folder / "run", "flight", Environment(field_unit="gauss"))


def test_it_can_be_read_at_any_time_and_is_whole_at_its_end(tmp_path: Path) -> None:
    recording = growing(tmp_path)
    assert not (tmp_path / "run").exists()
    t = 0.02 * np.arange(1, 61) + 1.0 / 3.0
    for k in range(0, 60, 20):
        recording.append("imu", imu(t[k : k + 20]))
        part = read_recording(tmp_path / "run")
        assert PART in part.notes
        np.testing.assert_array_equal(part.streams["imu"].t, t[: k + 20])
    recording.append("truth", Stream(t, dict(zip(QUATERNION, np.tile([1.0, 0.0, 0.0, 0.0], (60, 1)).T, strict=True))))
    recording.finish()
    whole = read_recording(tmp_path / "run")
    assert whole.notes == ()
    np.testing.assert_array_equal(whole.streams["imu"]["accel_x"], imu(t)["accel_x"])
    assert whole.truth is not None
    assert (whole.truth.kind, whole.truth.aligned) == ("autopilot", True)


def test_a_cut_costs_the_row_that_it_hits(tmp_path: Path) -> None:
    recording = growing(tmp_path)
    recording.append("imu", imu(0.02 * np.arange(1, 6)))
    path = tmp_path / "run" / "imu.csv"
    text = path.read_bytes()
    header = text.index(b"\n") + 1
    for size in range(header + 10, len(text), 7):
        path.write_bytes(text[:size])
        rows = text[:size].count(b"\n") - 1
        if rows == 0:
            with pytest.raises(InputError, match="no stream"):
                read_recording(tmp_path / "run")
        else:
            assert len(read_recording(tmp_path / "run").streams["imu"]) == rows
    recording.append("baro", Stream(np.array([1.0]), {"pressure": np.array([95_000.0])}))
    (tmp_path / "run" / "baro.csv").write_text("t,press")
    assert set(read_recording(tmp_path / "run").streams) == {"imu"}


def test_rows_that_cannot_be_are_left_out_and_counted(tmp_path: Path) -> None:
    recording = growing(tmp_path)
    bad = imu(np.array([0.1, 0.2, 0.15, 0.3, 0.4, np.nan]))
    bad.columns["accel_y"][3] = np.nan
    assert recording.append("imu", bad).t.tolist() == [0.1, 0.2, 0.4]
    assert recording.append("imu", imu(np.array([0.3, 0.4, 0.5]))).t.tolist() == [0.5]
    assert recording.left_out == {"imu": 4}
    place = {"latitude": np.array([47.0, 47.0]), "longitude": np.zeros(2), "height": np.zeros(2)}
    recording.append("gps", Stream(np.array([0.1, 0.2]), {**place, "eph": np.array([1.0, np.nan])}))
    recording.finish()
    whole = read_recording(tmp_path / "run")
    assert len(whole.streams["gps"]) == 2
    assert "gps.csv: not numbers throughout, left out: eph" in whole.notes


def test_nothing_is_no_recording(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not one reading"):
        growing(tmp_path).finish()
    assert not (tmp_path / "run").exists()
