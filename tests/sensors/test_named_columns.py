"""Tables whose columns say what they are: names and units as loggers write them."""

from __future__ import annotations

import gzip
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sinan.sensors.errors import InputError
from sinan.sensors.formats import open_log
from sinan.sensors.formats.column_names import Meaning, meaning
from sinan.sensors.recording import ACCEL, GYRO, MAG, POSITION, Recording
from sinan.sensors.window import clock_warnings, window

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
        ("AccelX (m/s^2)", "accel_x", "m/s^2"), ("IMU_AccelZ", "accel_z", "m/s^2"), ("imuGyroY", "gyro_y", "rad/s"),
        ("AngleRateX (rad/s)", "gyro_x", "rad/s"), ("AngRateZ [deg/s]", "gyro_z", "deg/s"),
        ("GyroX", "gyro_x", "rad/s"),
        ("MagFieldY (G)", "mag_y", "gauss"), ("RawMagX", "mag_x", ""), ("TimeFromStart (s)", "t", "s"),
        ("Time_s", "t", "s"), ("TimeUS", "t", "us"), ("time_boot_ms", "t", "ms"), ("Timestamp [ms]", "t", "ms"),
        ("%time", "t", "ns"), ("field.linear_acceleration.x", "free_x", "m/s^2"),
        ("field.angular_velocity.z", "gyro_z", "rad/s"), ("GNSSPosLat (deg)", "latitude", "deg"),
        ("GNSSPosLon", "longitude", "deg"), ("gps_pos_alt", "height", "m"), ("GNSSVelN", "vel_north", "m/s"),
        ("GpsVelE (m/s)", "vel_east", "m/s"), ("gps_vd", "vel_down", "m/s"), ("velocity_down", "vel_down", "m/s"),
        ("BaroAlt (m)", "height", "m"), ("vias", "airspeed", "m/s"),
    ],
)  # fmt: skip
def test_what_a_name_means(name: str, column: str, unit: str) -> None:
    found = meaning(name)
    assert isinstance(found, Meaning)
    assert (found.column, found.unit) == (column, unit)


@pytest.mark.parametrize(
    "name",
    [
        "label", "x", "ax [uT]", "gyro", "accel_x_std", "max", "image x", "status_ms", "", "[g]", "nav_lat", "nav_alt",
        "GNSSTime", "field.header.stamp", "AccelX_filtered", "INSVelN", "throttle",
    ],
)  # fmt: skip
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
    with pytest.raises(InputError, match=r"pip install -e '\.\[parquet\]'"):
        open_log(tmp_path / "log")


def test_readings_of_a_magnetometer_alone_are_poses_in_an_open_unit(tmp_path: Path) -> None:
    rows = np.array([[300.0, 0.0, 100.0], [0.0, 300.0, 100.0], [0.0, 0.0, 400.0]])
    recording = open_log(table(tmp_path / "log", "mx,my,mz", rows))
    assert (recording.kind, recording.environment.field_unit) == ("poses", "")
    np.testing.assert_array_equal(recording.streams["mag"].array(MAG), rows)


def test_what_a_slower_sensor_repeats_counts_once(tmp_path: Path) -> None:
    k = np.arange(50.0)
    slow = np.repeat(np.arange(5.0), 10)
    rows = np.column_stack([turning()[:, :7], 47.0 + 1e-5 * slow, 8.0 + 0 * k, 400.0 + slow, 95_000.0 + slow**2])
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
        (HEADER.replace("ay [g]", "acc_x [g]"), "columns `ax [g]` and `acc_x [g]` for accel_x"),
        (HEADER.replace("t_ms", "label"), "no time among the columns"),
        (HEADER.replace("t_ms", "label"), "`time = { rate = 100 }`"),
        (HEADER.replace("mag x [uT]", "mag x [gauss]"), "a magnetometer in gauss, uT"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, header: str, expected: str) -> None:
    rows = turning()
    rows[:, 4:7] *= 20.0  # faster than any instrument, if these were rad/s
    with pytest.raises(InputError, match=expected.replace("[", r"\[")):
        open_log(table(tmp_path / "log", header, rows))


@pytest.mark.parametrize(
    ("column", "expected"),
    [
        (3, "stream imu: an accelerometer without z: `ax [g]`, `ay [g]` alone"),
        (5, "stream imu: a gyroscope without y: `gx [deg/s]`, `gz [deg/s]` alone"),
    ],
)
def test_an_imu_that_lacks_an_axis_is_not_left_out(tmp_path: Path, column: int, expected: str) -> None:
    """The magnetometer that remains would be a flight, which then has no IMU."""
    names, rows = HEADER.split(","), turning()
    left = [k for k in range(len(names)) if k != column]
    with pytest.raises(InputError, match=re.escape(expected)):
        open_log(table(tmp_path / "log", ",".join(names[k] for k in left), rows[:, left]))


def test_a_header_that_says_nothing_needs_a_map(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"unknown data: no accelerometer .* among the columns `one, two, three`"):
        open_log(table(tmp_path / "log", "one,two,three", np.eye(3)))


def test_two_lines_of_names_are_seen(tmp_path: Path) -> None:
    """Names of the sensor over those of the axis: a map as the message says reads it."""
    rows = np.column_stack([np.arange(20.0), np.tile([0.3, 0.0, -9.8], (20, 1))])
    path = table(tmp_path / "log", "sensor,left,left,left\naxis,acc_x,acc_y,acc_z", rows)
    with pytest.raises(InputError, match=r"two lines of names \(`sensor, left, .*`; `axis, .*skip_lines = 2"):
        open_log(path)
    text = 'kind = "poses"\n[file]\nskip_lines = 2\ncolumns = ["n", "x", "y", "z"]\n'
    text += '[streams.poses]\naccel = ["x", "y", "z"]\n'
    (tmp_path / "map.toml").write_text(text)
    assert len(open_log(path, tmp_path / "map.toml").streams["poses"]) == 20


def test_a_topic_as_rostopic_prints_it(tmp_path: Path) -> None:
    rows = turning()
    rows = np.column_stack([1e7 * np.arange(50.0), np.arange(50.0), GRAVITY * rows[:, 1:4], np.radians(rows[:, 4:7])])
    axes = [f"field.{what}.{axis}" for what in ("linear_acceleration", "angular_velocity") for axis in "xyz"]
    streams = open_log(table(tmp_path / "log", ",".join(["%time", "field.header.seq", *axes]), rows)).streams
    np.testing.assert_allclose(streams["imu"].t, 0.01 * np.arange(50), atol=1e-9)
    np.testing.assert_allclose(streams["imu"].array(GYRO)[0], [0.0, 0.0, np.pi / 2])


FLIGHT = ("TimeFromStart (s),AccelX (m/s^2),AccelY (m/s^2),AccelZ (m/s^2),"
          "AngRateX (rad/s),AngRateY (rad/s),AngRateZ (rad/s),"
          "GNSSPosLat (deg),GNSSPosLon (deg),GNSSPosAlt (m),GNSSVelN,GNSSVelE,GNSSVelD,vias,nav_lat")  # fmt: skip


def flown() -> np.ndarray:
    """200 rows, 20 ms apart, of the columns of `FLIGHT`: a circle of 20 m/s."""
    k = np.arange(200.0)
    a, zero, second = 0.5 * 0.02 * k, 0.0 * k, np.floor(k / 50.0)
    course = 0.5 * second
    return np.column_stack([
        0.02 * k, zero, zero + 10.0, zero - GRAVITY + 0.3 * np.sin(a), zero, zero, zero + 0.5,
        45.0 + 1e-5 * np.sin(course), 8.0 + 1e-5 * np.cos(course), zero + 400.0,
        20.0 * np.cos(course), 20.0 * np.sin(course), zero, 20.0 + np.sin(a), zero + 45.0,
    ])  # fmt: skip


def test_names_of_a_sensor_an_axis_and_a_unit_are_a_flight(tmp_path: Path) -> None:
    recording = open_log(table(tmp_path / "log", FLIGHT, flown()))
    assert recording.kind == "flight"
    assert {name: len(stream) for name, stream in recording.streams.items()} == {"imu": 200, "gps": 4, "air": 200}
    np.testing.assert_allclose(recording.streams["gps"]["vel_east"], 20.0 * np.sin(0.5 * np.arange(4)), atol=1e-9)
    np.testing.assert_allclose(recording.streams["imu"].array(GYRO)[7], [0.0, 0.0, 0.5])
    assert "columns not read: nav_lat" in recording.notes
    assert any("an indicated airspeed stands for the true one" in note for note in recording.notes)


def test_readings_milliseconds_apart_are_no_poses(tmp_path: Path) -> None:
    """Without a gyroscope that is known such a table is no flight, and one pose a row it is not."""
    header = FLIGHT.replace("AngRate", "Swing")
    with pytest.raises(InputError, match=r"0.02 s and no gyroscope.*not read: SwingX \(rad/s\)") as caught:
        open_log(table(tmp_path / "log", header, flown()))
    assert "gyro_x, gyro_y, gyro_z [rad/s], a map" in str(caught.value)


def test_poses_that_say_when_they_were_taken_stay_poses(tmp_path: Path) -> None:
    k = np.arange(20.0)
    rows = np.column_stack([3.0 * k, GRAVITY * np.cos(k), GRAVITY * np.sin(k), 0 * k])
    recording = open_log(table(tmp_path / "log", "t,ax,ay,az", rows))
    assert (recording.kind, len(recording.streams["poses"])) == ("poses", 20)


def cut(path: Path, text: str) -> Path:
    path.write_bytes(gzip.compress(text.encode()) if path.suffix == ".gz" else text.encode())
    return path


CUT = "the last line is cut off after 4 of 10 columns, left out"


@pytest.mark.parametrize("origin", [0.0, 12.3, 1700.7])
def test_a_clock_that_goes_back_for_seconds_is_told_with_what_avoids_it(tmp_path: Path, origin: float) -> None:
    """Of thirty seconds the clock goes back by five after fifteen; one that goes back for ten rows is no word."""
    t = 0.01 * np.arange(3000)
    late = origin + np.where(t < 15.0, t, t - 5.0)
    swapped = np.concatenate([t[:500], t[500:510][::-1], t[510:]])
    said = {}
    for name, stamps in (("late", late), ("swapped", swapped)):
        rows = "".join(f"{1000.0 * one:.0f},0,0,-1,0,0,0,20,0,40\n" for one in stamps)
        (tmp_path / f"{name}.csv").write_text(f"{HEADER}\n{rows}")
        said[name] = open_log(tmp_path / f"{name}.csv")
    (sentence,) = clock_warnings(said["late"])
    assert sentence.startswith("the clock goes back by 4.99 s at 14.99 s")
    assert sentence.endswith(": `--to 10` or `--from 15` leaves it out")
    assert clock_warnings(window(said["late"], (None, 10.0))) == []
    assert clock_warnings(window(said["late"], (15.0, None))) == []
    assert len(clock_warnings(window(said["late"], (11.0, 20.0)))) == 1
    assert clock_warnings(said["swapped"]) == []


def test_a_last_line_that_lost_its_end_is_left_out_with_a_note(tmp_path: Path) -> None:
    text = table(tmp_path / "whole", HEADER, turning()).read_text()
    recording = open_log(cut(tmp_path / "log.csv", text + "500,0,0,-1"))
    check(recording)
    assert recording.notes[0] == CUT


@pytest.mark.parametrize("name", ["log.csv", "log.csv.gz"])
def test_a_map_leaves_such_a_line_out_too(tmp_path: Path, name: str) -> None:
    text = table(tmp_path / "whole", HEADER, turning()).read_text()
    rules = (
        'kind = "flight"\n[file]\nheader = true\n[streams.imu]\ntime = { column = "t_ms", unit = "ms" }\n'
        'accel = { columns = ["ax [g]", "ay [g]", "az [g]"], unit = "g" }\n'
        'gyro = { columns = ["gx [deg/s]", "gy [deg/s]", "gz [deg/s]"], unit = "deg/s" }\n'
    )
    (tmp_path / "map.toml").write_text(rules)
    mapped = open_log(cut(tmp_path / name, text + "500,0,0,-1"), tmp_path / "map.toml")
    assert len(mapped.streams["imu"]) == 50
    assert CUT in mapped.notes


@pytest.mark.parametrize("short", ["500,0,0,-1\n", "500,0,0\n510,0,0,-1,0,0,0,20,0,40", "500,0,0,-1,0,0,0,20,0,4O"])
def test_any_other_bad_row_is_an_error(tmp_path: Path, short: str) -> None:
    """Short, but ended; short, and not the last; with all its columns, but no number."""
    text = table(tmp_path / "whole", HEADER, turning()).read_text()
    with pytest.raises(InputError, match=r"row 51 \(line 52\)"):
        open_log(cut(tmp_path / "log.csv", text + short))


def test_a_last_line_with_all_its_columns_is_a_row(tmp_path: Path) -> None:
    text = table(tmp_path / "whole", HEADER, turning()).read_text()
    recording = open_log(cut(tmp_path / "log.csv", text.rstrip("\n")))
    check(recording)
    assert not any("cut off" in note for note in recording.notes)
