"""Tables whose columns say what they are: names and units as loggers write them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sinan.sensors.errors import InputError
from sinan.sensors.formats import open_log
from sinan.sensors.formats.named_columns import Meaning, meaning
from sinan.sensors.recording import ACCEL, GYRO, MAG, POSITION, Recording

GRAVITY = 9.80665


@pytest.mark.parametrize(
    ("name", "column", "unit"),
    [
        ("ax", "accel_x", "m/s^2"), ("Acc_Y", "accel_y", "m/s^2"), ("accel z [g]", "accel_z", "g"),
        ("ax_g", "accel_x", "g"), ("acceleration_x (m/s²)", "accel_x", "m/s^2"), ("AccX", "accel_x", "m/s^2"),
        ("a_RS_S_x [m s^-2]", "accel_x", "m/s^2"), ("w_RS_S_z [rad s^-1]", "gyro_z", "rad/s"),
        ("gx", "gyro_x", "rad/s"), ("gyro_x", "gyro_x", "rad/s"), ("GyrZ_dps", "gyro_z", "deg/s"),
        ("gyro y (°/s)", "gyro_y", "deg/s"), ("mag x [uT]", "mag_x", "uT"), ("mx", "mag_x", ""),
        ("mag_z_mgauss", "mag_z", "mGauss"), ("mag_y [mG]", "mag_y", "mGauss"), ("az_mg", "accel_z", "mg"),
        ("t", "t", "s"), ("t_ms", "t", "ms"), ("#timestamp [ns]", "t", "ns"), ("time_us", "t", "us"),
        ("seconds_elapsed", "t", "s"), ("temp_C", "temperature", "degC"), ("pressure [hPa]", "pressure", "hPa"),
        ("lat", "latitude", "deg"), ("lon [1e-7 deg]", "longitude", "1e-7 deg"), ("vel_n_m/s", "vel_north", "m/s"),
        ("current_mA", "current", "mA"),
    ],
)  # fmt: skip
def test_what_a_name_means(name: str, column: str, unit: str) -> None:
    found = meaning(name)
    assert isinstance(found, Meaning)
    assert (found.column, found.unit) == (column, unit)


@pytest.mark.parametrize(
    "name", ["label", "x", "ax [uT]", "gyro", "accel_x_std", "max", "image x", "status_ms", "", "[g]"]
)
def test_what_a_name_does_not_mean(name: str) -> None:
    assert meaning(name) is None


def table(path: Path, header: str, rows: np.ndarray, delimiter: str = ",") -> Path:
    np.savetxt(path, rows, delimiter=delimiter, header=header, comments="", fmt="%.10g")
    return path


def turning() -> np.ndarray:
    """50 rows: t [ms], force [g], rate [deg/s], field [uT]."""
    k = np.arange(50.0)
    return np.column_stack(
        [10.0 * k, 0 * k, 0 * k, 0 * k - 1.0, 0 * k, 0 * k, 90.0 + 0 * k, 20.0 + k, 0 * k, 40.0 + 0 * k]
    )


HEADER = "t_ms,ax [g],ay [g],az [g],gx [deg/s],gy [deg/s],gz [deg/s],mag x [uT],mag y [uT],mag z [uT]"


def check(recording: Recording) -> None:
    assert recording.kind == "flight"
    np.testing.assert_allclose(recording.streams["imu"].t, 0.01 * np.arange(50), atol=1e-12)
    np.testing.assert_allclose(recording.streams["imu"].array(ACCEL)[0], [0.0, 0.0, -GRAVITY])
    np.testing.assert_allclose(recording.streams["imu"].array(GYRO)[0], [0.0, 0.0, np.pi / 2])
    np.testing.assert_allclose(recording.streams["mag"].array(MAG)[0], [0.2, 0.0, 0.4])
    assert recording.environment.field_unit == "gauss"


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_a_csv_whose_header_says_what_it_is(tmp_path: Path, delimiter: str) -> None:
    check(open_log(table(tmp_path / "log", HEADER.replace(",", delimiter), turning(), delimiter)))


def test_parquet_of_the_same_names(tmp_path: Path) -> None:
    pa, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    columns = dict(zip(HEADER.split(","), turning().T, strict=True)) | {"label": ["a"] * 50}
    parquet.write_table(pa.table(columns), tmp_path / "log")
    check(open_log(tmp_path / "log"))


def test_times_of_parquet(tmp_path: Path) -> None:
    pa, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    stamps = np.datetime64("2024-05-01T12:00:00", "us") + (10_000 * np.arange(50)).astype("timedelta64[us]")
    columns = dict(zip(HEADER.split(",")[1:], turning()[:, 1:].T, strict=True))
    parquet.write_table(pa.table({"timestamp": stamps, **columns}), tmp_path / "log")
    np.testing.assert_allclose(open_log(tmp_path / "log").streams["imu"].t, 0.01 * np.arange(50), atol=1e-6)


def test_parquet_with_a_map(tmp_path: Path) -> None:
    pa, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    parquet.write_table(pa.table({"a": [0.0, 9.8], "b": [9.8, 0.0], "c": [0.1, 0.2]}), tmp_path / "log")
    (tmp_path / "map.toml").write_text('kind = "poses"\n[streams.poses]\naccel = ["a", "b", "c"]\n')
    np.testing.assert_allclose(open_log(tmp_path / "log", tmp_path / "map.toml").streams["poses"]["accel_x"], [0, 9.8])
    with pytest.raises(InputError, match="a Parquet file whose columns do not say what they are"):
        open_log(tmp_path / "log")


def test_what_is_missing_is_named(tmp_path: Path, without_library: Callable[[str], None]) -> None:
    (tmp_path / "log").write_bytes(b"PAR1" + bytes(20) + b"PAR1")
    with pytest.raises(InputError, match="damaged Parquet"):
        open_log(tmp_path / "log")
    without_library("pyarrow")
    with pytest.raises(InputError, match=r"pip install '\.\[parquet\]'"):
        open_log(tmp_path / "log")


def test_readings_of_a_magnetometer_alone_are_poses_in_an_open_unit(tmp_path: Path) -> None:
    rows = np.array([[300.0, 0.0, 100.0], [0.0, 300.0, 100.0], [0.0, 0.0, 400.0]])
    recording = open_log(table(tmp_path / "log", "mx,my,mz", rows))
    assert (recording.kind, recording.environment.field_unit) == ("poses", "")
    np.testing.assert_array_equal(recording.streams["mag"].array(MAG), rows)


def test_what_a_slower_sensor_repeats_counts_once(tmp_path: Path) -> None:
    k = np.arange(50.0)
    slow = np.repeat(np.arange(5.0), 10)
    rows = np.column_stack([turning()[:, :7], 47.0 + 1e-5 * slow, 8.0 + 0 * k, 400.0 + slow, 95_000.0 + slow])
    header = ",".join(HEADER.split(",")[:7]) + ",lat,lon,alt,pressure"
    streams = open_log(table(tmp_path / "log", header, rows)).streams
    np.testing.assert_allclose(streams["gps"].t, 0.1 * np.arange(5))
    np.testing.assert_allclose(streams["gps"].array(POSITION)[-1], [4.447, 0.0, -4.0], atol=0.01)
    assert len(streams["baro"]) == 5


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        (HEADER.replace("[g]", ""), "looks like g"),
        (HEADER.replace("[deg/s]", ""), "looks like deg/s"),
        (HEADER.replace("t_ms", "t"), "looks like ms"),
        (HEADER.replace("ay [g]", "acc_x [g]"), "columns `ax [g]` and `acc_x [g]` for accel_x"),
        (HEADER.replace("t_ms", "label"), "no time among the columns"),
        (HEADER.replace("mag x [uT]", "mag x [gauss]"), "a magnetometer in gauss, uT"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, header: str, expected: str) -> None:
    rows = turning()
    rows[:, 4:7] *= 20.0  # faster than any instrument, if these were rad/s
    with pytest.raises(InputError, match=expected.replace("[", r"\[")):
        open_log(table(tmp_path / "log", header, rows))


def test_a_header_that_says_nothing_needs_a_map(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="text or unknown data"):
        open_log(table(tmp_path / "log", "one,two,three", np.eye(3)))
