"""ArduPilot's dataflash logs: messages as pymavlink reads them, readings as ArduPilot's own documents say."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sinan.sensors.errors import InputError
from sinan.sensors.formats import facts_of, open_log
from sinan.sensors.formats.choice import Choice
from sinan.sensors.formats.dataflash_messages import read_messages
from sinan.sensors.recording import ACCEL, GYRO, MAG, VELOCITY
from sinan.sensors.rotation import rpy_from_quaternion

#: How a letter is stored, by ArduPilot's LogStructure.h.
STORED = {
    "b": "b", "B": "B", "h": "h", "H": "H", "i": "i", "I": "I", "f": "f", "d": "d", "n": "4s", "N": "16s", "Z": "64s",
    "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B", "q": "q", "Q": "Q",
}  # fmt: skip
TIMES = {"c": 100, "C": 100, "e": 100, "E": 100, "L": 1e7}
#: Name, format, columns, units, multipliers as ArduCopter 4.5 writes them.
KINDS = {
    "FMTU": ("QBNN", "TimeUS,FmtType,UnitIds,MultIds", "s---", "F---"),
    "UNIT": ("QbZ", "TimeUS,Id,Label", "s--", "F--"),
    "MULT": ("Qbd", "TimeUS,Id,Mult", "s--", "F--"),
    "PARM": ("QNff", "TimeUS,Name,Value,Default", "s---", "F---"),
    "MSG": ("QZ", "TimeUS,Message", "s-", "F-"),
    "IMU": (
        "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz",
        "s#EEEooo--O--zz", "F-000000-----00",
    ),
    "IMT": (
        "QBfffffffff", "TimeUS,I,DelT,DelvT,DelaT,DelAX,DelAY,DelAZ,DelVX,DelVY,DelVZ", "s#sssrrrnnn", "F-F00000000",
    ),
    "ACC": ("QBQfff", "TimeUS,I,SampleUS,AccX,AccY,AccZ", "s#sooo", "F-F000"),
    "GYR": ("QBQfff", "TimeUS,I,SampleUS,GyrX,GyrY,GyrZ", "s#sEEE", "F-F000"),
    "MAG": (
        "QBhhhhhhhhhBI", "TimeUS,I,MagX,MagY,MagZ,OfsX,OfsY,OfsZ,MOX,MOY,MOZ,Health,S", "s#GGGGGGGGG-s",
        "F-CCCCCCCCC-F",
    ),
    "BARO": ("QBffcfIffB", "TimeUS,I,Alt,Press,Temp,CRt,SMS,Offset,GndTemp,Health", "s#mPOnsmO-", "F-00B0C?0-"),
    "GPS": (
        "QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U", "s#-s-S-DUmnhnh-",
        "F--C-0BGGB000--",
    ),
    "GPA": ("QBCCCCfBIH", "TimeUS,I,VDop,HAcc,VAcc,SAcc,YAcc,VV,SMS,Delta", "s#mmmnd-ss", "F-BBBB0-CC"),
    "BAT": ("QBfffffcf", "TimeUS,Instance,Volt,VoltR,Curr,CurrTot,EnrgTot,Temp,Res", "s#vvAiJOw", "F-000!/?0"),
    "RFND": ("QBCBB", "TimeUS,Instance,Dist,Stat,Orient", "s#m--", "F-B--"),
    "RCOU": ("QHHHHHH", "TimeUS,C1,C2,C3,C4,C5,C6", "sYYYYYY", "F------"),
    "XKF1": (
        "QBccCfffffffccce", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH", "s#ddhnnnnmmmkkkm",
        "F-BBB0000000BBBB",
    ),
}  # fmt: skip
UNITS = {
    "s": "s", "#": "instance", "E": "rad/s", "o": "m/s/s", "O": "degC", "G": "Gauss", "m": "m", "n": "m/s", "P": "Pa",
    "D": "deglatitude", "U": "deglongitude", "h": "degheading", "d": "deg", "A": "A", "v": "V", "r": "rad",
    "z": "Hz", "S": "satellites", "k": "deg/s", "Y": "us",
}  # fmt: skip
MULTIPLIERS = {"-": 0.0, "?": 1.0, "0": 1.0, "B": 1e-2, "C": 1e-3, "F": 1e-6, "G": 1e-7}
GRAVITY = 9.80665
Message = tuple[str, Sequence[object]]


def binary(messages: Sequence[Message], units: bool = True, kinds: dict = KINDS) -> bytes:  # type: ignore[type-arg]
    """A log as ArduPilot writes it: first what names the columns, then the messages, numbers as they are stored."""
    numbers = {name: 129 + k for k, name in enumerate(kinds)}

    def one(name: str, values: Sequence[object]) -> bytes:
        form = kinds[name][0]
        packed = [value.encode() if isinstance(value, str) else value for value in values]
        return b"\xa3\x95" + bytes([numbers[name]]) + struct.pack("<" + "".join(map(STORED.get, form)), *packed)

    def fmt(number: int, name: str, form: str, columns: str) -> bytes:
        size = 3 + struct.calcsize("<" + "".join(map(STORED.get, form)))
        return b"\xa3\x95\x80" + struct.pack(
            "<BB4s16s64s", number, size, name.encode(), form.encode(), columns.encode()
        )

    parts = [fmt(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")]
    parts += [fmt(numbers[name], name, form, columns) for name, (form, columns, *_) in kinds.items()]
    if units:
        parts += [one("UNIT", (1, ord(letter), unit)) for letter, unit in UNITS.items()]
        parts += [one("MULT", (1, ord(letter), float(np.float32(value)))) for letter, value in MULTIPLIERS.items()]
        parts += [one("FMTU", (1, numbers[name], unit, mult)) for name, (_, _, unit, mult) in kinds.items()]
    return b"".join(parts + [one(*message) for message in messages])


def text(messages: Sequence[Message], units: bool = True, kinds: dict = KINDS) -> bytes:  # type: ignore[type-arg]
    """The same log as ArduPilot's ground stations print it: hundredths and degrees in full, all else as stored."""
    numbers = {name: 129 + k for k, name in enumerate(kinds)}
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    lines += [f"FMT, {numbers[name]}, 50, {name}, {form}, {columns}" for name, (form, columns, *_) in kinds.items()]

    def one(name: str, values: Sequence[object]) -> str:
        cells = [f"{value / TIMES[letter]:.9g}" if letter in TIMES else f"{value}"  # type: ignore[operator]
                 for letter, value in zip(kinds[name][0], values, strict=True)]  # fmt: skip
        return ", ".join([name, *cells])

    if units:
        lines += [one("UNIT", (1, ord(letter), unit)) for letter, unit in UNITS.items()]
        lines += [one("MULT", (1, ord(letter), value)) for letter, value in MULTIPLIERS.items()]
        lines += [one("FMTU", (1, numbers[name], unit, mult)) for name, (_, _, unit, mult) in kinds.items()]
    return ("\n".join(lines + [one(*message) for message in messages]) + "\n").encode()


def imu(us: int, number: int = 0, gyro: Sequence[float] = (0.01, 0.02, 0.03), az: float = -GRAVITY) -> Message:
    return "IMU", (us, number, *gyro, 0.0, 0.1, az, 0, 0, 41.5, 1, 1, 1000, 1000)


def mag(us: int, number: int = 0, field: Sequence[int] = (210, -30, 420), offset: Sequence[int] = (11, -22, 33),
        motor: Sequence[int] = (1, 2, -3), taken: int | None = None) -> Message:  # fmt: skip
    return "MAG", (us, number, *field, *offset, *motor, 1, us % 2**32 if taken is None else taken)


def flight() -> list[Message]:
    """A second of a copter at rest that says all that is read; times from 10 s on."""
    messages: list[Message] = [
        ("MSG", (1, "ArduCopter V4.5.7 (2a3dc4b7)")),
        *(("PARM", (1, name, value, 0.0)) for name, value in {
            "SERVO1_FUNCTION": 33.0, "SERVO2_FUNCTION": 0.0, "SERVO3_FUNCTION": 34.0, "MOT_PWM_MIN": 1100.0,
            "MOT_PWM_MAX": 1900.0, "RNGFND1_TYPE": 20.0, "RNGFND2_TYPE": 13.0, "AHRS_ORIENTATION": 0.0,
        }.items()),
    ]  # fmt: skip
    for k in range(50):
        us = 10_000_000 + 20_000 * k
        messages += [imu(us), imu(us, 1, az=-9.7)]
        if k % 5 == 0:
            messages += [
                mag(us, 0), mag(us, 1, (300, 0, 100)),
                ("BARO", (us, 0, 1.25, 95_000.0, 2350, 0.0, us // 1000, 0.0, 20.0, 1)),
                ("BAT", (us, 0, 16.2, 16.3, 12.5, 1.0, 1.0, 2500, 0.01)),
                ("BAT", (us, 1, 15.0, 15.0, 3.5, 1.0, 1.0, 2500, 0.01)),
                ("RFND", (us, 0, 137, 4, 25)), ("RFND", (us, 1, 141, 4, 25)),
                ("RCOU", (us, 1500, 1000, 1100, 1000, 0, 0)),
                ("XKF1", (us, 0, 1000, -500, 27000, *[0.0] * 7, 0, 0, 0, 0)),
                ("XKF1", (us, 1, 0, 0, 0, *[0.0] * 7, 0, 0, 0, 0)),
            ]  # fmt: skip
        if k % 10 == 0:
            fix = 3 if k else 1
            messages += [
                ("GPS", (us, 0, fix, 100, 2200, 14, 75, 473_977_000, 85_456_000, 48_800, 5.0, 90.0, -0.5, 0.0, 1)),
                ("GPA", (us, 0, 120, 90, 150, 30, 0.0, 1, us // 1000, 100)),
            ]
    return messages


WRITTEN = pytest.mark.parametrize("write", [binary, text])


@WRITTEN
def test_every_number_is_as_pymavlink_reads_it(tmp_path: Path, write: object) -> None:
    reader = pytest.importorskip("pymavlink.DFReader")
    path = tmp_path / "a.log"
    path.write_bytes(write(flight()))  # type: ignore[operator]
    log = read_messages(path)
    theirs = (reader.DFReader_binary if write is binary else reader.DFReader_text)(str(path))
    seen = dict.fromkeys(log.kinds, 0)
    while (message := theirs.recv_msg()) is not None:
        kind = message.get_type()
        if kind == "FMT":
            continue
        for name in message.get_fieldnames():
            if log.kinds[kind].format[log.kinds[kind].fields.index(name)] in "nNZ":
                assert log.texts(kind, name)[seen[kind]] == getattr(message, name)
            else:
                assert log.raw(kind, name)[seen[kind]] == pytest.approx(float(getattr(message, name)), rel=1e-12)
        seen[kind] += 1
    theirs.close()
    assert {name: count for name, count in seen.items() if name != "FMT"} == {
        name: count for name, count in log.counts.items() if name != "FMT"
    }


@WRITTEN
def test_a_log_says_what_its_columns_are(tmp_path: Path, write: object) -> None:
    path = tmp_path / "flight"
    path.write_bytes(write(flight()))  # type: ignore[operator]
    recording = open_log(path)
    streams = recording.streams
    assert set(streams) == {"imu", "mag", "baro", "gps", "power", "motors", "laser", "sonar"}
    np.testing.assert_allclose(streams["imu"].t, 0.02 * np.arange(50), atol=1e-9)
    np.testing.assert_allclose(streams["imu"].array(GYRO)[0], [0.01, 0.02, 0.03], rtol=1e-6)
    np.testing.assert_allclose(streams["imu"].array(ACCEL)[0], [0.0, 0.1, -GRAVITY], rtol=1e-6)
    assert streams["imu"]["temperature"][0] == pytest.approx(41.5)
    np.testing.assert_allclose(streams["mag"].array(MAG)[0], [0.210, -0.030, 0.420])  # gauss
    assert recording.environment.field_unit == "gauss"
    baro = {name: values[0] for name, values in streams["baro"].columns.items()}
    assert baro == pytest.approx({"height": 1.25, "pressure": 95_000.0, "temperature": 23.5})
    gps = streams["gps"]
    assert gps.t[0] == pytest.approx(0.2)  # the first had no fix
    np.testing.assert_allclose(gps.array(VELOCITY)[0], [0.0, 5.0, -0.5], atol=1e-9)  # course 90 deg: east
    said = gps.array(("eph", "epv", "s_variance", "hdop", "vdop", "satellites"))[0]
    np.testing.assert_allclose(said, [0.9, 1.5, 0.3, 0.75, 1.2, 14.0])
    assert recording.origin == pytest.approx((47.3977, 8.5456, 488.0))
    power = {name: values[0] for name, values in streams["power"].columns.items()}
    assert power == pytest.approx({"current": 12.5, "voltage": 16.2, "current_2": 3.5, "voltage_2": 15.0})
    np.testing.assert_allclose(streams["motors"].array(("motor_1", "motor_2"))[0], [0.5, 0.0])  # outputs 1 and 3
    assert streams["laser"]["range"][0] == pytest.approx(1.37)
    assert streams["sonar"]["range"][0] == pytest.approx(1.41)
    assert recording.truth is not None
    assert recording.truth.kind == "autopilot"
    rpy = rpy_from_quaternion(recording.truth.stream.array(("qw", "qx", "qy", "qz")))
    np.testing.assert_allclose(np.degrees(rpy[0]), [10.0, -5.0, -90.0], atol=1e-9)


@WRITTEN
def test_a_log_without_units_is_in_those_that_its_firmware_wrote(tmp_path: Path, write: object) -> None:
    path = tmp_path / "flight"
    path.write_bytes(write(flight(), units=False))  # type: ignore[operator]
    old = open_log(path)
    path.write_bytes(write(flight()))  # type: ignore[operator]
    new = open_log(path)
    for name, stream in new.streams.items():
        np.testing.assert_allclose(old.streams[name].t, stream.t, atol=1e-9)
        for column, values in stream.columns.items():
            np.testing.assert_allclose(old.streams[name][column], values, rtol=1e-9, err_msg=f"{name} {column}")


def test_the_multiplier_of_the_log_counts_not_that_of_the_letter(tmp_path: Path) -> None:
    """A firmware that stores millimetres under a letter of hundredths, and says so: 1370 are 1.37 m."""
    kinds = {**KINDS, "RFND": ("QBCBB", "TimeUS,Instance,Dist,Stat,Orient", "s#m--", "F-C--")}
    path = tmp_path / "flight"
    messages = [imu(20_000 * k) for k in range(1, 40)] + [("RFND", (700_000, 0, 1370, 4, 25))]
    for write in (binary, text):
        path.write_bytes(write(messages, kinds=kinds))
        assert open_log(path).streams["laser"]["range"][0] == pytest.approx(1.37)


@pytest.mark.parametrize(("option", "expected"), [(Choice(), 0.210), (Choice(mag=1), 0.300)])
def test_the_magnetometer_that_is_asked_for(tmp_path: Path, option: Choice, expected: float) -> None:
    path = tmp_path / "flight"
    path.write_bytes(binary(flight()))
    assert open_log(path, choice=option).streams["mag"]["mag_x"][0] == pytest.approx(expected)


@pytest.mark.parametrize("sensor", ["imu", "mag", "baro", "gps"])
def test_a_sensor_that_is_not_there(tmp_path: Path, sensor: str) -> None:
    path = tmp_path / "flight"
    path.write_bytes(binary(flight()))
    with pytest.raises(InputError, match=rf"--{sensor}: no {sensor} number 2; expected one of 0"):
        open_log(path, choice=Choice(**{sensor: 2}))


def test_older_logs_have_a_kind_for_each_sensor(tmp_path: Path) -> None:
    """As Copter 3.6 named them."""
    kinds = {
        "PARM": ("QNf", "TimeUS,Name,Value"), "IMU": ("Qffffff", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
        "IMU2": ("Qffffff", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"), "BARO": ("Qffc", "TimeUS,Alt,Press,Temp"),
        "BAR2": ("Qffc", "TimeUS,Alt,Press,Temp"),
        "MAG": ("Qhhh", "TimeUS,MagX,MagY,MagZ"), "MAG2": ("Qhhh", "TimeUS,MagX,MagY,MagZ"),
    }  # fmt: skip
    messages: list[Message] = []
    for us in range(1_000_000, 2_000_000, 20_000):
        messages += [
            ("IMU", (us, 0, 0, 0, 0, 0, -9.8)), ("IMU2", (us, 0, 0, 0, 0, 0, -9.7)),
            ("BARO", (us, 1.0, 95e3, 2000)), ("BAR2", (us, 2.0, 95e3, 2000)),
            ("MAG", (us, 200, 0, 400)), ("MAG2", (us, 300, 0, 400)),
        ]  # fmt: skip
    path = tmp_path / "flight"
    for write in (binary, text):
        path.write_bytes(write(messages, units=False, kinds=kinds))
        first, second = open_log(path), open_log(path, choice=Choice(imu=1, mag=1, baro=1))
        for recording, expected in ((first, (-9.8, 1.0, 0.2)), (second, (-9.7, 2.0, 0.3))):
            streams = recording.streams
            found = streams["imu"]["accel_z"][0], streams["baro"]["height"][0], streams["mag"]["mag_x"][0]
            assert found == pytest.approx(expected, rel=1e-6)


def test_two_ranges_in_one_message(tmp_path: Path) -> None:
    """As Copter 3.6 wrote them; the second looks down by sound."""
    kinds = {
        "PARM": ("QNf", "TimeUS,Name,Value"), "IMU": ("Qffffff", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
        "RFND": ("QCBBCBB", "TimeUS,Dist1,Stat1,Orient1,Dist2,Stat2,Orient2"),
    }  # fmt: skip
    messages: list[Message] = [("PARM", (1, "RNGFND2_TYPE", 2.0))]
    for us in range(1_000_000, 2_000_000, 20_000):
        messages += [("IMU", (us, 0, 0, 0, 0, 0, -9.8)), ("RFND", (us, 500, 4, 0, 137, 4, 25))]
    path = tmp_path / "flight"
    path.write_bytes(binary(messages, units=False, kinds=kinds))
    streams = open_log(path).streams
    assert set(streams) == {"imu", "sonar"}
    assert streams["sonar"]["range"][0] == pytest.approx(1.37)


def test_integrals_of_the_imu_are_means_over_their_time(tmp_path: Path) -> None:
    """A turn of 0.5 rad/s at rest, in steps of 10 ms that the integrals fill."""
    messages = [
        ("IMT", (10_000 * k, 0, 0.01, 0.01, 0.01, 0.0, 0.0, 0.005, 0.0, 0.0, -0.0980665)) for k in range(1, 100)
    ]
    path = tmp_path / "flight"
    path.write_bytes(binary([*messages, imu(1000), imu(900_000)]))
    recording = open_log(path)
    np.testing.assert_allclose(recording.streams["imu"]["gyro_z"], 0.5, rtol=1e-6)
    np.testing.assert_allclose(recording.streams["imu"]["accel_z"], -GRAVITY, rtol=1e-6)
    assert recording.spec("accel").imu_samples == "average"
    assert "imu: IMT is read, not IMU" in recording.notes


def test_raw_samples_of_two_chips_on_one_clock(tmp_path: Path) -> None:
    """The force rises by 1 m/s^2 a second; it is read at the gyroscope's stamps, half a step later."""
    messages: list[Message] = []
    for us in range(1_000_000, 1_400_000, 1000):
        messages.append(("ACC", (us + 300, 0, us, 0.0, 0.0, -9.8 + 1e-6 * us)))
        messages.append(("GYR", (us + 900, 0, us + 500, 0.0, 0.0, 0.1)))
    path = tmp_path / "flight"
    path.write_bytes(binary(messages))
    imu = open_log(path).streams["imu"]
    np.testing.assert_allclose(imu["accel_z"], -9.8 + 1.0005 + 0.001 * np.arange(399), atol=2e-6)
    np.testing.assert_allclose(np.diff(imu.t), 0.001, atol=1e-9)


def test_a_reading_is_stamped_when_it_was_taken_on_a_clock_that_wraps(tmp_path: Path) -> None:
    """4 ms before it was written, across the end of 32 bits."""
    start = 2**32 + 1000
    messages = [imu(start + 20_000 * k) for k in range(-10, 40)]
    messages += [mag(start + 100_000 * k, taken=(start + 100_000 * k - 4000) % 2**32) for k in range(5)]
    path = tmp_path / "flight"
    path.write_bytes(binary(messages))
    np.testing.assert_allclose(open_log(path).streams["mag"].t, 0.2 - 0.004 + 0.1 * np.arange(5), atol=1e-6)


def test_a_binary_log_with_a_map_has_the_names_of_a_text_log(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(
        'kind = "poses"\n[streams.poses]\ntime = { column = "GPS.TimeUS", unit = "us" }\n'
        'accel = ["GPS.Lat", "GPS.Lng", "GPS.HDop"]\n[environment]\ngravity = 1\n'
    )
    for write in (binary, text):
        (tmp_path / "log").write_bytes(write(flight()))
        poses = open_log(tmp_path / "log", tmp_path / "map.toml").streams["poses"]
        np.testing.assert_allclose(poses.array(ACCEL)[0], [47.3977, 8.5456, 0.75])


# --- what the autopilot has put into its readings ---------------------------------------------------------


def corrected(raw: np.ndarray, current: float) -> np.ndarray:
    """`AP_Compass_Backend::correct_field`, for offsets 11, -22, 33 mGauss: offset, scale, soft iron, motor."""
    field = (raw + np.array([0.011, -0.022, 0.033])) * 1.1
    field = np.array([[1.02, 0.03, -0.04], [0.03, 0.97, 0.05], [-0.04, 0.05, 1.08]]) @ field
    return np.asarray(field + current * np.array([0.002, -0.003, 0.004]))


COMPASS = {
    "COMPASS_OFS_X": 11.0, "COMPASS_OFS_Y": -22.0, "COMPASS_OFS_Z": 33.0, "COMPASS_SCALE": 1.1,
    "COMPASS_DIA_X": 1.02, "COMPASS_DIA_Y": 0.97, "COMPASS_DIA_Z": 1.08, "COMPASS_ODI_X": 0.03,
    "COMPASS_ODI_Y": -0.04, "COMPASS_ODI_Z": 0.05, "COMPASS_OFS2_X": 0.0, "COMPASS_OFS2_Y": 0.0, "COMPASS_OFS2_Z": 0.0,
}  # fmt: skip
INERTIAL = {
    "INS_ACCOFFS_X": 0.3, "INS_ACCOFFS_Y": -0.2, "INS_ACCOFFS_Z": 0.1, "INS_ACCSCAL_X": 1.01, "INS_ACCSCAL_Y": 0.99,
    "INS_ACCSCAL_Z": 1.002, "INS_GYROFFS_X": 0.02, "INS_GYROFFS_Y": -0.01, "INS_GYROFFS_Z": 0.005,
}  # fmt: skip


def compensated(parameters: dict[str, float]) -> tuple[list[Message], np.ndarray]:
    """A log of corrected readings, and the field that the compass saw."""
    raw = np.array([[0.2 + 0.01 * k, -0.1 + 0.02 * k, 0.4] for k in range(10)])
    messages: list[Message] = [("PARM", (1, name, value, 0.0)) for name, value in parameters.items()]
    for k in range(50):
        us = 1_000_000 + 20_000 * k
        force = (np.array([0.5, 0.1, -9.7]) - [0.3, -0.2, 0.1]) * [1.01, 0.99, 1.002]
        rate = np.array([0.02, 0.01, 0.03]) - [0.02, -0.01, 0.005]
        messages.append(("IMU", (us, 0, *rate, *force, 0, 0, 30.0, 1, 1, 0, 0)))
        if k % 5 == 0:
            current = float(k)
            field = np.round(1000.0 * corrected(raw[k // 5], current)).astype(int)
            motor = np.round(1000.0 * current * np.array([0.002, -0.003, 0.004])).astype(int)
            messages.append(mag(us, 0, field.tolist(), (11, -22, 33), motor.tolist()))
    return messages, raw


@WRITTEN
def test_what_the_autopilot_put_in_is_taken_off_on_request(tmp_path: Path, write: object) -> None:
    messages, raw = compensated(COMPASS | INERTIAL)
    path = tmp_path / "flight"
    path.write_bytes(write(messages))  # type: ignore[operator]
    streams = open_log(path, choice=Choice(raw=True)).streams
    np.testing.assert_allclose(streams["mag"].array(MAG), raw, atol=1.5e-3)  # stored in whole milligauss
    np.testing.assert_allclose(streams["imu"].array(ACCEL)[0], [0.5, 0.1, -9.7], atol=1e-5)
    np.testing.assert_allclose(streams["imu"].array(GYRO)[0], [0.02, 0.01, 0.03], atol=1e-6)
    assert np.max(np.abs(open_log(path).streams["mag"].array(MAG) - raw)) > 0.1


def test_the_parameters_are_those_of_the_compass_with_these_offsets(tmp_path: Path) -> None:
    """The first in the messages is the second in the parameters, as `COMPASS_PRIO1_ID` may say."""
    swapped = {
        name.replace("_X", "!X").replace("_Y", "!Y").replace("_Z", "!Z"): value for name, value in COMPASS.items()
    }
    second = {
        name.replace("!", "2_") if "!" in name else f"{name}2": value
        for name, value in swapped.items() if "2!" not in name
    }  # fmt: skip
    messages, raw = compensated(second | INERTIAL | dict.fromkeys(
        ("COMPASS_OFS_X", "COMPASS_OFS_Y", "COMPASS_OFS_Z"), 0.0))  # fmt: skip
    path = tmp_path / "flight"
    path.write_bytes(binary(messages))
    np.testing.assert_allclose(open_log(path, choice=Choice(raw=True)).streams["mag"].array(MAG), raw, atol=1.5e-3)


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        (COMPASS, "no parameters INS_ACCOFFS and INS_GYROFFS"),
        (COMPASS | INERTIAL | {"AHRS_ORIENTATION": 6.0}, "a board that is mounted turned"),
        (INERTIAL | COMPASS | {"COMPASS_DIA_Y": 0.0, "COMPASS_ODI_X": 0.0, "COMPASS_ODI_Z": 0.0}, "cannot be undone"),
    ],
)  # fmt: skip
def test_what_cannot_be_taken_off_is_an_error(tmp_path: Path, parameters: dict[str, float], expected: str) -> None:
    path = tmp_path / "flight"
    path.write_bytes(binary(compensated(parameters)[0]))
    with pytest.raises(InputError, match=expected):
        open_log(path, choice=Choice(raw=True))


# --- damage ------------------------------------------------------------------------------------------------


def test_damaged_bytes_cost_the_messages_that_they_lie_in(tmp_path: Path) -> None:
    good = binary(flight())
    path = tmp_path / "flight"
    at = good.index(b"\xa3\x95", len(good) // 2)
    path.write_bytes(good[:at] + b"\x00\xa3\x95\x85\xff" * 3 + good[at:])
    recording = open_log(path)
    assert len(recording.streams["imu"]) == 50
    assert recording.notes[0] == "15 bytes that are no message: not read, at 1 place"
    path.write_bytes(good[:-7])
    assert "bytes that are no message" in open_log(path).notes[0]


def test_a_text_log_that_is_cut_off_is_read_up_to_there(tmp_path: Path) -> None:
    path = tmp_path / "flight"
    path.write_bytes(text(flight())[:-30])
    recording = open_log(path)
    assert len(recording.streams["imu"]) == 50
    assert "1 lines with another number of fields than their FMT line says: not read" in recording.notes


@pytest.mark.parametrize(
    ("messages", "expected"),
    [
        ([], "no message but those that name columns; expected a log with data"),
        ([("BAT", (5, 0, 1.0, 1.0, 1.0, 1.0, 1.0, 1, 1.0))], r"no accelerometer with a gyroscope \(there are BAT"),
    ],
)
def test_a_log_without_an_imu(tmp_path: Path, messages: list[Message], expected: str) -> None:
    path = tmp_path / "flight"
    path.write_bytes(binary(messages, units=False))
    with pytest.raises(InputError, match=expected):
        open_log(path)


@pytest.mark.measured
def test_a_measured_log_of_2013_says_what_it_lacks(measured_data: Path) -> None:
    with pytest.raises(InputError, match=r"no accelerometer with a gyroscope \(there are .*ATT.*CURR"):
        open_log(measured_data / "arducopter_sonar_baro" / "underpowered.log")
    log = read_messages(measured_data / "arducopter_sonar_baro" / "underpowered.log")
    assert log.counts["CTUN"] == 4302
    facts = facts_of(log.path)
    assert facts is not None
    assert (facts.firmware, len(facts.parameters)) == ("ArduCopter V3.0.1", 271)


TRIM = np.array([0.02, 0.0604, 0.0])


def through_both_attitudes() -> np.ndarray:
    """(n, 3) roll, pitch, yaw of a board that is level, climbs, banks and flies inverted."""
    return np.radians([[0.0, 0.0, 30.0], [0.0, 40.0, 100.0], [-60.0, 5.0, 200.0], [178.0, -10.0, 300.0]])


def vehicle_of(rpy: np.ndarray, kind: str) -> np.ndarray:
    """(n, 3) what ArduPilot logs of a board's attitude [deg]: an EKF its angles less the trim, DCM those of C_nb C'."""
    if kind != "AHR2":
        return np.degrees(rpy - TRIM)
    C = Rotation.from_euler("ZYX", rpy[:, ::-1]) * Rotation.from_euler("ZYX", TRIM[::-1]).inv()
    return np.asarray(C.as_euler("ZYX", degrees=True)[:, ::-1])


@pytest.mark.parametrize("kind", ["XKF1", "AHR2"])
def test_the_reference_is_the_attitude_of_the_board_that_reads(tmp_path: Path, kind: str) -> None:
    """A board that lies at the attitude of the reference reads gravity and field along it, in every attitude."""
    rpy = through_both_attitudes()
    kinds = KINDS | {"AHR2": ("Qfff", "TimeUS,Roll,Pitch,Yaw", "sddh", "F000")}
    trim = zip("XYZ", TRIM.tolist(), strict=True)
    messages: list[Message] = [("PARM", (1, f"AHRS_TRIM_{axis}", value, 0.0)) for axis, value in trim]
    for k, logged in enumerate(vehicle_of(rpy, kind)):
        us = 10_000_000 + 20_000 * k
        C = Rotation.from_euler("ZYX", rpy[k, ::-1])
        force = C.inv().apply([0.0, 0.0, -GRAVITY])
        messages.append(("IMU", (us, 0, 0.0, 0.0, 0.0, *force, 0, 0, 41.5, 1, 1, 1000, 1000)))
        centi = [round(100 * angle) for angle in logged]
        centi[2] %= 36_000
        messages.append(
            ("XKF1", (us, 0, *centi, *[0.0] * 7, 0, 0, 0, 0)) if kind == "XKF1" else ("AHR2", (us, *logged))
        )
    path = tmp_path / "a.bin"
    path.write_bytes(binary(messages, kinds=kinds))
    recording = open_log(path)
    assert recording.truth is not None
    q = recording.truth.stream.array(("qw", "qx", "qy", "qz"))
    down = Rotation.from_quat(q[:, [1, 2, 3, 0]]).inv().apply([0.0, 0.0, -GRAVITY])
    np.testing.assert_allclose(down, recording.streams["imu"].array(ACCEL), atol=GRAVITY * np.radians(0.01))
    assert any("without AHRS_TRIM (1.15, 3.46 deg" in note for note in recording.notes)
