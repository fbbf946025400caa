"""A clock that is coarser than the rows of a log: several different rows have one stamp."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sinan.sensors.arrays import FloatArray
from sinan.sensors.formats import open_log
from sinan.sensors.formats.logged import spread
from sinan.sensors.recording import Stream

STEP = 0.005  # s


def rows(n: int, seed: int = 1) -> FloatArray:
    return np.random.default_rng(seed).standard_normal(n)


@pytest.mark.parametrize("digit", [0.01, 0.02, 0.1])
def test_truncated_stamps_come_out_as_they_were(digit: float) -> None:
    t = 0.001 + STEP * np.arange(400)
    stream, count = spread(Stream(digit * np.floor(t / digit), {"x": rows(400)}))
    assert count == 400 - len(np.unique(np.floor(t / digit)))
    assert np.all(np.diff(stream.t) > 0.0)
    assert np.max(np.abs(stream.t - t)) < STEP


def test_rows_before_a_gap_are_not_put_into_it() -> None:
    t = np.concatenate([np.repeat(0.01 * np.arange(10), 2), np.repeat(5.0 + 0.01 * np.arange(10), 2)])
    stream, _ = spread(Stream(t, {"x": rows(40)}))
    assert stream.t[19] == pytest.approx(0.095)
    assert stream.t[-1] == pytest.approx(5.095)


def test_a_row_that_is_there_twice_is_one_reading_and_stamps_that_differ_stay() -> None:
    x = rows(20)
    stream, count = spread(Stream(np.repeat(0.01 * np.arange(20), 2), {"x": np.repeat(x, 2)}))
    assert count == 0
    assert np.array_equal(stream.t, np.repeat(0.01 * np.arange(20), 2))
    t = np.sort(rows(50))
    assert np.array_equal(spread(Stream(t, {"x": rows(50, 2)}))[0].t, t)
    for few in (np.zeros(0), np.zeros(1), np.zeros(3)):
        assert spread(Stream(few, {"x": rows(len(few))}))[1] == 0


def test_of_a_table_and_of_a_map_no_row_is_lost(tmp_path: Path) -> None:
    t = STEP * np.arange(1000)
    names = ("t", "ax", "ay", "az", "gx", "gy", "gz")
    readings = [0.1 * rows(1000, k) - (9.81 if k == 3 else 0.0) for k in range(1, 4)]
    table = np.column_stack([t, *readings, *(0.01 * rows(1000, k) for k in range(4, 7))])
    fmt = ["%.2f"] + ["%.6f"] * 6
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=",".join(names), comments="", fmt=fmt)
    rules = 'kind = "flight"\n[file]\nheader = true\n[streams.imu]\ntime = "t"\n'
    rules += 'accel = ["ax", "ay", "az"]\ngyro = ["gx", "gy", "gz"]\n'
    (tmp_path / "log.toml").write_text(rules)
    for recording in (open_log(tmp_path / "log.csv"), open_log(tmp_path / "log.csv", tmp_path / "log.toml")):
        imu = recording.streams["imu"]
        assert len(imu) == 1000
        assert np.max(np.abs(imu.t - imu.t[0] - t)) < 0.011
        assert any("have the stamp of the row before: put evenly" in note for note in recording.notes)
