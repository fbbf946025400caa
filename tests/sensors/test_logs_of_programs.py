"""Logs in the layouts that phones and inertial units write, each held against the flight from which it was written."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats import describes_itself, facts_of, open_log
from sinan.sensors.formats.column_names import meanings
from sinan.sensors.recording import ACCEL, GYRO, MAG, Recording
from sinan.sensors.rotation import rotate_back

G = 9.80665
#: ns since 1970 of the first row of a phone's log.
EPOCH = 1718030736872695300
#: Phones: x right, y to the top, z out of the screen; boards: x forward, y left, z up. Of forward-right-down.
PHONE, FLU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]), np.diag([1.0, -1.0, -1.0])
AXES = "xyz"


class Flight:
    """30 s at 50 Hz of a body that rolls, turns and is pushed about: force, its part without gravity, rate, field."""

    def __init__(self) -> None:
        self.t = t = 0.02 * np.arange(1500)
        roll, rate = 0.6 * np.sin(1.5 * t), 0.9 * np.cos(1.5 * t)
        q = np.stack([np.cos(roll / 2), np.sin(roll / 2), 0 * t, 0 * t], axis=-1)
        self.free = rotate_back(q, np.stack([0.5 * np.sin(2.0 * t), 0.3 * np.cos(t), 0.2 * np.sin(t)], axis=-1))
        self.gravity = rotate_back(q, np.tile([0.0, 0.0, -G], (len(t), 1)))
        self.force = self.free + self.gravity
        self.rate = np.stack([rate, 0.01 * np.sin(t), 0 * t], axis=-1)
        self.field = rotate_back(q, np.tile([21.0, -3.0, 43.0], (len(t), 1)))  # uT


@pytest.fixture(scope="module")
def flight() -> Flight:
    return Flight()


def check(log: Recording, flight: Flight, C: FloatArray, field: bool = True) -> None:
    """The log has the readings of the flight, whose axes are turned by C; each number was written in full."""
    imu = log.streams["imu"]
    assert log.kind == "flight"
    np.testing.assert_allclose(imu.t - imu.t[0], flight.t, atol=1e-5)
    np.testing.assert_allclose(imu.array(ACCEL), flight.force @ C.T, atol=1e-6)
    np.testing.assert_allclose(imu.array(GYRO), flight.rate @ C.T, atol=1e-6)
    if field:
        mag = log.streams["mag"]
        np.testing.assert_allclose(mag.array(MAG), flight.field @ C.T / 100.0, atol=1e-6)
        assert log.environment.field_unit == "gauss"


def write(path: Path, names: Sequence[str], columns: Sequence[FloatArray | Sequence[str]], mark: str = ",",
          above: str = "") -> Path:  # fmt: skip
    """A table whose numbers have all their digits."""
    cells = [one if isinstance(one[0], str) else [repr(value) for value in np.asarray(one).tolist()] for one in columns]
    rows = [mark.join(row) for row in zip(*cells, strict=True)]
    path.write_text(above + mark.join(names) + "\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def of(name: str, axes: str = AXES) -> list[str]:
    return [name.replace("#", axis) for axis in axes]


def three(values: FloatArray, C: FloatArray) -> list[FloatArray]:
    return list((values @ C.T).T)


# folders of a phone


def sensor_logger(folder: Path, flight: Flight, platform: str, standard: str = "false") -> Path:
    """Its files and the order of their columns, as its reference of units and axes has them: iOS has the other sign."""
    folder.mkdir()
    sign = -1.0 if (platform, standard) == ("ios", "false") else 1.0
    time = [str(EPOCH + round(1e9 * t)) for t in flight.t]
    tables = {"Accelerometer": sign * flight.free, "Gravity": sign * flight.gravity, "Gyroscope": flight.rate,
              "Magnetometer": flight.field}  # fmt: skip
    if platform == "android":
        tables["TotalAcceleration"] = flight.force
    for name, values in tables.items():
        write(folder / f"{name}.csv", ["time", "seconds_elapsed", "z", "y", "x"],
              [time, flight.t, *three(values, PHONE)[::-1]])  # fmt: skip
    write(folder / "Barometer.csv", ["time", "seconds_elapsed", "relativeAltitude", "pressure"],
          [time, flight.t, 0 * flight.t, 1006.6 + 0.01 * flight.t])  # fmt: skip
    fix = [
        "time",
        "seconds_elapsed",
        "verticalAccuracy",
        "horizontalAccuracy",
        "speed",
        "altitude",
        "longitude",
        "latitude",
    ]
    zero = 0.0 * flight.t
    write(folder / "Location.csv", fix, [time, flight.t, zero + 4.0, zero + 3.0, zero, zero + 50.0, zero + 116.34,
                                         39.98 + 1e-6 * flight.t])  # fmt: skip
    write(folder / "Metadata.csv", ["version", "platform", "standardisation"], [["3"], [platform], [standard]])
    return folder


@pytest.mark.parametrize(("platform", "standard"), [("android", "false"), ("ios", "false"), ("ios", "true")])
def test_the_folder_of_sensor_logger(tmp_path: Path, flight: Flight, platform: str, standard: str) -> None:
    log = open_log(sensor_logger(tmp_path / "log", flight, platform, standard))
    check(log, flight, np.eye(3))
    np.testing.assert_allclose(log.streams["baro"]["pressure"][0], 100660.0)
    np.testing.assert_allclose([log.streams["gps"][name][0] for name in ("eph", "epv")], [3.0, 4.0])
    assert log.origin is not None
    np.testing.assert_allclose(log.origin, (39.98, 116.34, 50.0))


def test_a_folder_of_tables_tells_what_it_holds(tmp_path: Path, flight: Flight) -> None:
    folder = sensor_logger(tmp_path / "log", flight, "android")
    assert describes_itself(folder)
    facts = facts_of(folder)
    assert facts is not None
    assert {"TotalAcceleration.csv", "Gyroscope.csv"} <= {table.name for table in facts.tables}


def test_fixes_that_a_phone_calls_invalid_are_left_out(tmp_path: Path, flight: Flight) -> None:
    folder = sensor_logger(tmp_path / "log", flight, "ios")
    lines = (folder / "Location.csv").read_text().splitlines()
    assert lines[5].count(",4.0,3.0,") == 1
    lines[5] = lines[5].replace(",4.0,3.0,", ",-1.0,3.0,")
    (folder / "Location.csv").write_text("\n".join(lines) + "\n")
    log = open_log(folder)
    assert len(log.streams["gps"]) == len(flight.t) - 1
    assert any("1 fixes left out" in note for note in log.notes)


def test_a_folder_without_gravity_is_refused(tmp_path: Path, flight: Flight) -> None:
    folder = sensor_logger(tmp_path / "log", flight, "ios")
    (folder / "Gravity.csv").unlink()
    with pytest.raises(InputError, match=r"looks like g \(or gravity was taken off\)|gravity was taken off"):
        open_log(folder)


def test_sensors_that_never_ran_together_are_no_imu(tmp_path: Path) -> None:
    """Nothing else of the folder is listed, so the message has no list."""
    for name, start in (("Accelerometer", 0.0), ("Gyroscope", 100.0)):
        t = start + 0.01 * np.arange(200)
        write(tmp_path / f"{name}.csv", ["time", "x", "y", "z"], [t, 0.1 + 0.0 * t, 0.0 * t, -9.8 + 0.0 * t])
    with pytest.raises(InputError, match=r"no accelerometer with a gyroscope; expected a log that has it"):
        open_log(tmp_path)


def test_the_folder_of_phyphox(tmp_path: Path, flight: Flight) -> None:
    """Tables of a unit in brackets and a linear accelerometer beside the whole one."""
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "device.csv").write_text('"property","value"\n"version","1.1.9"\n')
    for name, unit, values in (("Accelerometer", "m/s^2", flight.force), ("Linear Accelerometer", "m/s^2", flight.free),
                               ("Gyroscope", "rad/s", flight.rate), ("Magnetometer", "µT", flight.field)):  # fmt: skip
        names = ['"Time (s)"', *(f'"{axis.upper()} ({unit})"' for axis in AXES)]
        write(tmp_path / f"{name}.csv", names, [flight.t, *three(values, PHONE)])
    check(open_log(tmp_path), flight, np.eye(3))


# tables of one file: an acceleration without gravity stands beside the reading


def test_phyphox_in_one_file(tmp_path: Path, flight: Flight) -> None:
    called = ("Linear Acceleration # (m/s^2)", "Acceleration # (m/s^2)", "Gyroscope # (rad/s)", "Magnetic field # (µT)")
    names = ["Time (s)", *(name for one in called for name in of(one))]
    columns = [
        column for values in (flight.free, flight.force, flight.rate, flight.field) for column in three(values, PHONE)
    ]
    log = open_log(write(tmp_path / "log.csv", [f'"{name}"' for name in names], [flight.t, *columns]))
    check(log, flight, PHONE)
    assert any("accel_z reads +g" in note for note in log.notes)


def test_physics_toolbox(tmp_path: Path, flight: Flight) -> None:
    """`gFx` in g is the reading, `ax` in m/s^2 has no gravity."""
    names = ["time", *of("gF#"), *of("a#"), *of("w#"), "p"]
    columns = [column for values in (flight.force / G, flight.free, flight.rate) for column in three(values, PHONE)]
    log = open_log(write(tmp_path / "log.csv", names, [flight.t, *columns, 1006.6 + 0.0 * flight.t]))
    check(log, flight, PHONE, field=False)
    np.testing.assert_allclose(log.streams["baro"]["pressure"][0], 100660.0)


def test_androsensor(tmp_path: Path, flight: Flight) -> None:
    up = AXES.upper()
    names = [*of("ACCELEROMETER # (m/s²)", up), *of("GRAVITY # (m/s²)", up), *of("LINEAR ACCELERATION # (m/s²)", up),
             *of("GYROSCOPE # (rad/s)", up), *of("MAGNETIC FIELD # (μT)", up), "LOCATION Latitude : ",
             "Time since start in ms ", "YYYY-MO-DD HH-MI-SS_SSS"]  # fmt: skip
    values = (flight.force, flight.gravity, flight.free, flight.rate, flight.field)
    columns = [column for one in values for column in three(one, PHONE)]
    when = ["2017-05-05 12-00-00_000"] * len(flight.t)
    table = [*columns, 0 * flight.t, np.round(1e3 * flight.t), when]
    check(open_log(write(tmp_path / "log.csv", names, table, ";")), flight, PHONE)


def test_an_acceleration_and_its_gravity_are_a_reading(tmp_path: Path, flight: Flight) -> None:
    names = ["t", *of("user_acc_#"), *of("gravity_#"), *of("gyro_#")]
    columns = [column for values in (flight.free, flight.gravity, flight.rate) for column in three(values, FLU)]
    check(open_log(write(tmp_path / "log.csv", names, [flight.t, *columns])), flight, FLU, field=False)


@pytest.mark.parametrize("scale", [1.0, 6.0])
def test_an_acceleration_without_gravity_is_refused(tmp_path: Path, flight: Flight, scale: float) -> None:
    """However it is called, and where it is as long as half of gravity."""
    columns = [*(scale * flight.free).T, *flight.rate.T]
    with pytest.raises(InputError, match="gravity was taken off"):
        open_log(write(tmp_path / "log.csv", ["t", *of("a#"), *of("g#")], [flight.t, *columns]))


def test_rates_in_degrees_are_seen_by_gravity(tmp_path: Path) -> None:
    """A multicopter's force stays along its own z, so that no direction turns with the rates."""
    t = 0.01 * np.arange(3000)
    rate = np.stack([0.8 * np.cos(1.5 * t), 0.5 * np.cos(1.1 * t), 0.3 * np.cos(0.4 * t)], axis=-1)
    still = np.tile([0.0, 0.0, -G], (len(t), 1))
    names = ["t", *of("a#"), *of("g#")]
    assert "imu" in open_log(write(tmp_path / "rad.csv", names, [t, *still.T, *rate.T])).streams
    with pytest.raises(InputError, match=r"looks like deg/s .*a header, `ax \[g\]`"):
        open_log(write(tmp_path / "deg.csv", names, [t, *still.T, *np.degrees(rate).T]))


@pytest.mark.parametrize(("sign", "told"), [(1.0, False), (-1.0, True)])
def test_gravity_for_force_is_seen_by_the_dip(tmp_path: Path, flight: Flight, sign: float, told: bool) -> None:
    """At 40 deg north the field dips by 59 deg; with the other sign of the accelerometer it points up."""
    names = ["t", *of("a#"), *of("g#"), *of("mag # [uT]"), "lat", "lon", "alt"]
    place = [39.98 + 1e-7 * flight.t, 116.34 + 0 * flight.t, 50.0 + 0 * flight.t]
    columns = [flight.t, *(sign * flight.force).T, *flight.rate.T, *flight.field.T, *place]
    log = open_log(write(tmp_path / "log.csv", names, columns))
    assert any("gravity is logged, not force (a map" in note for note in log.notes) == told


def test_fast_turns_by_hand_whose_median_is_no_bias_are_read(tmp_path: Path) -> None:
    """Most of the time at 0.6 rad/s about an axis that lies level, back faster: the median rate is no bias."""
    t = 0.01 * np.arange(3000)
    rate = np.where(t % 4.0 < 3.0, 0.6, -1.8)
    angle = np.concatenate([[0.0], np.cumsum(0.01 * rate[:-1])])
    force = G * np.stack([0 * t, -np.sin(angle), -np.cos(angle)], axis=-1)
    columns = [t, *force.T, rate, 0 * t, 0 * t]
    assert "imu" in open_log(write(tmp_path / "log.csv", ["t", *of("a#"), *of("g#")], columns)).streams


# lines above and below the names; times


def test_witmotion(tmp_path: Path, flight: Flight) -> None:
    """A date for a time, tabs, and rates called `AsX`, fields `HX`."""
    names = ["time", "DeviceName", *of("Acc#(g)", "XYZ"), *of("As#(°/s)", "XYZ"), *of("H#(uT)", "XYZ")]
    when = [f"2023-05-05 12:00:{t:06.3f}" for t in flight.t]
    values = (flight.force / G, np.degrees(flight.rate), flight.field)
    columns = [when, ["WT901"] * len(when), *(column for one in values for column in three(one, FLU))]
    check(open_log(write(tmp_path / "log.txt", names, columns, "\t")), flight, FLU)


def test_times_of_day_below_a_line_of_text(tmp_path: Path, flight: Flight) -> None:
    names = ["Time(s)", *of("a#(g)"), *of("w#(deg/s)")]
    when = [f"23:59:{t:06.3f}" for t in 10.0 + flight.t]
    columns = [column for one in (flight.force / G, np.degrees(flight.rate)) for column in three(one, FLU)]
    above = "StartTime: 2023-05-05 23:59:10.000\n"
    check(open_log(write(tmp_path / "log.txt", names, [when, *columns], "\t", above)), flight, FLU, field=False)


def test_a_time_that_is_none_is_named(tmp_path: Path, flight: Flight) -> None:
    when = [f"2023-05-05 12:00:{t:06.3f}" for t in flight.t]
    when[700] = "2023-05-05 12:00:99.000"
    columns = [when, *flight.force.T, *flight.rate.T]
    with pytest.raises(InputError, match="in column time"):
        open_log(write(tmp_path / "log.csv", ["time", *of("a#"), *of("g#")], columns))


def test_shimmer(tmp_path: Path, flight: Flight) -> None:
    """Names that begin alike, units below them, a mark after the last cell, a field whose unit is its own strength."""
    device = "Shimmer_8665_"
    names = [device + name for name in ("Timestamp_Unix_CAL", *of("Accel_LN_#_CAL", "XYZ"), *of("Gyro_#_CAL", "XYZ"),
                                        *of("Mag_#_CAL", "XYZ"))]  # fmt: skip
    units = "\t".join(["ms"] + ["m/(s^2)"] * 3 + ["deg/s"] * 3 + ["local_flux"] * 3)
    values = (flight.force, np.degrees(flight.rate), flight.field)
    columns = [1.6e12 + 1e3 * flight.t, *(column for one in values for column in three(one, FLU))]
    path = write(tmp_path / "log.csv", names, columns, "\t", '"sep=\t"\n')
    lines = path.read_text().splitlines()
    path.write_text("".join(f"{line}\n" for line in [lines[0], *(f"{row}\t" for row in [lines[1], units, *lines[2:]])]))
    log = open_log(path)
    check(log, flight, FLU, field=False)
    np.testing.assert_allclose(log.streams["mag"].array(MAG), flight.field @ FLU)


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_a_time_whose_unit_nobody_says(tmp_path: Path, flight: Flight, unit: str, factor: float) -> None:
    """As `ulog2csv` writes it: axes in brackets, a time stamp without a unit."""
    names = ["timestamp", *(f"gyro_rad[{k}]" for k in range(3)), *(f"accelerometer_m_s2[{k}]" for k in range(3))]
    columns = [np.round(factor * flight.t) + 7e6, *flight.rate.T, *flight.force.T]
    log = open_log(write(tmp_path / "log.csv", names, columns))
    check(log, flight, np.eye(3), field=False)
    assert any(f"is taken for {unit}, which nobody says" in note for note in log.notes)


def test_topics_of_plotjuggler(tmp_path: Path, flight: Flight) -> None:
    names = ["__time", *of("/imu/data/angular_velocity/#"), *of("/imu/data/linear_acceleration/#")]
    columns = [*three(flight.rate, FLU), *three(flight.force, FLU)]
    log = open_log(write(tmp_path / "log.csv", names, [1.7e9 + flight.t, *columns]))
    check(log, flight, FLU, field=False)


def test_of_two_times_the_one_that_says_more_counts() -> None:
    assert [name for name, what in meanings(["time", "seconds_elapsed", "x"]).items() if what.column == "t"] == [
        "seconds_elapsed"
    ]
    assert set(meanings(["acc_x", "acc_y", "acc_z"])) == {"acc_x", "acc_y", "acc_z"}


# maps of docs/formats.md


def documented_map(folder: Path, about: str) -> Path:
    """The map that follows a line of docs/formats.md, as a file."""
    text = (Path(__file__).parents[2] / "docs" / "formats.md").read_text(encoding="utf-8").partition(f"\n{about}")[2]
    (folder / "map.toml").write_text(text.partition("```toml\n")[2].partition("```")[0], encoding="utf-8")
    return folder / "map.toml"


def test_the_map_of_betaflight(tmp_path: Path, flight: Flight) -> None:
    names = ["loopIteration", "time (us)", *(f"gyroADC[{k}]" for k in range(3)), *(f"accSmooth[{k}]" for k in range(3))]
    values = (np.round(np.degrees(flight.rate)), np.round(2048 * flight.force / G))
    columns = [np.arange(1500), np.round(1e6 * flight.t), *(column for one in values for column in three(one, FLU))]
    path = write(tmp_path / "log.csv", names, columns, ", ")
    imu = open_log(path, documented_map(tmp_path, "A Betaflight log")).streams["imu"]
    half_a_count = 0.51
    np.testing.assert_allclose(imu.array(ACCEL), flight.force, atol=half_a_count * G / 2048)
    np.testing.assert_allclose(imu.array(GYRO), flight.rate, atol=np.radians(half_a_count))


def test_the_map_of_sensorlog(tmp_path: Path, flight: Flight) -> None:
    stamp = 5000.0 + flight.t
    names = ["accelerometerTimestamp_sinceReboot(s)", *of("accelerometerAcceleration#(G)", "XYZ"),
             "gyroTimestamp_sinceReboot(s)", *of("gyroRotation#(rad/s)", "XYZ"),
             "magnetometerTimestamp_sinceReboot(s)", *of("magnetometer#(µT)", "XYZ")]  # fmt: skip
    values = (-flight.force / G, flight.rate, flight.field)
    columns = [column for one in values for column in (stamp, *three(one, PHONE))]
    path = write(tmp_path / "log.csv", names, columns)
    check(open_log(path, documented_map(tmp_path, "SensorLog of iOS")), flight, np.eye(3))


def test_the_map_of_an_mti(tmp_path: Path, flight: Flight) -> None:
    names = ["PacketCounter", "SampleTimeFine", *of("Acc_#", "XYZ"), *of("FreeAcc_#", "ENU"), *of("Gyr_#", "XYZ"),
             *of("Mag_#", "XYZ")]  # fmt: skip
    values = (flight.force, flight.free, flight.rate, flight.field)
    columns = [column for one in values for column in three(one, FLU)]
    above = "// Start Time: Unknown\n// Sample rate: 50.0Hz\n// Scenario: 4.9General\n// Firmware Version: 4.3.0\n"
    path = write(tmp_path / "log.txt", names, [np.arange(1500), np.round(1e4 * flight.t), *columns], "\t", above)
    log = open_log(path, documented_map(tmp_path, "Xsens MTi"))
    check(log, flight, np.eye(3), field=False)
    np.testing.assert_allclose(log.streams["mag"].array(MAG), flight.field)


# what cannot be read says what to do


def test_an_imu_beside_a_magnetometer_is_not_passed_over(tmp_path: Path, flight: Flight) -> None:
    """SensorLog's accelerometer has Apple's sign, its times one a sensor: a table for a map, not for a magnetometer."""
    names = ["accelerometerTimestamp_sinceReboot(s)", *of("accelerometerAcceleration#(G)", "XYZ"),
             *of("gyroRotation#(rad/s)", "XYZ"), *of("magnetometer#(µT)", "XYZ")]  # fmt: skip
    columns = [column for values in (-flight.force / G, flight.rate, flight.field) for column in three(values, PHONE)]
    path = write(tmp_path / "log.csv", names, [5000.0 + flight.t, *columns])
    with pytest.raises(InputError, match="column `accelerometerAccelerationX"):
        open_log(path)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("$GPGGA,120000.00,3958.8000,N,11620.4000,E,1,08,0.9,56.4,M,46.9,M,,*4F\n" * 20, "NMEA sentences"),
        ("$VNYMR,+006.271,+000.031,-002.000,+1.0,+0.1,+2.1,+0.1,+0.1,-9.8,+0.0,+0.0,+0.0*65\n" * 20, "a VectorNav"),
        ("H Product:Blackbox flight data recorder by Nicholas Sherlock\nH Data version:2\n", "blackbox_decode"),
        ("0,-0.01,0.02,-0.99,0.1,0.2,0.3\n10,-0.01,0.02,-0.99,0.1,0.2,0.3\n", "7 numbers a line and no names"),
    ],
)
def test_what_a_text_without_names_is(tmp_path: Path, text: str, told: str) -> None:
    (tmp_path / "log.txt").write_text(text)
    with pytest.raises(InputError, match=told):
        open_log(tmp_path / "log.txt")
