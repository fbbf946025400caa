"""The plain format: an exact round trip, and faults that are named."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sinan.sensors.errors import InputError
from sinan.sensors.formats import open_log
from sinan.sensors.formats.plain import read_recording, write_recording
from sinan.sensors.recording import (
    ACCEL,
    GYRO,
    MAG,
    POSITION,
    Environment,
    Initial,
    Recording,
    SensorSpec,
    Stream,
    Truth,
)

MILLIMETRE = 1e-3
FLIGHT = 'format = 1\nkind = "flight"\n'
IMU = "t," + ",".join((*ACCEL, *GYRO))
ROWS = ["0.00,0,0,-9.8,0.1,0,0", "0.01,0,0,-9.8,0.1,0,0", "0.02,0,0,-9.8,0.1,0,0"]


def folder(path: Path, toml: str = FLIGHT, **files: str) -> Path:
    """A recording written by hand; by default an IMU of three rows."""
    (path / "recording.toml").write_text(toml)
    for name, text in (files or {"imu": "\n".join([IMU, *ROWS])}).items():
        (path / f"{name}.csv").write_text(text)
    return path


def error(path: Path) -> str:
    """The one line that reading raises."""
    with pytest.raises(InputError) as caught:
        read_recording(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def equal(a: Mapping[str, Stream], b: Mapping[str, Stream]) -> bool:
    """Whether two sets of streams have the same bits."""
    return a.keys() == b.keys() and all(
        np.array_equal(a[name].t, b[name].t)
        and a[name].columns.keys() == b[name].columns.keys()
        and all(np.array_equal(a[name][column], b[name][column]) for column in a[name].columns)
        for name in a
    )


finite = st.floats(-1e12, 1e12, allow_subnormal=True)


@settings(max_examples=40, deadline=None)
@given(
    field=arrays(np.float64, (5, 3), elements=finite),
    steps=arrays(np.float64, 5, elements=st.floats(1e-6, 1e3)),
    name=st.text(min_size=1, max_size=20),
    noise=st.floats(1e-9, 1e3),
    effect=st.lists(finite, min_size=3, max_size=3),
)
def test_round_trip_is_exact(
    tmp_path_factory: pytest.TempPathFactory, field: object, steps: object, name: str, noise: float, effect: list[float]
) -> None:
    stream = Stream(np.cumsum(np.asarray(steps)), dict(zip(MAG, np.asarray(field).T, strict=True)))
    recording = Recording(
        name, "poses", {"mag": stream}, {"mag": SensorSpec(noise_std=noise)}, effects={"mag.current": tuple(effect)}
    )
    path = tmp_path_factory.mktemp("plain")
    try:
        name.encode()
    except UnicodeEncodeError:
        return
    write_recording(recording, path)
    again = read_recording(path)
    assert equal(again.streams, recording.streams)
    assert again.name == name
    assert again.spec("mag") == recording.spec("mag")
    assert again.effects == recording.effects


def test_header_round_trip(tmp_path: Path) -> None:
    recording = read_recording(folder(tmp_path)).replace(
        origin=(39.98, 116.34, 50.0),
        environment=Environment(9.8012, np.array([0.53, -0.06, 0.85]), 1.5, True, "uT"),
        initial=Initial(velocity=np.array([1.0, 2.0, 3.0]), attitude_std=0.1),
        sensors={"laser": SensorSpec(angles=np.array([-0.1, 0.0, 0.1])), "accel": SensorSpec(imu_samples="average")},
    )
    write_recording(recording, tmp_path / "again")
    again = read_recording(tmp_path / "again")
    assert again.origin == recording.origin
    assert again.environment.gravity == 9.8012
    assert again.environment.earth_rotation
    assert again.environment.field_unit == "uT"
    np.testing.assert_array_equal(again.environment.magnetic_field, [0.53, -0.06, 0.85])
    np.testing.assert_array_equal(again.initial.velocity, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(again.spec("laser").angles, [-0.1, 0.0, 0.1])
    assert again.spec("accel").imu_samples == "average"


@pytest.mark.parametrize(("kind", "aligned"), [("", False), ("cameras", False), ("cameras", True)])
def test_truth_is_no_stream_and_keeps_what_it_is(tmp_path: Path, kind: str, aligned: bool) -> None:
    truth = Truth(Stream(np.array([0.0, 1.0]), dict.fromkeys(POSITION, np.array([1.0, 2.0]))), kind, aligned)
    write_recording(read_recording(folder(tmp_path)).replace(truth=truth), tmp_path / "out")
    again = read_recording(tmp_path / "out")
    assert set(again.streams) == {"imu"}
    assert again.truth is not None
    assert (again.truth.kind, again.truth.known, again.truth.aligned) == (kind, ("position",), aligned)
    np.testing.assert_array_equal(again.truth.stream["north"], [1.0, 2.0])


TRUTH = "t,north,east,down,qw,qx,qy,qz\n0,0,0,0,1,0,0,0\n1,0,0,0,1,0,0,0\n"


def test_a_truth_knows_what_the_recording_says_it_knows(tmp_path: Path) -> None:
    """Columns of what is not known hold zeros in many logs: nothing is scored against them."""
    header = FLIGHT + '[truth]\nkind = "robot"\nknown = ["attitude"]\n'
    truth = read_recording(folder(tmp_path, header, imu="\n".join([IMU, *ROWS]), truth=TRUTH)).truth
    assert truth is not None
    assert (truth.kind, truth.known, truth.is_own) == ("robot", ("attitude",), False)
    assert "north" not in truth.stream


@pytest.mark.parametrize(
    ("said", "places"),
    [
        ('kind = "lidar"', ["[truth] kind", "'lidar'", "simulation, cameras, robot, rtk, autopilot, other"]),
        ('known = ["heading"]', ["[truth] known", "heading", '"position", "velocity", "attitude"']),
        ('known = ["velocity"]', ["[truth] known", '"velocity", of which truth.csv has no columns', "vel_north"]),
        ('sort = "robot"', ["[truth] sort", "unknown key", "kind"]),
    ],
)
def test_what_is_wrong_with_a_truth_is_named(tmp_path: Path, said: str, places: list[str]) -> None:
    text = error(folder(tmp_path, f"{FLIGHT}[truth]\n{said}\n", imu="\n".join([IMU, *ROWS]), truth=TRUTH))
    assert all(place in text for place in places)


def test_poses_without_time_are_counted(tmp_path: Path) -> None:
    folder(tmp_path, 'format = 1\nkind = "poses"\n', poses="accel_x,accel_y,accel_z\n0,0,-9.8\n0,-9.8,0\n")
    np.testing.assert_array_equal(read_recording(tmp_path).streams["poses"].t, [0.0, 1.0])


def test_geodetic_becomes_ned_at_the_origin(tmp_path: Path) -> None:
    origin = "[origin]\nlatitude = 40.0\nlongitude = 116.0\nheight = 10.0\n"
    folder(tmp_path, FLIGHT + origin, gps="t,latitude,longitude,height\n0,40.0,116.0,12.0\n1,40.0001,116.0,10.0\n")
    gps = read_recording(tmp_path).streams["gps"]
    assert gps["down"][0] == pytest.approx(-2.0, abs=MILLIMETRE)
    # Radius of curvature of the meridian at 40 deg: 6361.8 km (WGS-84).
    assert gps["north"][1] == pytest.approx(np.radians(1e-4) * 6361815.8, abs=MILLIMETRE)


def test_geodetic_without_origin_takes_the_first_fix_and_says_so(tmp_path: Path) -> None:
    folder(tmp_path, gps="t,latitude,longitude,height\n0,40,116,12\n1,40.0001,116,10\n")
    recording = read_recording(tmp_path)
    assert recording.origin == (40.0, 116.0, 12.0)
    assert "first fix of gps" in recording.notes[0]


def test_unknown_columns_are_kept(tmp_path: Path) -> None:
    folder(tmp_path, mag="t,mag_x,mag_y,mag_z,spin\n0,1,2,3,7\n1,1,2,3,8\n")
    np.testing.assert_array_equal(read_recording(tmp_path).streams["mag"]["spin"], [7.0, 8.0])


def test_unknown_column_of_text_is_left_out_and_named(tmp_path: Path) -> None:
    folder(tmp_path, mag="t,mag_x,mag_y,mag_z,remark\n0,1,2,3,\n1,1,2,3,gust\n")
    recording = read_recording(tmp_path)
    assert "remark" not in recording.streams["mag"]
    assert "remark" in recording.notes[0]


def test_unknown_file_is_named(tmp_path: Path) -> None:
    folder(tmp_path)
    (tmp_path / "flow.csv").write_text("t,x\n0,1\n")
    assert "flow.csv" in read_recording(tmp_path).notes[0]


@pytest.mark.parametrize(
    ("row", "text", "expected"),
    [
        (2, "0.01,0,0,-9.8,0.1,0", ["imu.csv", "row 2 (line 3)", "6 columns", "7 columns"]),
        (2, "0.01,0,0,-9.8,0.1,0,0,0", ["row 2 (line 3)", "8 columns"]),
        (3, "0.02,0,,-9.8,0.1,0,0", ["row 3 (line 4)", "empty cell", "accel_y"]),
        (3, "0.02,0,x,-9.8,0.1,0,0", ["row 3 (line 4)", "`x` in column accel_y"]),
        (3, "0.02,0,nan,-9.8,0.1,0,0", ["row 3", "nan", "accel_y"]),
        (3, "0.02,0,inf,-9.8,0.1,0,0", ["row 3", "inf", "accel_y"]),
        (3, "0.01,0,0,-9.8,0.1,0,0", ["row 3", "0.01 to 0.01", "strictly increasing"]),
        (3, "0.005,0,0,-9.8,0.1,0,0", ["row 3", "0.01 to 0.005"]),
    ],
)
def test_faulty_row_is_named(tmp_path: Path, row: int, text: str, expected: list[str]) -> None:
    rows = [*ROWS[: row - 1], text, *ROWS[row:]]
    message = error(folder(tmp_path, imu="\n".join([IMU, *rows])))
    assert all(part in message for part in ["imu", *expected]), message


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        (IMU.replace("gyro_z", "gyr_z"), "no column gyro_z"),
        (IMU.replace("t,", "time,"), "a column t"),
        (IMU.replace("gyro_z", "gyro_y"), "gyro_y twice"),
        (ROWS[0], "a header that names the columns"),
        ("", "a header that names the columns"),
    ],
)
def test_faulty_header_is_named(tmp_path: Path, header: str, expected: str) -> None:
    assert expected in error(folder(tmp_path, imu="\n".join([header, *ROWS])))


@pytest.mark.parametrize(
    ("toml", "expected"),
    [
        ('kind = "flight"\n', "key format: no such key"),
        ('format = 2\nkind = "flight"\n', "key format: 2"),
        ("format = 1\n", "key kind"),
        ('format = 1\nkind = "fight"\n', "(perhaps `flight`)"),
        (FLIGHT + "[enviroment]\n", "(perhaps `environment`)"),
        (FLIGHT + "[sensors.accel]\nnoise_densty = 1\n", "(perhaps `noise_density`)"),
        (FLIGHT + "[sensors.acc]\nnoise_density = 1\n", "(perhaps `accel`)"),
        (
            FLIGHT + "[sensors.accel]\nnoise_density = 0\n",
            "[sensors.accel] noise_density: 0; expected a number of at least 1e-12",
        ),
        (FLIGHT + "[sensors.mag]\nnoise_std = -1\n", "[sensors.mag] noise_std: -1"),
        (FLIGHT + "[sensors.laser]\nangles = [-0.1, 20]\n", "[sensors.laser] angles: 20; expected angles in rad"),
        (FLIGHT + "[sensors.mag]\nbias_walk = -1\n", "[sensors.mag] bias_walk: -1"),
        (FLIGHT + '[sensors.mag]\nnoise_std = "1"\n', "noise_std: '1'; expected a number"),
        (FLIGHT + "[sensors.mag]\nnoise_std = nan\n", "noise_std: nan"),
        (FLIGHT + "[environment]\ngravity = true\n", "gravity: True; expected a number"),
        (FLIGHT + "[environment]\nmagnetic_field = [1, 2]\n", "a list of 3 numbers"),
        (FLIGHT + "[initial]\nquaternion = [0, 0, 0, 0]\n", "norm 1"),
        (FLIGHT + "[origin]\nlatitude = 91\nlongitude = 0\nheight = 0\n", "latitude: 91"),
        (FLIGHT + "[origin]\nlatitude = 1\nlongitude = 0\n", "[origin] height"),
        (FLIGHT + "origin = 3\n", "a table"),
        (FLIGHT + "[effects]\n'mag.current' = 'x'\n", "[effects] mag.current"),
        (FLIGHT + "[effects]\n'baro.lag' = -0.1\n", "[effects] baro.lag: -0.1; expected b of at least 0 s"),
        (FLIGHT + "name = \n", "expected TOML"),
    ],
)
def test_faulty_declaration_is_named(tmp_path: Path, toml: str, expected: str) -> None:
    message = error(folder(tmp_path, toml))
    assert "recording.toml" in message
    assert expected in message


def test_partial_triad_is_an_error(tmp_path: Path) -> None:
    folder(tmp_path, 'format = 1\nkind = "poses"\n', poses="accel_x,accel_y,mag_x,mag_y,mag_z\n0,0,1,2,3\n")
    assert "no column accel_z" in error(tmp_path)


def test_base_position_needs_an_origin_with_geodetic_streams(tmp_path: Path) -> None:
    toml = FLIGHT + "[sensors.base]\nbase_position = [40, 116, 12]\n"
    assert "[origin]" in error(folder(tmp_path, toml, base="t,latitude,longitude,height\n0,40,116,12\n"))


@pytest.mark.parametrize(
    ("latitude", "expected"), [("91", "latitude 91"), ("400000000", "looks like 1e-7 deg"), ("-91", "latitude -91")]
)
def test_latitude_beyond_the_pole(tmp_path: Path, latitude: str, expected: str) -> None:
    assert expected in error(folder(tmp_path, gps=f"t,latitude,longitude,height\n0,{latitude},116,12\n"))


def test_no_folder_no_toml_no_stream(tmp_path: Path) -> None:
    assert "no such folder" in error(tmp_path / "absent")
    assert "no recording.toml" in error(tmp_path)
    (tmp_path / "recording.toml").write_text(FLIGHT)
    assert "no stream" in error(tmp_path)


def test_poses_alone_are_no_flight(tmp_path: Path) -> None:
    assert '"poses"' in error(folder(tmp_path, poses="accel_x,accel_y,accel_z\n0,0,-9.8\n"))


def test_not_utf8(tmp_path: Path) -> None:
    folder(tmp_path)
    (tmp_path / "imu.csv").write_bytes((IMU + "\n" + ROWS[0] + "\xff\n").encode("latin-1"))
    assert "UTF-8" in error(tmp_path)
    (tmp_path / "recording.toml").write_bytes(b"name = '\xff'\n")
    assert "UTF-8" in error(tmp_path)


@settings(max_examples=60, deadline=None)
@given(toml=st.binary(max_size=60), csv=st.binary(max_size=120))
def test_any_bytes_raise_only_input_errors(tmp_path_factory: pytest.TempPathFactory, toml: bytes, csv: bytes) -> None:
    path = tmp_path_factory.mktemp("bytes")
    (path / "recording.toml").write_bytes(b'format = 1\nkind = "flight"\n' + toml)
    (path / "imu.csv").write_bytes(csv)
    (path / "mag.csv").write_bytes(b"t,mag_x,mag_y,mag_z\n" + csv)
    with pytest.raises(InputError):
        open_log(path)


def test_rows_are_counted_where_the_recording_says_how_many(tmp_path: Path) -> None:
    folder(tmp_path, FLIGHT + "[rows]\nimu = 3\n")
    assert len(read_recording(tmp_path).streams["imu"]) == 3
    folder(tmp_path, FLIGHT + "[rows]\nimu = 4\nmag = 7\n")
    assert "no mag.csv with its 7 rows" in error(tmp_path)
    folder(tmp_path, FLIGHT + "[rows]\nimu = 4\n")
    assert "imu.csv with 3 of 4 rows" in error(tmp_path)
    folder(tmp_path, FLIGHT + "[rows]\nimu = 2\n")
    assert "imu.csv with 3 of 2 rows" in error(tmp_path)
    folder(tmp_path, FLIGHT + "[rows]\nimu = 3.5\n")
    assert "[rows] imu" in error(tmp_path)
    folder(tmp_path, FLIGHT + "[rows]\nnose = 3\n")
    assert "unknown key" in error(tmp_path)


def test_a_last_row_that_was_cut_off_is_seen(tmp_path: Path) -> None:
    """Two digits less, and it still is a number."""
    written = read_recording(folder(tmp_path))
    write_recording(written, tmp_path / "out")
    path = tmp_path / "out" / "imu.csv"
    path.write_bytes(path.read_bytes()[:-2])
    assert "imu.csv whose last row has no end" in error(tmp_path / "out")


def test_truth_is_counted_too(tmp_path: Path) -> None:
    truth = Stream(np.array([0.0, 1.0, 2.0]), {"north": np.array([1.0, 2.0, 3.0])})
    write_recording(read_recording(folder(tmp_path)).replace(truth=Truth(truth)), tmp_path / "out")
    path = tmp_path / "out" / "truth.csv"
    path.write_text("t,north\n0,1\n1,2\n")
    assert "truth.csv with 2 of 3 rows" in error(tmp_path / "out")
    path.unlink()
    assert read_recording(tmp_path / "out").notes == (
        "no truth.csv, of which recording.toml counts 3 rows: nothing can be scored",
    )
