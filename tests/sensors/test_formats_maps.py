"""Maps: every key does what the manual says, and every fault in one is named."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from sinan.sensors.errors import InputError
from sinan.sensors.formats import open_log
from sinan.sensors.formats.geodetic import to_ned
from sinan.sensors.recording import ACCEL, GYRO, MAG, POSITION, QUATERNION, VELOCITY, Recording, Stream, tells_height

ROUNDING = 1e-12
TEXT = "0 0.1 0.2 1.0 1 2 3\n10 0.1 0.2 1.0 4 5 6\n20 0.1 0.2 1.0 7 8 9\n"
IMU = """
kind = "flight"
[streams.imu]
time = { column = 1, unit = "ms" }
accel = { columns = [2, 3, 4], unit = "g", axes = ["x", "-y", "-z"] }
gyro = { columns = [5, 6, 7], unit = "deg/s", axes = ["x", "-y", "-z"] }
"""
MAG_POSES = 'kind = "poses"\n[streams.poses]\nmag = [5, 6, 7]\n'


def read(tmp_path: Path, rules: str, text: str | bytes = TEXT, name: str = "log.txt") -> Recording:
    """The recording of a log of text and a map."""
    (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    (tmp_path / "map.toml").write_text(rules)
    return open_log(tmp_path / name, tmp_path / "map.toml")


def message(tmp_path: Path, rules: str, text: str | bytes = TEXT) -> str:
    """The one line that reading raises."""
    with pytest.raises(InputError) as caught:
        read(tmp_path, rules, text)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def mag(recording: Recording) -> np.ndarray:
    """(n, 3) the magnetometer."""
    return recording.streams["poses" if "poses" in recording.streams else "mag"].array(MAG)


def test_time_units_and_axes(tmp_path: Path) -> None:
    imu = read(tmp_path, IMU).streams["imu"]
    np.testing.assert_allclose(imu.t, [0.0, 0.01, 0.02], rtol=ROUNDING)
    np.testing.assert_allclose(imu.array(ACCEL)[0], 9.80665 * np.array([0.1, -0.2, -1.0]), rtol=ROUNDING)
    np.testing.assert_allclose(imu.array(GYRO)[0], np.radians([1.0, -2.0, -3.0]), rtol=ROUNDING)


@pytest.mark.parametrize(
    ("quantity", "first"),
    [
        ("[5, 6, 7]", [1, 2, 3]),
        ('{ columns = [5, 6, 7], unit = "mGauss" }', [1e-3, 2e-3, 3e-3]),
        ('{ columns = [5, 6, 7], unit = "uT" }', [1e-2, 2e-2, 3e-2]),
        ('{ columns = [5, 6, 7], unit = "count" }', [1, 2, 3]),
        ('{ columns = [5, 6, 7], axes = ["y", "z", "x"] }', [2, 3, 1]),
        ("{ columns = [5, 6, 7], axes = [[0, 1, 0], [0, 0, 1], [2, 0, 0]] }", [2, 3, 2]),
        ("{ columns = [5, 6, 7], undo = { offset = [1, 1, 1], scale = [2, 1, 0.5] } }", [1, 3, 8]),
        ("{ columns = [5, 6, 7], counts = { zero = 1, per_unit = [2, 4, 8] } }", [0, 0.25, 0.25]),
        ("{ columns = [5, 6, 7], minus = [4, 5, 5] }", [0, 1, 2]),
        ("{ columns = [5, 6, 7], minus = [4, 5, 5], undo = { offset = 3, scale = 2 } }", [1.5, 2, 2.5]),
        ('{ columns = [5, 6, 7], minus = [4, 5, 5], unit = "mGauss", axes = ["-x", "z", "y"] }', [0, 2e-3, 1e-3]),
    ],
)
def test_ways_to_a_value(tmp_path: Path, quantity: str, first: list[float]) -> None:
    recording = read(tmp_path, MAG_POSES.replace("[5, 6, 7]", quantity))
    np.testing.assert_allclose(mag(recording)[0], first, rtol=ROUNDING)


@pytest.mark.parametrize(
    ("clock", "t"),
    [
        ("{ rate = 50 }", [0.0, 0.02, 0.04]),
        ('{ column = 1, unit = "ms", zero = 10 }', [-0.01, 0.0, 0.01]),
        ("{ column = 1, rate = 100 }", [0.0, 0.1, 0.2]),
        ("1", [0.0, 10.0, 20.0]),
        ("{ column = 1, even = true }", [0.0, 10.0, 20.0]),
        ("{ column = 1, minus = 5 }", [-1.0, 6.0, 13.0]),
        ('{ column = 1, minus = 5, unit = "ms", zero = 2 }', [-0.003, 0.004, 0.011]),
    ],
)
def test_clocks(tmp_path: Path, clock: str, t: list[float]) -> None:
    rules = f'kind = "poses"\n[streams.mag]\ntime = {clock}\nmag = [5, 6, 7]\n'
    np.testing.assert_allclose(read(tmp_path, rules).streams["mag"].t, t, atol=1e-12)


def test_a_covariate_is_written_as_a_quantity_is(tmp_path: Path) -> None:
    rules = "[streams.poses.covariates]\nplain = 5\nleft = { columns = 7, minus = 5, counts = { zero = 1 } }\n"
    poses = read(tmp_path, MAG_POSES + rules).streams["poses"]
    assert poses["plain"].tolist() == [1, 4, 7]
    assert poses["left"].tolist() == [1, 1, 1]


def test_a_difference_that_stays_is_held(tmp_path: Path) -> None:
    text = "0 5 1\n1 6 2\n2 7 3\n3 9 4\n"
    rules = 'kind = "flight"\n[streams.baro]\ntime = 1\nheight = { columns = 2, minus = 3 }\ndrop = ["held value"]\n'
    baro = read(tmp_path, rules, text).streams["baro"]
    assert baro["height"].tolist() == [4, 5]
    assert baro.t.tolist() == [0, 3]


def test_a_sonar_s_time_of_flight_is_a_range(tmp_path: Path) -> None:
    """c = 343.2 m/s at 20 degC (CRC Handbook), there and back; without a thermometer that of 15 degC, 340.3 m/s."""
    rules = 'kind = "flight"\n[streams.sonar]\ntime = 1\ntime_of_flight = { columns = 2, unit = "us" }\n'
    text = "0 10000 20\n1 20000 20\n"
    np.testing.assert_allclose(read(tmp_path, rules, text).streams["sonar"]["range"], [1.7015, 3.403], atol=1e-3)
    warm = read(tmp_path, rules + "temperature = 3\n", text).streams["sonar"]
    np.testing.assert_allclose(warm["range"], [1.716, 3.432], atol=1e-3)
    both = read(tmp_path, rules + "range = 3\n", text).streams["sonar"]
    assert both["range"].tolist() == [20.0, 20.0]


def test_clock_that_starts_again(tmp_path: Path) -> None:
    rules = 'kind = "poses"\n[streams.mag]\ntime = { column = 1, wrap = 100 }\nmag = [2, 3, 4]\n'
    recording = read(tmp_path, rules, "98 1 2 3\n99 1 2 4\n1 1 2 5\n3 1 2 6\n")
    np.testing.assert_allclose(recording.streams["mag"].t, [98, 99, 101, 103])


def test_stamps_in_bursts_are_spread(tmp_path: Path) -> None:
    rules = 'kind = "poses"\n[streams.mag]\ntime = { column = 1, even = true }\nmag = [2, 3, 4]\n'
    t = read(tmp_path, rules, "".join(f"{k // 4 * 4} {k} 2 3\n" for k in range(40))).streams["mag"].t
    assert np.ptp(np.diff(t)) < ROUNDING * 100
    assert np.median(np.diff(t)) == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize(
    ("extra", "rows", "note"),
    [
        ("skip_rows = 1", 4, ""),
        ('drop = ["zeros"]', 4, "all zeros"),
        ('drop = ["held value"]', 4, "the value before is repeated"),
        ('drop = ["repeated time"]', 4, "time of the row before"),
        ("keep = { column = 5, equals = 1 }", 3, "5 is not 1"),
        ("keep = { column = 5, above = 0, below = 2 }", 3, "between 0 and 2"),
        ("keep = [{ column = 5, above = 0 }, { column = 1, below = 4 }]", 3, "1 is not between"),
        ('drop = ["zeros", "held value"]', 3, "all zeros"),
    ],
)
def test_rows_that_do_not_count(tmp_path: Path, extra: str, rows: int, note: str) -> None:
    text = "0 0 0 0 1\n1 1 2 3 1\n2 1 2 3 0\n3 4 5 6 1\n4 4 5 7 2\n".replace(
        "4 4 5 7 2", "3 4 5 7 2" if "time" in extra else "4 4 5 7 2"
    )
    recording = read(tmp_path, f'kind = "poses"\n[streams.mag]\ntime = 1\nmag = [2, 3, 4]\n{extra}\n', text)
    assert len(recording.streams["mag"]) == rows
    assert any(note in entry for entry in recording.notes) == bool(note)


def test_rows_that_a_log_interpolated_are_left_out(tmp_path: Path) -> None:
    """Readings a, b, b, c, d, held at 1 and at 2 of 3 rows, with the mean of two neighbours between every two rows."""
    readings = np.array([[1.0, 7.0, 3.1], [4.3, 5.0, 2.2], [4.3, 5.0, 2.2], [0.7, 6.1, 9.4], [2.2, 8.8, 5.0]])
    rows = np.empty((2 * len(readings) - 1, 3))
    rows[::2], rows[1::2] = readings, 0.5 * (readings[1:] + readings[:-1])
    text = "".join(f"{k} {x:.17g} {y:.17g} {z:.17g}\n" for k, (x, y, z) in enumerate(rows))
    rules = 'kind = "poses"\n[streams.mag]\ntime = 1\nmag = [2, 3, 4]\ndrop = ["held value", "interpolated"]\n'
    recording = read(tmp_path, rules, text)
    np.testing.assert_array_equal(recording.streams["mag"].t, [0.0, 2.0, 6.0, 8.0])
    np.testing.assert_array_equal(mag(recording), readings[[0, 1, 3, 4]])
    assert recording.notes[0] == "mag: 4 rows left out: the mean of the rows before and after"


def test_what_a_receiver_says_of_its_fix_is_kept_in_si_units(tmp_path: Path) -> None:
    rules = """
kind = "flight"
[streams.imu]
time = 1
accel = [2, 3, 4]
gyro = [5, 6, 7]
[streams.gps]
time = 1
position = [2, 3, 4]
eph = { columns = 8, unit = "mm" }
epv = 9
s_variance = { columns = 10, unit = "mm/s" }
pdop = { columns = 11, counts = { per_unit = 100 } }
satellites = 12
"""
    recording = read(tmp_path, rules, "0 0 0 -9.8 0 0 0 650 1.5 120 140 9\n1 0 0 -9.8 0 0 0 700 1.6 130 141 8\n")
    said = recording.streams["gps"].array(("eph", "epv", "s_variance", "pdop", "satellites"))
    np.testing.assert_allclose(said, [[0.65, 1.5, 0.12, 1.4, 9], [0.7, 1.6, 0.13, 1.41, 8]], rtol=ROUNDING)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ("skip_lines = 1", "# remark\n" + TEXT),
        ("skip_lines = 1\nskip_end = 1", "5,5\n" + TEXT + "20 0.1\n"),
        ('delimiter = "comma"', TEXT.replace(" ", ",")),
        ('delimiter = "tab"', TEXT.replace(" ", "\t")),
        ("", TEXT.replace(" ", ";")),
        ("", TEXT.replace(" ", " , ")),
        ("", TEXT.replace("\n", "\r\n")),
        ("", "\ufeff" + TEXT),
        ("", TEXT.replace("0.2", "  2.0e-1")),
    ],
)
def test_ways_to_write_text(tmp_path: Path, options: str, text: str) -> None:
    recording = read(tmp_path, MAG_POSES.replace("[streams", f"[file]\n{options}\n[streams"), text)
    np.testing.assert_array_equal(mag(recording), [[1, 2, 3], [4, 5, 6], [7, 8, 9]])


def test_named_columns_beside_text(tmp_path: Path) -> None:
    rules = 'kind = "poses"\n[file]\nheader = true\n[streams.poses]\nmag = ["mx", "my", "mz"]\n'
    text = 'when,mx,my,mz,remark,\n"now, then",1,2,3,ok,\nlater,4,5,6,,\n'
    np.testing.assert_array_equal(mag(read(tmp_path, rules, text)), [[1, 2, 3], [4, 5, 6]])


def test_columns_named_by_the_map(tmp_path: Path) -> None:
    names = '[file]\ncolumns = ["t", "a", "b", "c", "x", "y", "z"]\n'
    rules = f'kind = "poses"\n{names}[streams.poses]\nmag = ["x", "y", "z"]\n'
    np.testing.assert_array_equal(mag(read(tmp_path, rules))[0], [1, 2, 3])


def test_several_files_on_one_clock(tmp_path: Path) -> None:
    (tmp_path / "gyro.txt").write_text("0 1 2 3\n10 1 2 3\n")
    rules = """
kind = "flight"
[files.g]
path = "gyro.txt"
[streams.imu]
time = { column = 1, unit = "ms" }
accel = { columns = [2, 3, 4], unit = "g" }
gyro = { file = "g", columns = [2, 3, 4], unit = "deg/s" }
"""
    assert "align" in message(tmp_path, rules)
    imu = read(tmp_path, rules.replace("[streams.imu]", '[streams.imu]\nalign = "interpolate"')).streams["imu"]
    np.testing.assert_allclose(imu.t, [0.0, 0.01])
    (tmp_path / "gyro.txt").write_text("0 1 2 3\n10 1 2 3\n20 1 2 3\n")
    assert len(read(tmp_path, rules).streams["imu"]) == 3


def test_other_files_are_brought_to_the_rows_of_the_streams_own(tmp_path: Path) -> None:
    """The gyroscope's file is the stream's: its two rows stay, whichever quantity the reader takes first."""
    (tmp_path / "accel.txt").write_text("0 0 0 -9\n1 0 0 -10\n2 0 0 -11\n3 0 0 -9\n")
    rules = """
kind = "flight"
[files.a]
path = "accel.txt"
[streams.imu]
time = 1
align = "interpolate"
gyro = { columns = [2, 3, 4], unit = "deg/s" }
accel = { file = "a", columns = [2, 3, 4] }
"""
    imu = read(tmp_path, rules, "0.5 1 2 3\n1.5 4 5 6\n").streams["imu"]
    np.testing.assert_array_equal(imu.t, [0.5, 1.5])
    np.testing.assert_array_equal(imu["accel_z"], [-9.5, -10.5])
    np.testing.assert_allclose(np.degrees(imu["gyro_x"]), [1.0, 4.0])


def test_folder_and_zip(tmp_path: Path) -> None:
    (tmp_path / "log").mkdir()
    (tmp_path / "log" / "m.txt").write_text(TEXT)
    (tmp_path / "map.toml").write_text(MAG_POSES.replace("[streams", '[file]\npath = "m.txt"\n[streams'))
    assert len(open_log(tmp_path / "log", tmp_path / "map.toml").streams["poses"]) == 3
    with zipfile.ZipFile(tmp_path / "log.zip", "w") as archive:
        archive.writestr("m.txt", TEXT)
    (tmp_path / "map.toml").write_text(MAG_POSES.replace("[streams", '[file]\nmember = "m.txt"\n[streams'))
    assert len(open_log(tmp_path / "log.zip", tmp_path / "map.toml").streams["poses"]) == 3
    (tmp_path / "map.toml").write_text(MAG_POSES)
    with pytest.raises(InputError, match=r"member = one of m\.txt"):
        open_log(tmp_path / "log.zip", tmp_path / "map.toml")


def test_matlab_variables(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "log.mat", {"m": np.arange(12.0).reshape(4, 3), "t": np.arange(4.0)})
    (tmp_path / "map.toml").write_text('kind = "poses"\n[streams.mag]\ntime = "t"\nmag = "m"\n')
    np.testing.assert_array_equal(mag(open_log(tmp_path / "log.mat", tmp_path / "map.toml"))[1], [3, 4, 5])


def test_flight_sensors(tmp_path: Path) -> None:
    rules = (
        IMU
        + """
[streams.gps]
time = { column = 1, unit = "ms" }
latitude = { columns = 5, unit = "1e-7 deg" }
longitude = { columns = 6, unit = "1e-7 deg" }
height = { columns = 7, unit = "mm" }
velocity = { polar = [2, 3, 4] }
[streams.baro]
time = { column = 1, unit = "ms" }
pressure = { columns = 2, unit = "hPa", counts = { per_unit = 1e-4 } }
temperature = { columns = 3, unit = "K" }
[streams.motors]
time = { column = 1, unit = "ms" }
motor = { columns = [2, 3], unit = "percent" }
[streams.motors.covariates]
spin = 4
"""
    )
    recording = read(tmp_path, rules)
    gps, baro = recording.streams["gps"], recording.streams["baro"]
    assert recording.origin == pytest.approx((1e-7, 2e-7, 3e-3))
    assert gps["vel_north"][0] == pytest.approx(0.1 * np.cos(np.radians(0.2)))
    assert gps["vel_down"][0] == 1.0
    assert baro["pressure"][0] == pytest.approx(100_000.0)
    assert baro["height"][0] == pytest.approx(110.9, abs=0.1)  # ISO 2533: 1000 hPa
    assert recording.streams["motors"]["motor_2"][0] == pytest.approx(0.002)
    assert recording.streams["motors"]["spin"][0] == 1.0


def test_fixes_without_a_height_say_so(tmp_path: Path) -> None:
    """Latitude and longitude alone: the height that an estimate needs is another sensor's."""
    rules = (
        IMU
        + """
[streams.gps]
time = { column = 1, unit = "ms" }
latitude = { columns = 5, unit = "1e-7 deg" }
longitude = { columns = 6, unit = "1e-7 deg" }
"""
    )
    recording = read(tmp_path, rules)
    gps = recording.streams["gps"]
    assert gps.has(("north", "east", "down"))
    assert not np.any(tells_height(gps))
    assert any("no height" in note for note in recording.notes)


def test_fixes_in_ned_have_their_height_whatever_stands_beside_them() -> None:
    t = np.arange(3.0)
    place = dict.fromkeys((*POSITION, "latitude", "longitude"), t)
    streams, origin, notes = to_ned("log", {"gps": Stream(t, place)}, None)
    assert (set(streams["gps"].columns), origin, notes) == (set(place), None, ())


def test_reference_is_apart(tmp_path: Path) -> None:
    rules = (
        IMU
        + """
[reference]
kind = "robot"
aligned = true
time = { column = 1, unit = "ms" }
roll_pitch_yaw = { columns = [5, 6, 7], unit = "deg" }
position = { columns = [2, 3, 4], enu = true }
"""
    )
    recording = read(tmp_path, rules)
    assert set(recording.streams) == {"imu"}
    assert recording.truth is not None
    assert recording.truth.known == ("position", "attitude")
    assert recording.truth.kind == "robot"
    assert recording.truth.aligned
    reference = recording.truth.stream
    np.testing.assert_allclose([reference[name][0] for name in ("north", "east", "down")], [0.2, 0.1, -1.0])
    assert reference["qw"][0] == pytest.approx(np.cos(np.radians(0.5)), abs=1e-3)


def test_attitude_into_east_north_up(tmp_path: Path) -> None:
    """A sensor with x to the east, y to the north, z up: as a forward-right-down body it heads east, level."""
    rules = (
        IMU
        + """
[reference]
time = { column = 1, unit = "ms" }
quaternion = { columns = [8, 9, 10, 11], enu = true, axes = ["x", "-y", "-z"] }
"""
    )
    recording = read(tmp_path, rules, "".join(line + " 1 0 0 0\n" for line in TEXT.splitlines()))
    assert recording.truth is not None
    assert recording.truth.kind == "other"  # nobody says what it is
    q = recording.truth.stream.array(QUATERNION)[0]
    np.testing.assert_allclose(np.abs(q), [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)], atol=1e-12)
    assert q[0] * q[3] > 0.0


@pytest.mark.parametrize(
    ("rules", "expected"),
    [
        ("[streams.mag]\n", "key kind"),
        ('kind = "poses"\n', "no stream"),
        ('kind = "poses"\n[streams.compass]\n', "unknown key"),
        (MAG_POSES + "mga = 3\n", "(perhaps `mag`)"),
        (MAG_POSES + "[effects]\n'mag.step' = [1, 1, 1]\n", "declares none"),
        (MAG_POSES.replace("[5, 6, 7]", "[5, 6]"), "3 names or numbers"),
        (MAG_POSES.replace("[5, 6, 7]", "[5, 6, 8]"), "column `8`"),
        (MAG_POSES.replace("[5, 6, 7]", "[5, 6, true]"), "3 names or numbers"),
        (MAG_POSES.replace("[5, 6, 7]", '{ columns = [5, 6, 7], unit = "Gauss" }'), "[streams.poses.mag] unit"),
        (MAG_POSES.replace("[5, 6, 7]", '{ columns = [5, 6, 7], axes = ["x", "x", "z"] }'), "turned back"),
        (MAG_POSES.replace("[5, 6, 7]", '{ columns = [5, 6, 7], axes = ["x", "y", "w"] }'), "turned back"),
        (MAG_POSES.replace("[5, 6, 7]", "{ columns = [5, 6, 7], undo = { scale = 0 } }"), "not zero"),
        (MAG_POSES.replace("[5, 6, 7]", "{ columns = [5, 6, 7], undo = { scale = [1, 2] } }"), "a list of 3 numbers"),
        (MAG_POSES.replace("[5, 6, 7]", '{ columns = [5, 6, 7], file = "x" }'), "a name of [files]"),
        (MAG_POSES.replace("[5, 6, 7]", "{ columns = [5, 6, 7], minus = [1, 2] }"), "minus"),
        (MAG_POSES.replace("[5, 6, 7]", "{ columns = [5, 6, 7], minus = [1, 2, 9] }"), "column `9`"),
        (MAG_POSES + "[streams.poses.covariates]\nx = [5, 6]\n", "[streams.poses.covariates] x"),
        (MAG_POSES.replace("mag =", 'drop = ["zeroes"]\nmag ='), '"zeros"'),
        (MAG_POSES.replace("mag =", "keep = 3\nmag ="), "a table or a list of tables"),
        (MAG_POSES.replace("mag =", "time = { rate = 0 }\nmag ="), "above 0"),
        (MAG_POSES.replace("mag =", "time = {}\nmag ="), "a rate"),
        (MAG_POSES.replace("poses]\n", "mag]\n"), "[streams.mag] time"),
        (MAG_POSES.replace("[streams", '[file]\npath = "absent"\n[streams'), "no such file"),
        (MAG_POSES.replace("[streams", "[file]\nskip_lines = -1\n[streams"), "a whole number"),
        (MAG_POSES.replace("[streams", "[file]\nskip_lines = 9\n[streams"), "no text"),
        (MAG_POSES.replace("[streams", "[file.records]\nfields = [['a', 'int7']]\n[streams"), "int8"),
        (MAG_POSES.replace("[streams", "[file.records]\nfields = []\n[streams"), "no such key"),
    ],
)
def test_faulty_map_is_named(tmp_path: Path, rules: str, expected: str) -> None:
    assert expected in message(tmp_path, rules)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "an empty file"),
        (TEXT.replace("4 5 6", "4 x 6"), "row 2 (line 2): `x` in column 6"),
        (TEXT.replace("4 5 6", "4 5"), "row 2 (line 2): 6 columns"),
        (TEXT.replace("4 5 6", "4 5 6 7"), "row 2 (line 2): 8 columns"),
        (TEXT.replace("4 5 6", "4 5 nan"), "nan"),
        ("a b c d e f g\n" + TEXT, "header = true"),
        (TEXT.encode() + b"\xff\n", "UTF-8"),
        (bytes(range(256)) * 4, "binary data"),
        ("x" * 1000, "header = true"),
        ("x" * 10_000_000, "a line of more than 1 MiB; expected lines of at most 1 MiB"),
    ],
)
def test_faulty_text_is_named(tmp_path: Path, text: str | bytes, expected: str) -> None:
    assert expected in message(tmp_path, MAG_POSES, text)


def test_time_going_backwards(tmp_path: Path) -> None:
    assert "strictly increasing" in message(tmp_path, IMU, TEXT.replace("20 0.1", "5 0.1"))


def test_wrong_unit_in_a_map(tmp_path: Path) -> None:
    assert "looks like g" in message(tmp_path, IMU.replace('"g"', '"m/s^2"'))


def test_map_that_is_not_there(tmp_path: Path) -> None:
    (tmp_path / "log").write_text(TEXT)
    with pytest.raises(InputError, match="a readable file"):
        open_log(tmp_path / "log", tmp_path / "absent.toml")


def test_the_manuals_first_map(tmp_path: Path) -> None:
    """The map in ten lines of docs/formats.md reads the log that it is written for: level, and rest is (0, 0, -g)."""
    manual = (Path(__file__).resolve().parents[2] / "docs" / "formats.md").read_text(encoding="utf-8")
    rules = manual.split("## A map in ten lines")[1].split("```toml\n")[1].split("```")[0]
    text = "time_ms, ax, ay, az, gx, gy, gz\n" + "".join(f"{10 * k}, 0.0, 0.0, 1.0, 1, 2, 3\n" for k in range(5))
    imu = read(tmp_path, rules, text).streams["imu"]
    np.testing.assert_allclose(imu.array(ACCEL)[0], [0.0, 0.0, -9.80665], atol=1e-12)
    np.testing.assert_allclose(np.degrees(imu.array(GYRO)[0]), [2.0, 1.0, -3.0])


def test_the_manuals_map_of_a_flight(tmp_path: Path) -> None:
    """One row an IMU sample, the slower sensors repeated: a row is a reading of theirs where it differs."""
    manual = (Path(__file__).resolve().parents[2] / "docs" / "formats.md").read_text(encoding="utf-8")
    rules = manual.split("## A map of a flight with GPS")[1].split("```toml\n")[1].split("```")[0]
    header = rules.split("header = true")[1].split("# ")[1].split("\n")[0]
    rows = [
        f"{10 * k},0,0,1,1,2,3,20,{k // 2},-40,47.{k // 5},11.0,500,1,{k // 5},3,950.{k // 4},{10 + k // 10}"
        for k in range(20)
    ]
    streams = read(tmp_path, rules, "\n".join([header, *rows])).streams
    assert {name: len(stream.t) for name, stream in streams.items()} == {
        "imu": 20, "mag": 10, "baro": 5, "gps": 4, "power": 2,
    }  # fmt: skip
    np.testing.assert_allclose(streams["mag"].array(MAG)[3], [0.03, 0.2, 0.4])  # gauss; forward, right, down
    np.testing.assert_allclose(streams["gps"].array(VELOCITY)[2], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(streams["baro"].columns["pressure"][1], 95010.0)


@pytest.mark.parametrize(
    ("entry", "unit"),
    [
        ("[1, 2, 3]", ""),
        ('{ columns = [1, 2, 3], unit = "count", counts = { per_unit = 2 } }', ""),
        ("{ columns = [1, 2, 3] }", ""),
        ('{ columns = [1, 2, 3], unit = "uT" }', "gauss"),
    ],
)
def test_unit_of_a_field_is_known_where_the_map_names_that_of_the_log(tmp_path: Path, entry: str, unit: str) -> None:
    recording = read(tmp_path, f'kind = "poses"\n[streams.poses]\nmag = {entry}\n', "30 20 25\n-30 20 25\n", "a.txt")
    assert recording.environment.field_unit == unit


def test_a_map_may_say_the_unit_of_readings_that_it_takes_as_they_are(tmp_path: Path) -> None:
    rules = 'kind = "poses"\n[environment]\nfield_unit = "uT"\n[streams.poses]\nmag = [5, 6, 7]\n'
    assert read(tmp_path, rules).environment.field_unit == "uT"
    named = rules.replace("mag = [5, 6, 7]", 'mag = { columns = [5, 6, 7], unit = "nT" }')
    assert '[environment] field_unit: "uT" beside readings whose unit the map names' in message(tmp_path, named)
