"""Tables that ulog2csv makes of a ULog: they are read as the log itself, and what is wrong with a folder is said."""

from __future__ import annotations

import contextlib
import io
import math
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sinan.sensors.errors import InputError
from sinan.sensors.formats import facts_of, open_log, what_is
from sinan.sensors.formats.choice import Choice
from sinan.sensors.formats.happenings import happenings_of
from sinan.sensors.recording import ACCEL, GYRO, QUATERNION, Recording
from tests.sensors.test_ulog import DAMAGED, SENSOR, TIMES, WHOLE, topics_of, two_of_each

#: Half a unit in the last place of a float of 32 bits, of which a table has the shortest text.
FLOAT = 2.0**-24
COMBINED = "timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2]," + ",".join(f"accelerometer_m_s2[{k}]" for k in range(3))


def tables_of(log: Path, folder: Path) -> Path:
    """The folder that PX4's own program makes of a log."""
    convert = pytest.importorskip("pyulog.ulog2csv").convert_ulog2csv
    folder.mkdir()
    with contextlib.redirect_stdout(io.StringIO()):
        convert(str(log), None, str(folder), ",", None, None)
    return folder


def assert_same(found: Recording, expected: Recording) -> None:
    assert (found.name, found.kind, found.notes) == (expected.name, expected.kind, expected.notes)
    assert (found.sensors, found.origin, found.log_start) == (expected.sensors, expected.origin, expected.log_start)
    assert found.environment == expected.environment
    assert found.streams.keys() == expected.streams.keys()
    for name, stream in expected.streams.items():
        np.testing.assert_array_equal(found.streams[name].t, stream.t, err_msg=name)
        assert found.streams[name].columns.keys() == stream.columns.keys()
        for column, values in stream.columns.items():
            np.testing.assert_allclose(found.streams[name][column], values, rtol=2.1 * FLOAT, atol=1e-12)
    assert (found.truth is None) == (expected.truth is None)
    if expected.truth is not None and found.truth is not None:
        assert (found.truth.kind, found.truth.aligned) == (expected.truth.kind, expected.truth.aligned)
        np.testing.assert_array_equal(found.truth.stream.t, expected.truth.stream.t)
        quaternions = (truth.stream.array(QUATERNION) for truth in (found.truth, expected.truth))
        np.testing.assert_allclose(*quaternions, atol=FLOAT)


# --- as the log itself -----------------------------------------------------------------------------------


@pytest.mark.measured
def test_a_measured_log_is_read_as_its_tables_are(measured_data: Path, tmp_path: Path) -> None:
    folder = tables_of(measured_data / WHOLE, tmp_path / "log")
    expected = open_log(measured_data / WHOLE)
    assert {"imu", "mag", "baro", "gps", "laser", "power", "motors"} <= set(expected.streams)
    assert_same(open_log(folder), expected)
    assert happenings_of(folder) == happenings_of(measured_data / WHOLE) != []


@pytest.mark.measured
@pytest.mark.parametrize("choice", [Choice(), Choice(imu=1), Choice(mag=1), Choice(raw=True)], ids=str)
def test_what_pyulog_reads_of_a_damaged_log_is_in_it(measured_data: Path, tmp_path: Path, choice: Choice) -> None:
    folder = tables_of(measured_data / DAMAGED, tmp_path / "log")
    found, whole = open_log(folder, choice=choice), open_log(measured_data / DAMAGED, choice=choice)
    assert (found.sensors, found.streams.keys()) == (whole.sensors, whole.streams.keys())
    for name, stream in found.streams.items():
        common = np.isin(whole.streams[name].t, stream.t)
        assert np.sum(common) == len(stream) > 0.95 * len(common)
        columns = [one for one in stream.columns if one not in ("north", "east", "down")]
        expected = whole.streams[name].rows(common).array(columns)
        np.testing.assert_allclose(stream.array(columns), expected, rtol=2.1 * FLOAT, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("choice", [Choice(), Choice(imu=1), Choice(mag=1), Choice(raw=True)], ids=str)
def test_a_written_log_is_read_as_its_tables_are(tmp_path: Path, choice: Choice) -> None:
    log = two_of_each(tmp_path / "flight_01.ulg")
    assert_same(open_log(tables_of(log, tmp_path / "other name"), choice=choice), open_log(log, choice=choice))


def test_facts_are_those_of_the_log_but_for_what_no_table_has(tmp_path: Path) -> None:
    log = two_of_each(tmp_path / "flight.ulg")
    found, expected = facts_of(tables_of(log, tmp_path / "tables")), facts_of(log)
    assert found is not None
    assert expected is not None
    assert (found.instances, found.autopilot, found.parameters) == (expected.instances, "PX4", {})
    assert [(one.name, one.rows, one.span) for one in found.tables] == [
        (one.name, one.rows, one.span) for one in expected.tables
    ]


@pytest.mark.parametrize("name", ["sensor_combined_0", "sensor_mag_1", "cpuload_0"])
def test_one_table_stands_for_its_log(tmp_path: Path, name: str) -> None:
    log = two_of_each(tmp_path / "flight.ulg")
    folder = tables_of(log, tmp_path / "tables")
    (folder / "flight_cpuload_0.csv").write_text("timestamp,load\n1000000,0.5\n")
    assert_same(open_log(folder / f"flight_{name}.csv"), open_log(log))


def test_one_table_of_two_logs_in_a_folder(tmp_path: Path) -> None:
    first, second = two_of_each(tmp_path / "a.ulg"), two_of_each(tmp_path / "a_2.ulg")
    folder = tables_of(first, tmp_path / "tables")
    for file in tables_of(second, tmp_path / "others").iterdir():
        shutil.copy(file, folder)
    assert_same(open_log(folder / "a_sensor_mag_0.csv"), open_log(first))
    assert_same(open_log(folder / "a_2_sensor_mag_0.csv"), open_log(second))
    with pytest.raises(InputError, match=r"tables: tables of 2 logs \('a', 'a_2'\); expected one file of the log"):
        open_log(folder)


def test_a_topic_that_ends_as_another_is_no_log_of_its_own(tmp_path: Path) -> None:
    folder = tables_of(two_of_each(tmp_path / "a.ulg"), tmp_path / "tables")
    (folder / "a_estimator_aid_src_airspeed_0.csv").write_text("timestamp,observation\n1000000,12.0\n")
    recording = open_log(folder)
    assert recording.name == "a"
    assert "air" not in recording.streams


@pytest.mark.measured
def test_a_folder_is_read_as_its_kept_map_reads_it(measured_data: Path) -> None:
    """The map is written by hand, from the tables alone; it also leaves out ranges that repeat."""
    from sinan.experiments.datasets import resolve

    kept, found = resolve("px4_vio_quad"), open_log(measured_data / "px4_vio_quad")
    for name in ("imu", "mag", "baro", "power", "motors"):
        stream, expected = found.streams[name], kept.streams[name]
        np.testing.assert_allclose(stream.t + found.log_start, expected.t, atol=1e-9)
        np.testing.assert_allclose(stream.array(list(expected.columns)), expected.array(list(expected.columns)))
    assert set(kept.streams["laser"].t) <= set(found.streams["laser"].t + found.log_start)
    assert found.truth is not None
    assert kept.truth is not None
    np.testing.assert_allclose(found.truth.stream.array(QUATERNION), kept.truth.stream.array(QUATERNION), atol=1e-6)
    assert found.truth.kind == kept.truth.kind == "other"


# --- what the reader of both does without an IMU's own message -------------------------------------------


def sampled(kind: str, step: int, value: float) -> list[tuple[float, ...]]:
    return [(t, t, value, 0.0, -9.8 if kind == "accel" else 0.0) for t in range(1_000_000, 1_030_000, step)]


ARRAY = "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;"


def without_combined(path: Path, *topics: tuple[str, int, str, list[tuple[object, ...]]]) -> Path:
    log = topics_of(path, *topics)
    log.write_bytes(log.read_bytes().replace(b"sensor_combined", b"sensor_combinex"))
    return log


@pytest.mark.parametrize(
    ("corrected", "raw", "choice", "expected"),
    [(1000, 2000, Choice(), 0.5), (1000, 1000, Choice(), 0.5), (2000, 1000, Choice(), 0.25),
     (1000, 2000, Choice(raw=True), 0.25)],
    ids=["corrected more often", "as often", "raw more often", "raw on request"],
)  # fmt: skip
def test_of_two_topics_of_an_accelerometer_the_one_with_more_readings(
    tmp_path: Path, corrected: int, raw: int, choice: Choice, expected: float
) -> None:
    path = without_combined(
        tmp_path / "a.ulg",
        ("sensor_gyro", 0, SENSOR, sampled("gyro", 1000, 0.1)),
        ("vehicle_acceleration", 0, ARRAY, sampled("accel", corrected, 0.5)),
        ("sensor_accel", 0, SENSOR, sampled("accel", raw, 0.25)),
    )
    imu = open_log(path, choice=choice).streams["imu"]
    assert imu.array((*ACCEL, *GYRO))[5] == pytest.approx([expected, 0.0, -9.8, 0.1, 0.0, 0.0])
    assert np.median(np.diff(imu.t)) == pytest.approx(0.001)


def test_the_angular_velocity_that_is_logged_alone(tmp_path: Path) -> None:
    path = without_combined(
        tmp_path / "a.ulg",
        ("vehicle_angular_velocity", 0, ARRAY, sampled("gyro", 1000, 0.1)),
        ("vehicle_acceleration", 0, ARRAY, sampled("accel", 1000, 0.5)),
    )
    recording = open_log(path)
    assert recording.streams["imu"].array((*ACCEL, *GYRO))[5] == pytest.approx([0.5, 0.0, -9.8, 0.1, 0.0, 0.0])
    assert recording.notes == ("imu: read from vehicle_angular_velocity and vehicle_acceleration",)


ODOMETRY = "uint64_t timestamp;float[4] q;uint8_t {};"


@pytest.mark.parametrize(
    ("field", "frame", "rows"),
    [("local_frame", 0, 15), ("local_frame", 1, 15), ("local_frame", 2, 0), ("pose_frame", 1, 15),
     ("pose_frame", 2, 15), ("pose_frame", 0, 0)],
)  # fmt: skip
def test_visual_odometry_is_a_reference_where_its_world_has_z_down(
    tmp_path: Path, field: str, frame: int, rows: int
) -> None:
    half = math.sqrt(0.5)
    seen = ("vehicle_visual_odometry", 0, ODOMETRY.format(field), [(t, half, 0.0, 0.0, half, frame) for t in TIMES])
    truth = open_log(topics_of(tmp_path / "a.ulg", seen)).truth
    assert (0 if truth is None else len(truth.stream)) == rows
    assert truth is None or (truth.kind, truth.known) == ("other", ("attitude",))


def test_the_vehicle_s_own_attitude_goes_before_it(tmp_path: Path) -> None:
    seen = ("vehicle_visual_odometry", 0, ODOMETRY.format("pose_frame"), [(t, 1.0, 0.0, 0.0, 0.0, 1) for t in TIMES])
    own = ("vehicle_attitude", 0, "uint64_t timestamp;float[4] q;", [(t, 0.0, 0.0, 0.0, 1.0) for t in TIMES])
    truth = open_log(topics_of(tmp_path / "a.ulg", seen, own)).truth
    assert truth is not None
    assert (truth.kind, truth.stream["qz"][0]) == ("autopilot", 1.0)


@pytest.mark.parametrize(
    ("idle", "full", "instance"), [(0.0, 1999.0, 2), (1000.0, 2000.0, 0), (0.0, 1.0, 1)], ids=["DShot", "PWM", "SITL"]
)
def test_outputs_are_pulses_or_throttles(tmp_path: Path, idle: float, full: float, instance: int) -> None:
    """An output that is off is zero; the first outputs that drive any are read."""
    rising = np.linspace(0.1, 0.8, len(TIMES) - 1)
    rows = [(TIMES[0], 0.0, 0.0), *((t, idle + (full - idle) * u, 0.0) for t, u in zip(TIMES[1:], rising, strict=True))]
    outputs = ("actuator_outputs", instance, "uint64_t timestamp;float[2] output;", rows)
    motors = open_log(topics_of(tmp_path / "a", outputs)).streams["motors"]
    assert list(motors.columns) == ["motor_1"]
    np.testing.assert_allclose(motors["motor_1"], [0.0, *rising], atol=1e-6)


# --- folders that are not as they should be --------------------------------------------------------------


def at_rest(folder: Path) -> Path:
    """Two tables of a log, written by hand."""
    folder.mkdir()
    rows = [f"{1_000_000 + 10_000 * k},0.0,0.0,0.0,0.0,0.0,-9.8" for k in range(50)]
    (folder / "log_sensor_combined_0.csv").write_text("\n".join([COMBINED, *rows]) + "\n")
    (folder / "log_cpuload_0.csv").write_text("timestamp,load\n" + "".join(f"{1_000_000 * k},0.5\n" for k in range(9)))
    return folder


def changed(old: str, new: str, name: str = "sensor_combined") -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        file = folder / f"log_{name}_0.csv"
        assert old in file.read_text()
        file.write_text(file.read_text().replace(old, new, 1))

    return change


def cut_off(folder: Path) -> None:
    file = folder / "log_sensor_combined_0.csv"
    file.write_text(file.read_text()[:-14])


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda folder: (folder / "log_sensor_combined_0.csv").write_text(""),
         "log_sensor_combined_0.csv: an empty file; expected a table; make it anew with ulog2csv, or take it away"),
        (lambda folder: (folder / "log_cpuload_0.csv").write_text(""), "log_cpuload_0.csv: an empty file"),
        (lambda folder: (folder / "log_sensor_combined_0.csv").write_text(COMBINED + "\n"),
         "no accelerometer with a gyroscope (there are cpuload; `sinan info` lists all)"),
        (cut_off, "log_sensor_combined_0.csv, row 50 (line 51): 4 columns; expected 7 columns"),
        (changed("1010000,0.0", "1010000,abc"), "row 2 (line 3): `abc` in column gyro_rad[0]; expected a number"),
        (changed("1010000,0.0", "1010000,"), "row 2 (line 3): an empty cell in column gyro_rad[0]"),
        (changed("timestamp,", "stamp,"), "line 1: no column timestamp among stamp, gyro_rad[0]"),
        (changed("gyro_rad[1]", "gyro_rad[0]"), "line 1: column gyro_rad[0] twice"),
    ],
    ids=["empty", "another is empty", "names alone", "cut off", "text", "nothing", "no time", "twice"],
)  # fmt: skip
def test_what_is_wrong_with_a_folder_is_one_line(
    tmp_path: Path, damage: Callable[[Path], object], message: str
) -> None:
    folder = at_rest(tmp_path / "tables")
    (folder / "log_vehicle_status_0.csv").write_text("timestamp,arming_state\n")
    damage(folder)
    with pytest.raises(InputError) as caught:
        open_log(folder)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_reading_that_is_no_number_is_left_out_and_counted(tmp_path: Path) -> None:
    folder = at_rest(tmp_path / "tables")
    changed("1010000,0.0", "1010000,nan")(folder)
    changed("1020000,0.0", "1020000,-inf")(folder)
    recording = open_log(folder)
    assert len(recording.streams["imu"]) == 48
    assert recording.notes == ("imu: 2 rows left out: not a number",)


def test_text_in_a_table_that_is_not_read_is_no_matter(tmp_path: Path) -> None:
    folder = at_rest(tmp_path / "tables")
    changed("0.5", "a text", "cpuload")(folder)
    assert len(open_log(folder).streams["imu"]) == 50


def test_a_table_whose_log_has_no_imu_is_a_table_of_its_own(tmp_path: Path) -> None:
    """A magnetometer that was turned by hand is calibrated alone."""
    rows = [f"{1_000_000 + 25_000 * k},{0.3 * math.cos(k)},{0.3 * math.sin(k)},0.4" for k in range(50)]
    names = ",".join(["timestamp", *(f"magnetometer_ga[{k}]" for k in range(3))])
    path = tmp_path / "log_vehicle_magnetometer_0.csv"
    path.write_text("\n".join([names, *rows]) + "\n")
    assert (what_is(path), what_is(tmp_path)) == ("text", "topics")
    recording = open_log(path)
    assert (recording.kind, recording.environment.field_unit) == ("poses", "gauss")
    np.testing.assert_allclose(recording.streams["mag"].t, 0.025 * np.arange(50))
    with pytest.raises(InputError, match="no accelerometer with a gyroscope"):
        open_log(tmp_path)
