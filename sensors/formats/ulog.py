"""PX4's ULog, which describes itself: read through pyulog (`pip install '.[ulog]'` in the clone)."""

from __future__ import annotations

import io
from collections.abc import Mapping
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np

from sensors.arrays import FloatArray
from sensors.errors import InputError
from sensors.recording import QUATERNION, Recording, Stream, Truth

MAGIC = b"ULog\x01\x12\x35"

#: magic, version, time stamp of the start
_HEADER_SIZE = 16
_MESSAGE_TYPES = b"BFIMPQALCRDOS"
_MICROSECOND = 1e-6
#: A quaternion whose norm is off one by more is none: PX4 logs zeros or NaN before its estimator has an attitude.
_UNIT = 0.01
#: `distance_sensor.type` and `.orientation` of PX4's message definition: 0 laser, 1 ultrasound; 25 looks down.
_LASER, _ULTRASOUND, _DOWNWARD = 0, 1, 25


def read_topics(path: Path) -> dict[str, FloatArray]:
    """All topics as columns `topic.field`; a further instance k of a topic is `topic#k.field`. Times are in us.

    Raises
    ------
    InputError : pyulog is not installed; the log is damaged or holds no data
    """
    _check_chain(path)
    try:
        from pyulog import ULog
    except ImportError:
        raise InputError(path, "a ULog", "pyulog to read it with: pip install '.[ulog]' in the clone") from None
    try:
        with redirect_stdout(io.StringIO()):  # it prints what it finds wrong; `file_corruption` says so too
            log = ULog(str(path), disable_str_exceptions=True)
    except Exception as error:  # pyulog raises whatever its parser meets in a damaged file
        raise InputError(path, f"{type(error).__name__}: {error}", "a whole ULog") from None
    if log.file_corruption:
        raise InputError(path, "damaged or cut-off messages", "a whole ULog")
    columns: dict[str, FloatArray] = {}
    for topic in log.data_list:
        name = topic.name if topic.multi_id == 0 else f"{topic.name}#{topic.multi_id}"
        columns.update({f"{name}.{field}": np.asarray(values, np.float64) for field, values in topic.data.items()})
    if not columns:
        raise InputError(path, "no topic", "a log with data")
    return columns


def _check_chain(path: Path) -> None:
    """Check that the messages follow one another to the end of the file, before pyulog searches in what is damaged.

    A message is its size (uint16, little endian), its type (a letter) and that many bytes. PX4 user guide, "ULog file
    format".
    """
    data = path.read_bytes()
    position = _HEADER_SIZE
    while position < len(data):
        size = int.from_bytes(data[position : position + 2], "little")
        place = f"byte {position}"
        if position + 3 + size > len(data):
            raise InputError(path, f"a message of {size} bytes that is cut off", "a whole ULog", place)
        if data[position + 2] not in _MESSAGE_TYPES:
            raise InputError(path, f"a message of type {data[position + 2 : position + 3]!r}", "a whole ULog", place)
        position += 3 + size


def read_ulog(path: Path) -> Recording:
    """A PX4 log as a recording: IMU, magnetometer, barometer, range, GPS, supply, motor speeds and air.

    Positions are in NED at the first fix with three dimensions; times begin with the log's first sample. Of what the
    vehicle's own estimator says the attitude is kept, as a reference.

    Raises
    ------
    InputError : no accelerometer and gyroscope; what `read_topics` and `Recording` find wrong
    """
    from sensors.formats.geodetic import to_ned
    from sensors.formats.plausible import check_units

    topics = read_topics(path)
    found = {
        "imu": _imu(topics), "mag": _mag(topics), "baro": _baro(topics), "laser": _range(topics, _LASER),
        "sonar": _range(topics, _ULTRASOUND), "gps": _gps(topics), "power": _power(topics), "motors": _motors(topics),
        "air": _columns(topics, "airspeed", {"airspeed": "true_airspeed_m_s"}),
    }  # fmt: skip
    streams = {name: stream for name, stream in found.items() if stream is not None and len(stream) > 0}
    if "imu" not in streams:
        names = ", ".join(sorted({name.split(".")[0] for name in topics}))
        raise InputError(path, f"no sensor_combined among the topics ({names})", "a log of accelerometer and gyroscope")
    start = min(float(stream.t[0]) for stream in streams.values())
    streams = {name: Stream(stream.t - start, stream.columns) for name, stream in streams.items()}
    streams, origin, notes = to_ned(path, streams, None)
    truth = _own_attitude(topics, start)
    recording = Recording(path.stem, "flight", streams, origin=origin, source=str(path), notes=notes, truth=truth)
    check_units(recording)
    return recording


def _own_attitude(topics: Mapping[str, FloatArray], start: float) -> Truth | None:
    """The attitude of the vehicle's own estimator, where it had one; `start` is t = 0 of the recording [s]."""
    names = {column: f"q[{k}]" for k, column in enumerate(QUATERNION)}
    stream = _columns(topics, "vehicle_attitude", names)
    if stream is None:
        return None
    stream = stream.rows(np.abs(np.linalg.norm(stream.array(QUATERNION), axis=1) - 1.0) < _UNIT)
    return Truth(Stream(stream.t - start, stream.columns), "autopilot", aligned=True) if len(stream) else None


def _columns(
    topics: Mapping[str, FloatArray], topic: str, names: Mapping[str, str], clock: str = "timestamp"
) -> Stream | None:
    """Some fields of a topic as a stream; None where one is missing. A repeated time stamp counts once."""
    wanted = [f"{topic}.{field}" for field in (clock, *names.values())]
    if any(name not in topics for name in wanted):
        return None
    t = topics[wanted[0]] * _MICROSECOND
    first = np.concatenate([[True], np.diff(t) > 0.0]) if len(t) else np.empty(0, dtype=bool)
    return Stream(t[first], {name: topics[f"{topic}.{field}"][first] for name, field in names.items()})


def _imu(topics: Mapping[str, FloatArray]) -> Stream | None:
    names = {f"accel_{axis}": f"accelerometer_m_s2[{k}]" for k, axis in enumerate("xyz")}
    names |= {f"gyro_{axis}": f"gyro_rad[{k}]" for k, axis in enumerate("xyz")}
    return _columns(topics, "sensor_combined", names)


def _mag(topics: Mapping[str, FloatArray]) -> Stream | None:
    names = {f"mag_{axis}": f"magnetometer_ga[{k}]" for k, axis in enumerate("xyz")}
    return _columns(topics, "vehicle_magnetometer", names)


def _baro(topics: Mapping[str, FloatArray]) -> Stream | None:
    names = {"height": "baro_alt_meter", "pressure": "baro_pressure_pa", "temperature": "baro_temp_celcius"}
    return _columns(topics, "vehicle_air_data", names)


def _range(topics: Mapping[str, FloatArray], kind: int) -> Stream | None:
    """Downward ranges of one kind of sensor within its own limits: beyond them there was no echo."""
    names = {
        "range": "current_distance",
        "low": "min_distance",
        "high": "max_distance",
        "kind": "type",
        "facing": "orientation",
    }
    stream = _columns(topics, "distance_sensor", names)
    if stream is None:
        return None
    inside = (stream["range"] > stream["low"]) & (stream["range"] < stream["high"])
    keep = (stream["kind"] == kind) & (stream["facing"] == _DOWNWARD) & inside
    return Stream(stream.t[keep], {"range": stream["range"][keep]})


def _gps(topics: Mapping[str, FloatArray]) -> Stream | None:
    """Fixes in three dimensions: geodetic, with velocity. Older logs have integers of 1e-7 deg and mm, newer floats."""
    topic = next((name for name in ("vehicle_gps_position", "sensor_gps") if f"{name}.timestamp" in topics), "")
    old = f"{topic}.lat" in topics
    fields = ("lat", "lon", "alt_ellipsoid") if old else ("latitude_deg", "longitude_deg", "altitude_ellipsoid_m")
    names = dict(zip(("latitude", "longitude", "height"), fields, strict=True))
    names |= {f"vel_{axis}": f"vel_{axis[0]}_m_s" for axis in ("north", "east", "down")} | {"fix": "fix_type"}
    stream = _columns(topics, topic, names)
    if stream is None:
        return None
    good = stream["fix"] >= 3
    units = (1e-7, 1e-7, 1e-3) if old else (1.0, 1.0, 1.0)
    columns = {name: values[good] for name, values in stream.columns.items() if name != "fix"}
    for name, unit in zip(("latitude", "longitude", "height"), units, strict=True):
        columns[name] = columns[name] * unit
    return Stream(stream.t[good], columns)


def _power(topics: Mapping[str, FloatArray]) -> Stream | None:
    return _columns(topics, "battery_status", {"current": "current_a", "voltage": "voltage_v"})


def _motors(topics: Mapping[str, FloatArray]) -> Stream | None:
    """Motor speeds over the largest of the log: 0 to 1, proportional to the speed."""
    count = topics.get("esc_status.esc_count")
    if count is None or len(count) == 0 or not 1 <= count[0] <= 16:
        return None
    names = {f"motor_{k + 1}": f"esc[{k}].esc_rpm" for k in range(int(count[0]))}
    stream = _columns(topics, "esc_status", names)
    if stream is None or len(stream) == 0:
        return None
    top = max(1.0, max(float(np.max(np.abs(values))) for values in stream.columns.values()))
    return Stream(stream.t, {name: np.abs(values) / top for name, values in stream.columns.items()})
