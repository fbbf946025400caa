"""A flight with a hidden effect, as an autopilot's log and as a bag: from the file to the effect in one command."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
import pymap3d
import pytest
from typer.testing import CliRunner

from sinan.experiments.commands.cli import app
from sinan.sensors.recording import ACCEL, GEODETIC, GYRO, MAG, POSITION, VELOCITY, Recording
from sinan.sensors.simulate import simulate
from sinan.sensors.window import window
from tests.flights import scenario_at
from tests.sensors import test_ardupilot as ardupilot
from tests.sensors import test_rosbag as ros
from tests.sensors import test_ulog as px4

FIELD = 0.48  # gauss of the simulation's field of norm one
BETA = (0.003, 0.0, 0.001)  # of the field, per ampere
NONE: Mapping[str, float] = {}
START = 20.0  # the logger's clock at the first sample [s]


@cache
def flight() -> Recording:
    """A figure of eight, with a magnetometer that reads the supply's current, and an IMU of 50 Hz."""
    recording, _ = simulate(scenario_at(50.0, "figure_eight"), np.random.default_rng(0), {"mag.current": BETA})
    return window(recording, (0.0, 18.0))


def us(t: float) -> int:
    """As the logger's clock counts [us]."""
    return round(1e6 * (t + START))


def geodetic(recording: Recording) -> np.ndarray:
    """(n, 3) latitude, longitude [deg], height [m]."""
    assert recording.origin is not None
    return np.stack(pymap3d.ned2geodetic(*recording.streams["gps"].array(POSITION).T, *recording.origin), axis=-1)


def dataflash(path: Path, recording: Recording | None = None, parameters: Mapping[str, float] = NONE) -> Path:
    """As ArduPilot stores it: a field in whole milligauss, places in 1e-7 deg and cm, course and speed."""
    recording = recording or flight()
    streams = recording.streams
    rows: list[tuple[float, ardupilot.Message]] = [
        (-1.0, ("PARM", (us(0.0), name, value, 0.0))) for name, value in parameters.items()
    ]

    for t, force, rate in zip(streams["imu"].t, streams["imu"].array(ACCEL), streams["imu"].array(GYRO), strict=True):
        rows.append((t, ("IMU", (us(t), 0, *rate, *force, 0, 0, 40.0, 1, 1, 200, 200))))
    for t, field in zip(
        streams["mag"].t, np.round(1000.0 * FIELD * streams["mag"].array(MAG)).astype(int), strict=True
    ):
        rows.append((t, ardupilot.mag(us(t), field=field.tolist(), offset=(0, 0, 0), motor=(0, 0, 0))))
    heights = zip(streams["baro"].t, streams["baro"]["height"], strict=True) if "baro" in streams else ()
    for t, height in heights:
        rows.append((t, ("BARO", (us(t), 0, height, 95_000.0, 2000, 0.0, 0, 0.0, 20.0, 1))))
    for t, current, voltage in zip(
        streams["power"].t, streams["power"]["current"], streams["power"]["voltage"], strict=True
    ):
        rows.append((t, ("BAT", (us(t), 0, voltage, voltage, current, 0.0, 0.0, 2000, 0.0))))
    gps = streams["gps"]
    for t, lla, v in zip(gps.t, geodetic(recording), gps.array(VELOCITY), strict=True):
        where = round(1e7 * lla[0]), round(1e7 * lla[1]), round(100.0 * lla[2])
        course = np.degrees(np.arctan2(v[1], v[0])) % 360.0
        rows.append((t, ("GPS", (us(t), 0, 3, 0, 2300, 15, 80, *where, np.hypot(v[0], v[1]), course, v[2], 0.0, 1))))
    path.write_bytes(ardupilot.binary([row for _, row in sorted(rows, key=lambda one: one[0])]))
    return path


def bag(path: Path) -> Path:
    """As ROS has it: body forward-left-up, world east-north-up, tesla; a current that is negative."""
    streams = flight().streams
    messages: list[ros.Message] = []
    flu = np.array([1.0, -1.0, -1.0])
    for t, force, rate in zip(streams["imu"].t, streams["imu"].array(ACCEL), streams["imu"].array(GYRO), strict=True):
        messages.append(ros.imu(t, tuple(force * flu), tuple(rate * flu), orientation_covariance=np.full(9, -1.0)))
    for t, field in zip(streams["mag"].t, streams["mag"].array(MAG) * flu, strict=True):
        messages.append(
            ("/mag", t, "sensor_msgs/msg/MagneticField", {"magnetic_field": ros.xyz(*(1e-4 * FIELD * field))})
        )
    for t, height in zip(streams["baro"].t, streams["baro"]["height"], strict=True):
        pressure = 101_325.0 * (1.0 - 0.0065 * height / 288.15) ** 5.25588  # the standard atmosphere
        messages.append(("/baro", t, "sensor_msgs/msg/FluidPressure", {"fluid_pressure": pressure}))
    for t, current, voltage in zip(
        streams["power"].t, streams["power"]["current"], streams["power"]["voltage"], strict=True
    ):
        messages.append(("/battery", t, "sensor_msgs/msg/BatteryState", {"current": -current, "voltage": voltage}))
    gps = streams["gps"]
    for t, lla, v in zip(gps.t, geodetic(flight()), gps.array(VELOCITY), strict=True):
        fix = dict(zip(GEODETIC, lla, strict=True))
        fix["altitude"] = fix.pop("height")
        messages.append(("/fix", t, "sensor_msgs/msg/NavSatFix", fix))
        messages.append(("/vel", t, "geometry_msgs/msg/TwistStamped",
                         {"frame": "map", "twist": {"linear": ros.xyz(v[1], v[0], -v[2])}}))  # fmt: skip
    return ros.Maker("mcap").write(path, sorted(messages, key=lambda one: one[1]))


def ulog(path: Path, recording: Recording | None = None, parameters: Mapping[str, float] = NONE) -> Path:
    """As PX4 1.14 stores it."""
    recording = recording or flight()
    streams = recording.streams
    topics = {
        "sensor_combined": ("imu", "float[3] gyro_rad;float[3] accelerometer_m_s2;", (*GYRO, *ACCEL)),
        "vehicle_magnetometer": ("mag", "float[3] magnetometer_ga;", MAG),
        "vehicle_air_data": ("baro", "float baro_alt_meter;float baro_pressure_pa;", ("height", "height")),
        "battery_status": ("power", "float current_a;float voltage_v;", ("current", "voltage")),
        "vehicle_gps_position": (
            "gps", "double latitude_deg;double longitude_deg;double altitude_ellipsoid_m;float vel_n_m_s;"
            "float vel_e_m_s;float vel_d_m_s;uint8_t fix_type;", VELOCITY),
    }  # fmt: skip
    parts, rows = [px4.HEAD[: px4.HEAD.index(b"F", 20) - 2]], []
    parts += [
        px4.message("P", bytes([6 + len(name)]) + f"float {name}".encode() + struct.pack("<f", value))
        for name, value in parameters.items()
    ]
    for number, (topic, (name, fields, columns)) in enumerate(topics.items(), 1):
        if name not in streams:
            continue
        parts.append(px4.message("F", f"{topic}:uint64_t timestamp;{fields}".encode()))
        parts.append(px4.message("A", b"\0" + struct.pack("<H", number) + topic.encode()))
        stream = streams[name]
        values = stream.array(columns) * (FIELD if name == "mag" else 1.0)
        if name == "baro":
            values[:, 1] = 95_000.0
        if name == "gps":
            lla = geodetic(recording)
        for k, t in enumerate(stream.t):
            body = struct.pack("<HQ", number, us(t))
            body += struct.pack("<3d", *lla[k]) if name == "gps" else b""
            body += struct.pack(f"<{len(columns)}f", *values[k]) + (b"\3" if name == "gps" else b"")
            rows.append((t, px4.message("D", body)))
    path.write_bytes(b"".join([*parts, *(row for _, row in sorted(rows, key=lambda one: one[0]))]))
    return path


@pytest.mark.parametrize("write", [dataflash, ulog, bag])
def test_from_a_file_to_the_effect_in_one_command(tmp_path: Path, write: object) -> None:
    log = write(tmp_path / "log")  # type: ignore[operator]
    out, page = tmp_path / "out.json", tmp_path / "page.html"
    result = CliRunner().invoke(app, ["trace", str(log), "--json", str(out), "--html", str(page)])
    assert result.exit_code == 0, result.output
    document = json.loads(out.read_text())
    assert document["verdict"] == "effects"
    (found,) = document["effects"]
    assert found["name"] == "mag.current"
    np.testing.assert_allclose(found["beta"], FIELD * np.array(BETA), atol=4.0 * np.max(found["std"]))
    assert "mag.current" in page.read_text()
