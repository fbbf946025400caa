"""Tables and MATLAB files as loggers, labs and spreadsheets leave them, each held against the flight that it is of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats import open_log
from sinan.sensors.formats.column_names import meaning
from sinan.sensors.recording import tells_height
from tests.sensors.test_logs_of_programs import FLU, Flight, check, of, three, write

FRD = np.eye(3)


@pytest.fixture(scope="module")
def flight() -> Flight:
    return Flight()


def axes(flight: Flight, accel: float = 1.0, gyro: float = 1.0) -> list[FloatArray]:
    return [*three(flight.force / accel, FRD), *three(flight.rate / gyro, FRD)]


def clock(flight: Flight, head: str = "", start: float = 43_200.0, day: Sequence[str] = ("",)) -> list[str]:
    """Times of day, `start` seconds after the first midnight; each day has its date."""
    cells = []
    for t in start + flight.t:
        days, second = divmod(t, 86_400.0)
        cells.append(
            f"{head}{day[int(days)]}{int(second // 3600):02d}:{int(second // 60 % 60):02d}:{second % 60:06.3f}"
        )
    return cells


# --- times ---------------------------------------------------------------------------------------------------

NAMES = [*of("a#"), *of("g#")]


@pytest.mark.parametrize(
    ("name", "times"),
    [
        ("millis", lambda flight: (5231 + 1000 * flight.t)),
        ("micros", lambda flight: (5231 + 1e6 * flight.t)),
        ("Time (us since epoch)", lambda flight: np.round(1.7e15 + 1e6 * flight.t)),
        ("TimeStartup", lambda flight: (5231 + 1e9 * flight.t)),
        ("SampleTimeFine", lambda flight: np.round(5231 + 1e4 * flight.t)),
        ("SampleTimeFine", lambda flight: np.round(5231 + 1e6 * flight.t)),
        ("Time (UTC)", clock),
        ("Time", lambda flight: [f"{t:.15g} sec" for t in flight.t]),
        ("Timestamp", lambda flight: clock(flight, "04-May-2022 ")),
        ("timestamp", lambda flight: clock(flight, "5/4/2022 ")),
        ("timestamp", lambda flight: clock(flight, "", 86_390.0, ("5/31/2022 ", "6/1/2022 "))),
        ("timestamp", lambda flight: clock(flight, "", 86_390.0, ("31-May-2022 ", "01-Jun-2022 "))),
    ],
    ids=["millis", "micros", "us since epoch", "VectorNav", "10 kHz", "1 MHz", "time of day", "MATLAB's duration",
         "MATLAB's date", "Excel's date", "Excel's midnight", "MATLAB's midnight"],
)  # fmt: skip
def test_times(tmp_path: Path, flight: Flight, name: str, times: Callable[[Flight], FloatArray | list[str]]) -> None:
    path = write(tmp_path / "log.csv", [name, *NAMES], [times(flight), *axes(flight)])
    check(open_log(path), flight, FRD, field=False)


@pytest.mark.parametrize("unit", [1.0 / 86_400.0, 1e7], ids=["days", "poses"])
def test_a_time_that_nothing_reads_so_fast_or_so_slowly(tmp_path: Path, flight: Flight, unit: float) -> None:
    days = unit < 1.0
    names = ["t", *NAMES] if days else ["t", *of("a#")]
    path = write(tmp_path / "log.csv", names, [738_000.0 + unit * flight.t, *axes(flight)[: len(names) - 1]])
    with pytest.raises(InputError, match="looks like days" if days else "s between two rows: another unit of time"):
        open_log(path)


def test_a_magnetometer_that_was_turned_by_hand_has_a_clock_in_us(tmp_path: Path, flight: Flight) -> None:
    path = write(tmp_path / "mag.csv", ["timestamp", *of("mag_# [uT]")], [1e6 * flight.t, *three(flight.field, FRD)])
    recording = open_log(path)
    np.testing.assert_allclose(recording.streams["mag"].t, flight.t, atol=1e-9)
    assert "time: a step of 20000 is taken for us, which nobody says" in recording.notes


# --- cells ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mark", [";", "\t"])
def test_commas_for_points(tmp_path: Path, flight: Flight, mark: str) -> None:
    """Some rows first are whole numbers; lines of names have commas in units, too."""
    columns = [flight.t, *axes(flight)]
    cells = [[repr(value).replace(".", ",") for value in column.tolist()] for column in columns]
    check(open_log(write(tmp_path / "log.csv", ["t", *NAMES], cells, mark)), flight, FRD, field=False)


def test_commas_stay_what_they_are_where_numbers_have_points(tmp_path: Path, flight: Flight) -> None:
    names, texts = ["t", *NAMES, "label"], ["1,5"] * len(flight.t)
    path = write(tmp_path / "log.csv", names, [flight.t, *axes(flight), texts], ";")
    check(open_log(path), flight, FRD, field=False)


def test_a_map_reads_commas_for_points(tmp_path: Path, flight: Flight) -> None:
    cells = [[repr(value).replace(".", ",") for value in column.tolist()] for column in (flight.t, *axes(flight))]
    path = write(tmp_path / "log.csv", ["n"] * 7, cells, ";")
    map_file = tmp_path / "map.toml"
    map_file.write_text('kind = "flight"\n[file]\nskip_lines = 1\n[streams.imu]\ntime = 1\naccel = [2, 3, 4]\n'
                        "gyro = [5, 6, 7]\n")  # fmt: skip
    check(open_log(path, map_file), flight, FRD, field=False)


@pytest.mark.parametrize("empty", ["", "NaN", "nan"])
def test_cells_of_slower_sensors_are_empty_in_between(tmp_path: Path, flight: Flight, empty: str) -> None:
    def every(step: int, values: FloatArray) -> list[str]:
        return [repr(value) if k % step == 0 else empty for k, value in enumerate(values.tolist())]

    place = [39.98 + 1e-6 * flight.t, 116.34 + 0 * flight.t, 50.0 + flight.t]
    names = ["t", *NAMES, "lat", "lon", "alt", "pressure", "temperature"]
    slow = [*(every(10, one) for one in place), every(5, 950.0 + flight.t), every(50, 20.0 + flight.t)]
    recording = open_log(write(tmp_path / "log.csv", names, [flight.t, *axes(flight), *slow]))
    check(recording, flight, FRD, field=False)
    assert len(recording.streams["gps"]) == 150
    np.testing.assert_allclose(recording.streams["baro"]["pressure"], 100.0 * (950.0 + flight.t[::5]))
    np.testing.assert_allclose(recording.streams["imu"]["temperature"][:1451], 20.0 + flight.t[:1451])
    assert not any("left out" in note for note in recording.notes)


def test_a_time_without_a_number_is_an_error(tmp_path: Path, flight: Flight) -> None:
    times = [repr(t) if k != 3 else "" for k, t in enumerate(flight.t.tolist())]
    with pytest.raises(InputError, match=r"row 4 \(line 5\): an empty cell in column t"):
        open_log(write(tmp_path / "log.csv", ["t", *NAMES], [times, *axes(flight)]))


@pytest.mark.parametrize("row", [700, 1500], ids=["within", "the last"])
def test_a_row_that_is_cut_off_is_not_one_with_empty_cells(tmp_path: Path, flight: Flight, row: int) -> None:
    """Its last number may be a part of one."""
    place = [[repr(value) if k % 10 == 0 else "" for k, value in enumerate(one.tolist())]
             for one in (39.98 + 0 * flight.t, 116.34 + 0 * flight.t, 50.0 + flight.t)]  # fmt: skip
    path = write(tmp_path / "log.csv", ["t", *NAMES, "lat", "lon", "alt"], [flight.t, *axes(flight), *place])
    lines = path.read_text().splitlines()
    lines[row] = lines[row].rsplit(",", 1)[0]
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match=rf"row {row} \(line {row + 1}\): 9 columns; expected 10 columns"):
        open_log(path)


def trailing(path: Path, mark: str) -> list[str]:
    """The lines of a table, each row with something after the last cell."""
    head, *rows = path.read_text().splitlines()
    return [head, *(row + mark for row in rows)]


@pytest.mark.parametrize("end", ["\n", ""])
def test_a_separator_at_the_end_of_every_row_is_no_column(tmp_path: Path, flight: Flight, end: str) -> None:
    """The line of names lacks it."""
    path = write(tmp_path / "log.csv", ["t", *NAMES], [flight.t, *axes(flight)])
    path.write_text("\n".join(trailing(path, ",")) + end)
    recording = open_log(path)
    check(recording, flight, FRD, field=False)
    assert len(recording.streams["imu"]) == len(flight.t)
    map_file = tmp_path / "log.toml"
    map_file.write_text(
        f'kind = "flight"\n[file]\nheader = true\n[streams.imu]\ntime = {{ column = "t" }}\n'
        f"accel = {{ columns = {NAMES[:3]} }}\ngyro = {{ columns = {NAMES[3:]} }}\n"
    )
    check(open_log(path, map_file), flight, FRD, field=False)


def test_a_column_without_a_name_that_holds_something_is_an_error(tmp_path: Path, flight: Flight) -> None:
    path = write(tmp_path / "log.csv", ["t", *NAMES], [flight.t, *axes(flight)])
    lines = trailing(path, ",")
    lines[700] += "5"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match=r"row 700 \(line 701\): 8 columns; expected 7 columns"):
        open_log(path)


def test_of_rows_that_end_in_a_separator_one_that_is_cut_off_is_told(tmp_path: Path, flight: Flight) -> None:
    path = write(tmp_path / "log.csv", ["t", *NAMES], [flight.t, *axes(flight)])
    lines = trailing(path, ",")
    path.write_text("\n".join(lines)[:-2])
    recording = open_log(path)
    assert len(recording.streams["imu"]) == len(flight.t) - 1
    assert "the last line is cut off after 7 of 8 columns, left out" in recording.notes
    lines[700] = lines[700].rsplit(",", 2)[0]
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match=r"row 700 \(line 701\): 6 columns; expected 7 columns"):
        open_log(path)


@pytest.mark.parametrize("empty", ["", "nan"])
def test_an_inertial_reading_that_is_no_number_is_an_error(tmp_path: Path, flight: Flight, empty: str) -> None:
    force = axes(flight)
    cells = [repr(value) if k != 3 else empty for k, value in enumerate(force[0].tolist())]
    with pytest.raises(InputError, match=r"row 4 \(line 5\): .* in column ax; expected a number"):
        open_log(write(tmp_path / "log.csv", ["t", *NAMES], [flight.t, cells, *force[1:]]))


# --- names ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "column", "unit"),
    [
        ("IMU_ATTI(0):accel:X[meters/Sec2]", "accel_x", "m/s^2"), ("IMU_ATTI(0):accelZ", "accel_z", "m/s^2"),
        ("IMU_ATTI(0):gyro:Y[degrees/Second]", "gyro_y", "deg/s"), ("IMU_ATTI(0):mag:X", "mag_x", ""),
        ("GPS(0):Long[degrees [-180;180]]", "longitude", "deg"), ("GPS(0):heightMSL[meters]", "height", "m"),
        ("Clock:offsetTime", "t", "s"), ("magnetometer_ga[2]", "mag_z", "gauss"), ("Time (UTC)", "t", "s"),
    ],
)  # fmt: skip
def test_what_a_name_means(name: str, column: str, unit: str) -> None:
    found = meaning(name)
    assert found is not None
    assert (found.column, found.unit) == (column, unit)


@pytest.mark.parametrize(
    "name", ["IMU_ATTI(1):accel:X[meters/Sec2]", "IMU_ATTI(0):Longitude[degrees [-180;180]]", "acc_1", "Date (UTC)"]
)
def test_what_a_name_does_not_mean(name: str) -> None:
    assert meaning(name) is None


def test_the_table_of_datcon(tmp_path: Path, flight: Flight) -> None:
    """Of several units the first, of several places the receiver's; a semicolon in a unit separates nothing."""
    names = ["Clock:Tick#", "Clock:offsetTime", "IMU_ATTI(0):Longitude[degrees [-180;180]]",
             *of("IMU_ATTI(0):accel:#[meters/Sec2]", "XYZ"), *of("IMU_ATTI(0):gyro:#[degrees/Second]", "XYZ"),
             *of("IMU_ATTI(1):accel:#[meters/Sec2]", "XYZ"), "GPS(0):Long[degrees [-180;180]]",
             "GPS(0):Lat[degrees [-180;180]]", "GPS(0):heightMSL[meters]"]  # fmt: skip
    zero = 0.0 * flight.t
    other = [zero, zero, zero]
    place = [116.34 + 1e-6 * flight.t, 39.98 + zero, 50.0 + zero]
    columns = [4.5e6 * flight.t, flight.t, zero, *axes(flight, gyro=np.pi / 180.0), *other, *place]
    recording = open_log(write(tmp_path / "FLY001.csv", names, columns))
    check(recording, flight, FRD, field=False)
    assert recording.origin == pytest.approx((39.98, 116.34, 50.0))


def test_columns_of_a_matrix_are_numbered(tmp_path: Path, flight: Flight) -> None:
    names = ["Time", *of("Acceleration_#", "123"), *of("AngularVelocity_#", "123")]
    check(open_log(write(tmp_path / "log.csv", names, [flight.t, *axes(flight)])), flight, FRD, field=False)


def test_numbers_of_more_than_three_are_no_axes(tmp_path: Path, flight: Flight) -> None:
    names = ["t", *NAMES, *of("mag_#", "1234")]
    zero = 0.0 * flight.t
    assert "mag" not in open_log(write(tmp_path / "log.csv", names, [flight.t, *axes(flight), *[zero] * 4])).streams


def test_sensors_that_are_there_and_not_read_are_said(tmp_path: Path, flight: Flight) -> None:
    field = three(flight.field, FRD)
    rates = write(tmp_path / "a.csv", ["t", *of("g#"), *of("mag_# [uT]")], [flight.t, *axes(flight)[3:], *field])
    assert "no accelerometer with a gyroscope, so not read: gyro" in open_log(rates).notes
    place = write(tmp_path / "b.csv", ["t", *NAMES, "lat"], [flight.t, *axes(flight), flight.t])
    assert "gps: not read, without longitude" in open_log(place).notes


@pytest.mark.parametrize("told", [[], [np.nan]], ids=["no column", "an empty one"])
def test_a_receiver_need_not_tell_a_height(tmp_path: Path, flight: Flight, told: list[float]) -> None:
    names = ["t", *NAMES, "lat", "lon", *["alt"] * len(told)]
    columns = [flight.t, *axes(flight), 1e-6 * flight.t, 2e-6 * flight.t, *(0.0 * flight.t + one for one in told)]
    recording = open_log(write(tmp_path / "log.csv", names, columns))
    assert not np.any(tells_height(recording.streams["gps"]))
    assert recording.streams["gps"]["north"][-1] == pytest.approx(0.1106 * flight.t[-1], rel=1e-2)
    assert any("no height" in note for note in recording.notes)


def with_place(path: Path, flight: Flight, speed: float, before: int = 0) -> Path:
    """A walk of 2 m/s to the north and 1 m/s to the east with a turn in it, its velocities in some unit."""
    north, east = 2.0 * flight.t, 3.0 * np.sin(flight.t / 3.0)
    place = [39.98 + np.degrees(north / 6_360_000.0), 116.34 + np.degrees(east / 4_890_000.0), 50.0 + 0 * flight.t]
    for one in place:
        one[:before] = 0.0
    velocity = [0 * flight.t + 2.0 / speed, np.cos(flight.t / 3.0) / speed, 0 * flight.t]
    return write(path, ["t", *NAMES, "lat", "lon", "alt", "vn", "ve", "vd"],
                 [flight.t, *axes(flight), *place, *velocity])  # fmt: skip


@pytest.mark.parametrize(
    ("unit", "speed"), [("m/s", 1.0), ("cm/s", 1e-2), ("mm/s", 1e-3), ("km/h", 1 / 3.6), ("kn", 1852 / 3600)]
)
def test_velocities_that_are_not_those_of_the_places(tmp_path: Path, flight: Flight, unit: str, speed: float) -> None:
    path = with_place(tmp_path / "log.csv", flight, speed)
    if unit == "m/s":
        assert open_log(path).streams["gps"]["vel_north"][0] == 2.0
        return
    with pytest.raises(InputError, match=f"those of the places: look like {unit}; expected m/s"):
        open_log(path)


def test_velocities_of_a_body_that_stays_say_nothing(tmp_path: Path, flight: Flight) -> None:
    rng = np.random.default_rng(1)
    count = len(flight.t)
    place = [39.98 + 2e-6 * rng.normal(size=count), 116.34 + 2e-6 * rng.normal(size=count), 50.0 + 0 * flight.t]
    names = ["t", *NAMES, "lat", "lon", "alt", "vn", "ve", "vd"]
    path = write(tmp_path / "log.csv", names, [flight.t, *axes(flight), *place, *10.0 * rng.normal(size=(3, count))])
    assert len(open_log(path).streams["gps"]) == count


def test_places_before_the_first_fix_are_zero(tmp_path: Path, flight: Flight) -> None:
    recording = open_log(with_place(tmp_path / "log.csv", flight, 1.0, before=100))
    assert recording.origin == pytest.approx((39.980036, 116.34, 50.0), abs=1e-4)
    assert len(recording.streams["gps"]) == 1400
    assert "gps: 100 rows left out: latitude and longitude are zero, no fix" in recording.notes


# --- MATLAB files --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "variables",
    [
        lambda flight: {"t": flight.t, "acc": flight.force, "gyr": flight.rate},
        lambda flight: {"t": flight.t[:, None], "acc": flight.force.T, "gyro": flight.rate.T, "fs": 50.0},
        lambda flight: dict(zip(["time", *NAMES], [flight.t, *axes(flight)], strict=True)),
        lambda flight: {"data": {"time": flight.t, "Accel": flight.force, "Gyro": flight.rate}, "name": 7.0},
        lambda flight: {"imu_acc": flight.force, "imu_gyr": flight.rate, "sampling_rate": 50.0},
    ],
    ids=["matrices", "rows", "columns", "a structure", "a rate"],
)
def test_variables_that_say_what_they_are(
    tmp_path: Path, flight: Flight, variables: Callable[[Flight], dict[str, object]]
) -> None:
    savemat(tmp_path / "log.mat", variables(flight))
    check(open_log(tmp_path / "log.mat"), flight, FRD, field=False)


def test_a_rate_that_counts_the_readings_is_said(tmp_path: Path, flight: Flight) -> None:
    savemat(tmp_path / "log.mat", {"acc": flight.force @ FLU, "gyr": flight.rate @ FLU, "fs": 50.0})
    recording = open_log(tmp_path / "log.mat")
    assert recording.notes[0] == "time: readings are counted, 50 a second by fs"
    check(recording, flight, FLU, field=False)


def test_one_variable_of_a_sensor_is_poses_as_before(tmp_path: Path, flight: Flight) -> None:
    savemat(tmp_path / "log.mat", {"acc": flight.force[:12], "gyr": flight.rate[:11]})
    assert open_log(tmp_path / "log.mat").kind == "poses"


def test_variables_without_a_time_need_one(tmp_path: Path, flight: Flight) -> None:
    savemat(tmp_path / "log.mat", {"acc": flight.force, "gyr": flight.rate})
    with pytest.raises(InputError, match="no time among the columns"):
        open_log(tmp_path / "log.mat")


# --- what is said of what is not read --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("%RAWIMUSA,2200,1.0;2200,1.0,77,1,2,3,4,5,6*24cd39d6\n" * 9, "messages of a NovAtel receiver"),
        ("     2.11           OBSERVATION DATA    M (MIXED)           RINEX VERSION / TYPE\n", "`sinan gnss OBS NAV`"),
        ("12:00:01.123 -> 0.1,0.2\n" * 9, "lines of a serial monitor"),
        ("ax: 0.1, ay: 0.2, az: 1.0\n" * 9, "a name in every cell"),
        ("5231,0.1,0.2,1.0,0.1,0.2,0.3\n" * 9, "7 numbers a line and no names"),
        ("t,ax (m/s\u00b2)\n0,1\n".encode("latin-1"), "not UTF-8 (`t,ax (m/s\u00b2)`)"),
        ("t,ax,ay,az\n0,1,2,3\n".encode("utf-16"), "UTF-16, not UTF-8"),
    ],
)
def test_a_text_that_needs_more_says_what(tmp_path: Path, text: str | bytes, message: str) -> None:
    (tmp_path / "log.txt").write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError) as caught:
        open_log(tmp_path / "log.txt")
    assert message in str(caught.value)


def test_counts_of_a_novatel_receiver_by_a_map(tmp_path: Path, flight: Flight) -> None:
    """As the message has it: the messages of one kind, cut at commas. z, -y, x of axes right, forward, up."""
    force, rate = 163.84, 5242.88  # counts
    right_forward_up = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    a, w = force * flight.force @ right_forward_up.T, rate * flight.rate @ right_forward_up.T
    order = [2, 1, 0], np.array([1.0, -1.0, 1.0])
    counts = np.hstack([one[:, order[0]] * order[1] for one in (a, w)]).tolist()
    lines = [f"%RAWIMUSA,2200,{t:.3f};2200,{t:.9f},77,{','.join(map(repr, row))}*aa"
             for t, row in zip(flight.t.tolist(), counts, strict=True)]  # fmt: skip
    (tmp_path / "log.csv").write_text("\n".join(lines).replace(";", ",").replace("*", ",") + "\n")
    (tmp_path / "map.toml").write_text(
        'kind = "flight"\n[streams.imu]\ntime = 5\n'
        f'accel = {{ columns = [9, 8, 7], counts = {{ zero = 0, per_unit = {force} }}, axes = ["-y", "x", "-z"] }}\n'
        f'gyro = {{ columns = [12, 11, 10], counts = {{ zero = 0, per_unit = {rate} }}, axes = ["-y", "x", "-z"] }}\n'
    )
    check(open_log(tmp_path / "log.csv", tmp_path / "map.toml"), flight, FRD, field=False)


def test_a_folder_that_is_no_log_names_what_is_in_it(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="an empty folder"):
        open_log(tmp_path)
    for k in range(6):
        (tmp_path / f"log_{k}.bin").write_bytes(b"\xa3\x95")
    with pytest.raises(InputError, match=r"no log of several files that is known \(log_0.bin, .* and 2 more\)"):
        open_log(tmp_path)
