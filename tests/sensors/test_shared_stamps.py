"""A clock that is coarser than the rows of a log: several rows have one stamp."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sinan.sensors.arrays import FloatArray
from sinan.sensors.formats import open_log
from sinan.sensors.formats.coarse_clock import spread

STEP = 0.005  # s


def rows(n: int, seed: int = 1) -> FloatArray:
    return np.random.default_rng(seed).standard_normal(n)


@pytest.mark.parametrize("digit", [0.01, 0.02, 0.1])
def test_truncated_stamps_come_out_as_they_were(digit: float) -> None:
    t = 0.001 + STEP * np.arange(400)
    found, (said,) = spread(digit * np.floor(t / digit))
    assert said.startswith(f"{400 - len(np.unique(np.floor(t / digit)))} rows have the stamp of the row before")
    assert np.all(np.diff(found) > 0.0)
    assert np.max(np.abs(found - t)) < STEP


def test_rows_before_a_gap_are_not_put_into_it() -> None:
    found, _ = spread(np.concatenate([np.repeat(0.01 * np.arange(10), 2), np.repeat(5.0 + 0.01 * np.arange(10), 2)]))
    assert found[19] == pytest.approx(0.095)
    assert found[-1] == pytest.approx(5.095)


@pytest.mark.parametrize("t", [np.zeros(0), np.zeros(1), np.zeros(3), np.arange(5.0), np.array([0.0, 0.0, 2.0, 1.0])])
def test_other_clocks_stay(t: FloatArray) -> None:
    found, said = spread(t)
    assert np.array_equal(found, t)
    assert said == []


def test_of_a_table_and_of_a_map_no_row_is_lost(tmp_path: Path) -> None:
    """A barometer of 50 Hz that is held in rows of 200 Hz comes where it stands."""
    t = STEP * np.arange(1000)
    names = ("t", "ax", "ay", "az", "gx", "gy", "gz", "baro_alt [m]")
    readings = [0.1 * rows(1000, k) - (9.81 if k == 3 else 0.0) for k in range(1, 4)]
    rates = [0.01 * rows(1000, k) for k in range(4, 7)]
    table = np.column_stack([t, *readings, *rates, np.repeat(rows(250, 7), 4)])
    fmt = ["%.2f"] + ["%.6f"] * 7
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=",".join(names), comments="", fmt=fmt)
    rules = 'kind = "flight"\n[file]\nheader = true\n[streams.imu]\ntime = "t"\n'
    rules += 'accel = ["ax", "ay", "az"]\ngyro = ["gx", "gy", "gz"]\n'
    rules += '[streams.baro]\ntime = "t"\nheight = "baro_alt [m]"\ndrop = ["held value"]\n'
    (tmp_path / "log.toml").write_text(rules)
    for recording in (open_log(tmp_path / "log.csv"), open_log(tmp_path / "log.csv", tmp_path / "log.toml")):
        imu, baro = recording.streams["imu"], recording.streams["baro"]
        assert len(imu) == 1000
        assert np.max(np.abs(imu.t - imu.t[0] - t)) < 0.011
        assert np.allclose(baro.t, imu.t[::4])
        assert any("have the stamp of the row before: put evenly" in note for note in recording.notes)
