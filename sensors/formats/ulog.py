"""PX4's ULog, which describes itself: topics as the streams of a recording."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sensors.arrays import BoolArray, FloatArray
from sensors.errors import InputError
from sensors.formats.ulog_messages import read_topics
from sensors.formats.units import FIELD_UNIT
from sensors.recording import QUATERNION, REQUIRED_COLUMNS, Environment, Recording, SensorSpec, Stream, Truth

_MICROSECOND = 1e-6
#: A quaternion whose norm is off one by more is none: PX4 logs zeros or NaN before its estimator has an attitude.
_UNIT = 0.01
#: What PX4 calls the columns of `sensors.recording.FIX_QUALITY`.
_FIX_QUALITY = {
    "eph": "eph", "epv": "epv", "s_variance": "s_variance_m_s", "hdop": "hdop", "vdop": "vdop",
    "satellites": "satellites_used",
}  # fmt: skip
#: Samples are averages where they are taken over at least this part of the step to the next.
_FILLED = 0.5
#: `distance_sensor.type` and `.orientation` of PX4's message definition: 0 laser, 1 ultrasound; 25 looks down.
_LASER, _ULTRASOUND, _DOWNWARD = 0, 1, 25


def read_ulog(path: Path) -> Recording:
    """A PX4 log as a recording: IMU, magnetometer, barometer, range, GPS, supply, motor speeds and air.

    Positions are in NED at the first fix with three dimensions; times begin with the log's first sample, and are those
    at which samples were taken, where the log says it. Of what the
    vehicle's own estimator says the attitude is kept, as a reference. Of a damaged log `notes` say what could not be
    read, and how many rows were left out because their time goes back or they hold what is no number.

    Raises
    ------
    InputError : no accelerometer and gyroscope; what `read_topics` and `Recording` find wrong
    """
    from sensors.formats.geodetic import to_ned
    from sensors.formats.plausible import check_units

    topics = read_topics(path)
    streams, notes = _streams(topics)
    if "imu" not in streams:
        names = ", ".join(sorted({name.split(".")[0] for name in topics}))
        raise InputError(path, f"no sensor_combined among the topics ({names})", "a log of accelerometer and gyroscope")
    start = _start(streams)
    streams = {name: Stream(stream.t - start, stream.columns) for name, stream in streams.items()}
    streams, origin, chosen = to_ned(path, streams, None)
    recording = Recording(
        path.stem, "flight", streams, sensors=_declared(topics), environment=Environment(field_unit=FIELD_UNIT),
        origin=origin, source=str(path), notes=(*topics.notes, *notes, *chosen), truth=_own_attitude(topics, start),
    )  # fmt: skip
    check_units(recording)
    return recording


def _declared(topics: Mapping[str, FloatArray]) -> dict[str, SensorSpec]:
    """What the log says of its IMU: samples that fill their steps are averages over them."""
    taken, over = (topics.get(f"sensor_combined.{field}") for field in ("timestamp", "accelerometer_integral_dt"))
    if taken is None or over is None or len(taken) < 2:
        return {}
    filled = np.median(over) > _FILLED * np.median(np.diff(taken))
    return {"accel": SensorSpec(imu_samples="average")} if filled else {}


def _streams(topics: Mapping[str, FloatArray]) -> tuple[dict[str, Stream], list[str]]:
    """The streams of the topics that are there, on the log's clock, and what was left out of them."""
    found = {
        "imu": _imu(topics), "mag": _mag(topics), "baro": _baro(topics), "laser": _range(topics, _LASER),
        "sonar": _range(topics, _ULTRASOUND), "gps": _gps(topics), "power": _power(topics), "motors": _motors(topics),
        "air": _columns(topics, "airspeed", {"airspeed": "true_airspeed_m_s"}),
    }  # fmt: skip
    sound = {name: _sound(name, stream) for name, stream in found.items() if stream is not None}
    notes = [note for _, said in sound.values() for note in said]
    return {name: stream for name, (stream, _) in sound.items() if len(stream) > 0}, notes


def _start(streams: Mapping[str, Stream]) -> float:
    """When the recording begins, on the log's clock [s]."""
    return min(float(stream.t[0]) for stream in streams.values())


def _sound(name: str, stream: Stream) -> tuple[Stream, list[str]]:
    """A stream without what damage, or a driver that knows no value, has put into it; and sentences that say so.

    Left out are columns that may be missing and hold no number at all, rows that hold a gap, and the fewest rows
    without which the time rises.
    """
    notes: list[str] = []
    required = {column for columns in REQUIRED_COLUMNS.get(name, ()) for column in columns}
    finite = {column: np.isfinite(values) for column, values in stream.columns.items()}
    empty = [column for column, good in finite.items() if not np.any(good) and column not in required]
    if empty and len(stream):
        notes.append(f"{name}: no number in it, left out: {', '.join(empty)}")
    columns = {column: values for column, values in stream.columns.items() if column not in empty}
    keep = np.all([finite[column] for column in columns], axis=0) if columns else np.zeros(len(stream), dtype=bool)
    stream, lost = Stream(stream.t, columns).rows(keep), int(np.sum(~keep))
    if lost:
        notes.append(f"{name}: {lost} rows left out: not a number")
    rising = _rising(stream.t)
    if lost := int(np.sum(~rising)):
        notes.append(f"{name}: {lost} rows left out: the time goes back")
    return stream.rows(rising), notes


def _rising(t: FloatArray) -> BoolArray:
    """(n,) the longest choice of rows whose time rises, by patience sorting: one wrong stamp costs one row."""
    if np.all(np.diff(t) > 0.0):
        return np.ones(len(t), dtype=bool)
    tops: list[float] = []
    rows: list[int] = []
    before = np.full(len(t), -1, dtype=np.int64)
    for k, value in enumerate(t.tolist()):
        pile = bisect_left(tops, value)
        before[k] = rows[pile - 1] if pile else -1
        tops[pile : pile + 1], rows[pile : pile + 1] = [value], [k]
    keep = np.zeros(len(t), dtype=bool)
    k = rows[-1] if rows else -1
    while k >= 0:
        keep[k] = True
        k = int(before[k])
    return keep


def _own_attitude(topics: Mapping[str, FloatArray], start: float) -> Truth | None:
    """The attitude of the vehicle's own estimator, where it had one; `start` is t = 0 of the recording [s]."""
    names = {column: f"q[{k}]" for k, column in enumerate(QUATERNION)}
    stream = _columns(topics, "vehicle_attitude", names)
    if stream is None:
        return None
    stream, _ = _sound("reference", stream)
    if not stream.has(QUATERNION):
        return None
    stream = stream.rows(np.abs(np.linalg.norm(stream.array(QUATERNION), axis=1) - 1.0) < _UNIT)
    return Truth(Stream(stream.t - start, stream.columns), "autopilot", aligned=True) if len(stream) else None


def _columns(topics: Mapping[str, FloatArray], topic: str, names: Mapping[str, str]) -> Stream | None:
    """Some fields of a topic as a stream; None where one is missing. A repeated time stamp counts once."""
    wanted = [f"{topic}.{field}" for field in ("timestamp", *names.values())]
    if any(name not in topics for name in wanted):
        return None
    t = _taken(topics, topic) * _MICROSECOND
    first = np.concatenate([[True], np.diff(t) != 0.0]) if len(t) else np.empty(0, dtype=bool)
    return Stream(t[first], {name: topics[f"{topic}.{field}"][first] for name, field in names.items()})


def _taken(topics: Mapping[str, FloatArray], topic: str) -> FloatArray:
    """(n,) when the samples of a topic were taken [us]; when they were published, where the log does not say that."""
    published = topics[f"{topic}.timestamp"]
    taken = topics.get(f"{topic}.timestamp_sample", published)
    return taken if np.all(taken > 0.0) else published


def _imu(topics: Mapping[str, FloatArray]) -> Stream | None:
    names = {f"accel_{axis}": f"accelerometer_m_s2[{k}]" for k, axis in enumerate("xyz")}
    names |= {f"gyro_{axis}": f"gyro_rad[{k}]" for k, axis in enumerate("xyz")}
    return _columns(topics, "sensor_combined", names)


def _mag(topics: Mapping[str, FloatArray]) -> Stream | None:
    names = {f"mag_{axis}": f"magnetometer_ga[{k}]" for k, axis in enumerate("xyz")}
    return _columns(topics, "vehicle_magnetometer", names)


def _baro(topics: Mapping[str, FloatArray]) -> Stream | None:
    names = {"height": "baro_alt_meter", "pressure": "baro_pressure_pa"}
    if "vehicle_air_data.baro_temp_celcius" in topics:  # newer logs have the air's in its place
        names["temperature"] = "baro_temp_celcius"
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
    names |= {
        name: field for name, field in _FIX_QUALITY.items()
        if f"{topic}.{field}" in topics and np.all(np.isfinite(topics[f"{topic}.{field}"]))
    }  # fmt: skip
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
    top = max(1.0, *(float(np.nanmax(np.abs(values), initial=0.0)) for values in stream.columns.values()))
    return Stream(stream.t, {name: np.abs(values) / top for name, values in stream.columns.items()})
