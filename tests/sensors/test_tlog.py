"""MAVLink telemetry logs as pymavlink writes them, against what it reads, and against units by hand."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sinan.sensors.errors import InputError
from sinan.sensors.formats import facts_of, open_log
from sinan.sensors.formats.choice import Choice
from sinan.sensors.formats.columns import content_of
from sinan.sensors.formats.mavlink_frames import read_telemetry
from sinan.sensors.formats.tlog import _one_boot
from sinan.sensors.recording import ACCEL, GYRO, MAG
from sinan.sensors.rotation import rpy_from_quaternion

mavlink = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")
START = 1_700_000_000_000_000
GRAVITY = 9.80665
Sent = tuple[float, str, dict[str, Any]]


def message(name: str, **values: Any) -> Any:
    """A message with what is not given zero."""
    kind = getattr(mavlink, f"MAVLink_{name.lower()}_message")
    given = []
    for field, base in zip(kind.fieldnames, kind.fieldtypes, strict=True):
        wire = kind.ordered_fieldnames.index(field)
        count = kind.array_lengths[wire]
        empty: Any = b"" if base == "char" else [0] * count if count else 0
        given.append(values.get(field, empty))
    return kind(*given)


def written(sent: Sequence[Sent], system: int = 1, first_version: bool = False, delay: float = 0.03) -> bytes:
    """A log: what was sent when on the vehicle's clock [s], received `delay` and up to 20 ms later."""
    link = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
    parts = []
    for k, (t, name, values) in enumerate(sent):
        link.seq = k % 256
        data = message(name, **values).pack(link, force_mavlink1=first_version)
        parts.append(struct.pack(">Q", START + round(1e6 * (t + delay + 0.001 * (k % 20)))) + bytes(data))
    return b"".join(parts)


def raw_imu(t: float, az: int = -1000, **more: Any) -> Sent:
    fields = {"time_usec": round(1e6 * t), "zacc": az, "xgyro": 100, "xmag": 210, "ymag": -30, "zmag": 420}
    return t, "RAW_IMU", fields | {"temperature": 4150} | more


def flight() -> list[Sent]:
    """Four seconds of a copter at rest that says all that is read; the vehicle was switched on 10 s before."""
    sent: list[Sent] = [
        (10.0, "HEARTBEAT", {"autopilot": 3, "mavlink_version": 3}),
        (10.0, "STATUSTEXT", {"severity": 6, "text": b"ArduCopter V4.5.7 (2a3dc4b7)"}),
        *((10.0, "PARAM_VALUE", {"param_id": name.encode(), "param_value": value, "param_type": 9}) for name, value in
          {"SERVO1_FUNCTION": 33.0, "SERVO3_FUNCTION": 34.0, "MOT_PWM_MIN": 1100.0, "MOT_PWM_MAX": 1900.0}.items()),
    ]  # fmt: skip
    for k in range(40):
        t = 10.0 + 0.1 * k
        ms = round(1000 * t)
        sent += [
            raw_imu(t),
            (t, "SCALED_IMU2", {"time_boot_ms": ms, "zacc": -990, "xmag": 300, "ymag": 0, "zmag": 100}),
            (t, "ATTITUDE", {"time_boot_ms": ms, "roll": 0.1, "pitch": -0.2, "yaw": 1.5}),
        ]
        if k % 2 == 0:
            sent += [
                (t, "SCALED_PRESSURE", {"time_boot_ms": ms, "press_abs": 950.0, "temperature": 2350}),
                (t, "BATTERY_STATUS", {"voltages": [4000, 4100, *[65535] * 8], "current_battery": 1250}),
                (t, "BATTERY_STATUS", {"id": 1, "voltages": [15000, *[65535] * 9], "current_battery": 350}),
                (t, "DISTANCE_SENSOR", {"time_boot_ms": ms, "min_distance": 20, "max_distance": 700,
                                        "current_distance": 137, "type": 0, "orientation": 25}),
                (t, "SERVO_OUTPUT_RAW", {"time_usec": round(1e6 * t), "servo1_raw": 1500, "servo3_raw": 1100}),
                (t, "GPS_RAW_INT", {"time_usec": round(1e6 * t), "fix_type": 3 if k else 1, "lat": 473_977_000,
                                    "lon": 85_456_000, "alt": 488_000, "eph": 75, "epv": 120, "vel": 65535,
                                    "cog": 65535, "satellites_visible": 14, "h_acc": 900, "v_acc": 1500,
                                    "vel_acc": 300}),
            ]  # fmt: skip
    return sent


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "flight"
    path.write_bytes(written(flight()))
    return path


@pytest.mark.parametrize("first_version", [False, True])
def test_every_number_is_as_pymavlink_reads_it(tmp_path: Path, first_version: bool) -> None:
    from pymavlink import mavutil

    path = tmp_path / "a.tlog"
    path.write_bytes(written(flight(), first_version=first_version))
    ours, seen = read_telemetry(path), dict.fromkeys(read_telemetry(path).counts, 0)
    theirs = mavutil.mavlogfile(str(path))
    while (one := theirs.recv_msg()) is not None:
        name = one.get_type()
        k = seen[name]
        assert ours.arrived(name)[k] == pytest.approx(one._timestamp, abs=1e-6)
        for field in one.get_fieldnames():
            value = getattr(one, field)
            if isinstance(value, str):
                assert ours.texts(name, field)[k] == value
            else:
                np.testing.assert_array_equal(ours.numbers(name, field)[k], value)
        seen[name] += 1
    theirs.close()
    assert seen == ours.counts


def test_a_log_is_told_by_its_content_and_read_in_si_units(log: Path) -> None:
    assert content_of(log) == "tlog"
    recording = open_log(log)
    streams = recording.streams
    assert set(streams) == {"imu", "mag", "baro", "gps", "laser", "power", "motors"}
    np.testing.assert_allclose(streams["imu"].t, 0.1 * np.arange(40), atol=2e-6)
    np.testing.assert_allclose(streams["imu"].array(ACCEL)[0], [0.0, 0.0, -GRAVITY])
    np.testing.assert_allclose(streams["imu"].array(GYRO)[0], [0.1, 0.0, 0.0])
    assert streams["imu"]["temperature"][0] == pytest.approx(41.5)
    np.testing.assert_allclose(streams["mag"].array(MAG)[0], [0.21, -0.03, 0.42])  # gauss
    baro = {name: values[0] for name, values in streams["baro"].columns.items()}
    assert baro == pytest.approx({"pressure": 95_000.0, "temperature": 23.5})
    gps = streams["gps"]
    assert len(gps) == 19
    said = gps.array(("eph", "epv", "s_variance", "hdop", "vdop", "satellites"))[0]
    np.testing.assert_allclose(said, [0.9, 1.5, 0.3, 0.75, 1.2, 14.0])
    assert recording.origin == pytest.approx((47.3977, 8.5456, 488.0))
    assert streams["laser"]["range"][0] == pytest.approx(1.37)
    power = {name: values[0] for name, values in streams["power"].columns.items()}
    assert power == pytest.approx({"current": 12.5, "voltage": 8.1, "current_2": 3.5, "voltage_2": 15.0})
    np.testing.assert_allclose(streams["motors"].array(("motor_1", "motor_2"))[0], [0.5, 0.0])
    assert recording.truth is not None
    rpy = rpy_from_quaternion(recording.truth.stream.array(("qw", "qx", "qy", "qz")))
    np.testing.assert_allclose(rpy[0], [0.1, -0.2, 1.5], atol=1e-6)


def test_what_has_no_clock_is_stamped_by_its_arrival_less_the_least_delay(log: Path) -> None:
    """The battery's readings come a few messages behind the IMU's, each of which comes 1 ms after the one before."""
    late = open_log(log).streams["power"].t - 0.2 * np.arange(20)
    assert np.all((late >= -1e-6) & (late < 0.021))


def test_the_sensor_that_is_asked_for(log: Path) -> None:
    streams = open_log(log, choice=Choice(imu=1, mag=1)).streams
    assert streams["imu"]["accel_z"][0] == pytest.approx(-0.99 * GRAVITY)
    assert streams["mag"]["mag_x"][0] == pytest.approx(0.3)


@pytest.mark.parametrize("sensor", ["imu", "mag", "baro", "gps"])
def test_a_sensor_that_is_not_there(log: Path, sensor: str) -> None:
    with pytest.raises(InputError, match=f"--{sensor}: no {sensor} number 3; expected one of 0"):
        open_log(log, choice=Choice(**{sensor: 3}))


def test_px4_sends_a_finer_message_and_parameters_byte_by_byte(tmp_path: Path) -> None:
    whole = struct.unpack("<f", struct.pack("<i", 4001))[0]
    sent: list[Sent] = [
        (1.0, "HEARTBEAT", {"autopilot": 12}),
        (1.0, "PARAM_VALUE", {"param_id": b"SYS_AUTOSTART", "param_value": whole, "param_type": 6}),
        (1.0, "PARAM_VALUE", {"param_id": b"CAL_MAG0_XOFF", "param_value": 0.25, "param_type": 9}),
    ]
    for k in range(60):
        t = 1.0 + 0.02 * k
        new = 0x3F | (0x1C0 if k % 5 == 0 else 0) | (0xA00 if k % 10 == 0 else 0)
        fields = {"time_usec": round(1e6 * t), "zacc": -9.81, "zgyro": 0.25, "xmag": 0.2 + k // 5,
                  "abs_pressure": 950.0, "fields_updated": new}  # fmt: skip
        sent.append((t, "HIGHRES_IMU", fields))
    path = tmp_path / "a.tlog"
    path.write_bytes(written(sent))
    streams = open_log(path).streams
    assert streams["imu"]["accel_z"][0] == pytest.approx(-9.81)
    assert streams["imu"]["gyro_z"][0] == pytest.approx(0.25)
    np.testing.assert_allclose(streams["mag"]["mag_x"], 0.2 + np.arange(12), rtol=1e-6)
    np.testing.assert_allclose(streams["baro"]["pressure"], np.full(6, 95_000.0))
    facts = facts_of(path)
    assert facts is not None
    assert facts.parameters == {"SYS_AUTOSTART": 4001.0, "CAL_MAG0_XOFF": 0.25}
    assert (facts.autopilot, facts.firmware) == ("PX4", "PX4")


def test_what_a_log_says_of_itself(log: Path) -> None:
    facts = facts_of(log)
    assert facts is not None
    assert facts.firmware == "ArduCopter V4.5.7 (2a3dc4b7)"
    assert facts.parameters["MOT_PWM_MAX"] == 1900.0
    assert facts.instances == {"imu": 2, "mag": 2, "baro": 1, "gps": 1}
    assert {table.name: table.rows for table in facts.tables}["RAW_IMU"] == 40


@pytest.mark.parametrize("said", [{"autopilot": 3}, {"autopilot": 8}], ids=["by its heart", "by its texts"])
def test_whose_autopilot_it_is(tmp_path: Path, said: dict[str, Any]) -> None:
    """ArduPilot before 2016 called itself APM, and told the middleware of its board, which is PX4's."""
    texts = (b"APM:Copter V3.4-dev (bdddfae5)", b"PX4: b0cb142b NuttX: d447403a")
    sent: list[Sent] = [
        (1.0, "HEARTBEAT", said),
        *((1.0, "STATUSTEXT", {"severity": 3, "text": text}) for text in reversed(texts)),
        (1.0, "PARAM_VALUE", {"param_id": b"SERVO1_FUNCTION", "param_value": 33.0, "param_type": 4}),
        *(raw_imu(1.0 + 0.1 * k) for k in range(40)),
    ]
    path = tmp_path / "a.tlog"
    path.write_bytes(written(sent))
    facts = facts_of(path)
    assert facts is not None
    assert (facts.autopilot, facts.firmware) == ("ArduPilot", texts[0].decode())
    assert facts.parameters == {"SERVO1_FUNCTION": 33.0}


def test_the_vehicle_that_sends_most_is_read(tmp_path: Path) -> None:
    other = written([raw_imu(10.0 + 0.1 * k, -500) for k in range(10)], system=7)
    station = written([(10.0 + 0.001 * k, "HEARTBEAT", {}) for k in range(900)], system=255)
    path = tmp_path / "a.tlog"
    path.write_bytes(station + other + written(flight()))
    recording = open_log(path)
    assert len(recording.streams["imu"]) == 40
    assert "system 1 is read, not 7" in recording.notes


def test_damage_costs_the_frames_that_it_hits(tmp_path: Path) -> None:
    good = written([raw_imu(10.0 + 0.1 * k) for k in range(40)])
    size = len(good) // 40
    cut = 5 * size
    for bad, note in (
        (good[: cut + 30] + b"\xff" + good[cut + 31 :], "1 messages with a wrong checksum: not read"),
        (good[:cut] + b"noise" + good[cut:], "5 bytes that are no frame: not read, at 1 places"),
        (good[:-7], f"{size - 7} bytes that are no frame: not read, at 1 places"),
    ):
        path = tmp_path / "a.tlog"
        path.write_bytes(bad)
        recording = open_log(path)
        assert len(recording.streams["imu"]) == (40 if "5 bytes" in note else 39)
        assert note in recording.notes


def test_what_is_missing_is_named(log: Path, without_library: Callable[[str], None]) -> None:
    without_library("pymavlink")
    with pytest.raises(InputError, match=r"pip install -e '\.\[mavlink\]'"):
        open_log(log)


def test_a_telemetry_log_does_not_hold_what_was_corrected(log: Path) -> None:
    with pytest.raises(InputError, match="does not hold what was corrected"):
        open_log(log, choice=Choice(raw=True))


#: Length of each start of the autopilot, and from one to the next on the ground station's clock [s].
LENGTHS, PAUSES = (20.0, 60.0, 30.0), (35.0, 100.0)


def started_again(missed: float = 0.0) -> bytes:
    """Three starts in one log, of the last two without the first seconds; the current is the time since the start."""
    parts, since = [], 0.0
    for k, (length, pause) in enumerate(zip(LENGTHS, (*PAUSES, 0.0), strict=True)):
        first = missed if k else 0.0
        sent: list[Sent] = [(first, "HEARTBEAT", {"autopilot": 3})]
        sent.append((first, "PARAM_VALUE", {"param_id": b"MOT_PWM_MIN", "param_value": 1000.0 + k, "param_type": 9}))
        for m in range(1, round(5 * length)):
            t = first + 0.2 * m
            sent.append(raw_imu(t, az=-1000 - k))
            if m % 5 == 0:
                now = {"voltages": [16000, *[65535] * 9], "current_battery": round(100 * t)}
                sent.append((t, "BATTERY_STATUS", now))
        parts.append(written(sent, delay=0.03 + since))
        since += length + pause
    return b"".join(parts)


@pytest.mark.parametrize("missed", [0.0, 25.0, 200.0], ids=["whole", "late", "its clock never goes back"])
@pytest.mark.parametrize("boot", [0, 1, 2, 3])
def test_each_start_of_the_autopilot_is_a_recording(tmp_path: Path, missed: float, boot: int) -> None:
    """What has no clock of its own is on that of its own start; so the current says its own time."""
    path = tmp_path / "a.tlog"
    path.write_bytes(started_again(missed))
    recording = open_log(path, choice=Choice(boot=boot))
    k = boot - 1 if boot else 1
    imu, power = recording.streams["imu"], recording.streams["power"]
    assert len(imu) == round(5 * LENGTHS[k]) - 1
    np.testing.assert_allclose(imu["accel_z"], -(1.0 + 0.001 * k) * GRAVITY)
    assert recording.log_start is not None
    np.testing.assert_allclose(power.t + recording.log_start, power["current"], atol=0.03)
    lengths = "20, 60, 30 s" if not boot else ""
    assert any(f"started 3 times ({lengths}" in note for note in recording.notes)


def test_the_parameters_of_a_start_are_those_told_by_its_end(tmp_path: Path) -> None:
    path = tmp_path / "a.tlog"
    path.write_bytes(started_again())
    for number in (1, 2, 3):
        _, parameters = _one_boot(read_telemetry(path), number, [])
        assert parameters == {"MOT_PWM_MIN": 999.0 + number}


def test_a_start_that_is_not_there(log: Path) -> None:
    with pytest.raises(InputError, match="--boot: no boot number 2; expected 1 to 1"):
        open_log(log, choice=Choice(boot=2))


def test_a_wrong_stamp_or_a_stalled_link_is_no_start(tmp_path: Path) -> None:
    sent = [raw_imu(10.0 + 0.1 * k) for k in range(200)]
    sent[50] = (sent[50][0], *raw_imu(3.0)[1:])
    stalled = written(sent[:100]) + written(sent[100:120], delay=45.0) + written(sent[120:], delay=0.03)
    path = tmp_path / "a.tlog"
    path.write_bytes(stalled)
    recording = open_log(path)
    assert len(recording.streams["imu"]) == 199
    assert not any("started" in note for note in recording.notes)
