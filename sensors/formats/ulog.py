"""PX4's ULog, which describes itself, and the tables of one that ulog2csv makes: topics as streams of a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import FIRST, Choice, not_there
from sinan.sensors.formats.facts import Facts, Table
from sinan.sensors.formats.logged import PULSES, averaged, numbered, recording_of
from sinan.sensors.formats.ulog_messages import Topics
from sinan.sensors.formats.ulog_tables import TopicTables, log_name, topics_of
from sinan.sensors.recording import ACCEL, GEODETIC, GYRO, MAG, QUATERNION, VELOCITY, Recording, SensorSpec, Stream

Log = Topics | TopicTables
_MICROSECOND = 1e-6
#: What PX4 calls the columns of `sensors.recording.FIX_QUALITY`.
_FIX_QUALITY = {
    "eph": "eph", "epv": "epv", "s_variance": "s_variance_m_s", "hdop": "hdop", "vdop": "vdop",
    "satellites": "satellites_used",
}  # fmt: skip
#: `distance_sensor.type` and `.orientation` of PX4's message definition: 0 laser, 1 ultrasound; 25 looks down.
_LASER, _ULTRASOUND, _DOWNWARD = 0, 1, 25
_HECTOPASCAL = 100.0
#: Medians of a pressure on the ground or in the air lie below in hPa, above in Pa.
_PRESSURE_IN_PASCAL = 2000.0
#: Outputs of PX4 are pulse widths, which are longer than this [us] (the least that `PWM_MAIN_MINn` takes), or throttles
#: of DShot, 1 to 1999 (`DSHOT_MAX_THROTTLE`).
_SHORTEST_PULSE, _DSHOT = 800.0, (0.0, 1999.0)
_MOST_MOTORS = 16
#: Frames of `vehicle_visual_odometry`, as its field was called to 1.13 and is: north-east-down, and forward-right-down
#: of where it started.
_DOWNWARD_FRAMES = {"local_frame": (0, 1), "pose_frame": (1, 2)}
#: Further sensors of one kind are numbered, `topic#1` to `topic#15`.
_MOST_INSTANCES = 16


def _vector(names: Sequence[str], field: str, ends: Sequence[str] = ("[0]", "[1]", "[2]")) -> dict[str, str]:
    """The fields of three columns."""
    return {name: f"{field}{end}" for name, end in zip(names, ends, strict=True)}


#: What every firmware calls the columns of a stream: topic, and field by column; the first that is there is read. PX4
#: 1.4 to 1.7 had the magnetometer and the barometer in `sensor_combined`, 1.8 to 1.11 one of each, later ones more.
NAMES: dict[str, tuple[tuple[str, dict[str, str]], ...]] = {
    "imu": (
        ("sensor_combined", _vector(ACCEL, "accelerometer_m_s2") | _vector(GYRO, "gyro_rad")),
        ("vehicle_imu", _vector(ACCEL, "delta_velocity") | _vector(GYRO, "delta_angle")
         | {"over_v": "delta_velocity_dt", "over_a": "delta_angle_dt"}),
        ("sensor_gyro", _vector(GYRO, "", "xyz")),
        ("vehicle_angular_velocity", _vector(GYRO, "xyz")),
    ),
    "mag": (
        ("vehicle_magnetometer", _vector(MAG, "magnetometer_ga")),
        ("sensor_combined", _vector(MAG, "magnetometer_ga")),
        ("sensor_mag", _vector(MAG, "", "xyz")),
    ),
    "baro": (
        ("vehicle_air_data", {"height": "baro_alt_meter", "pressure": "baro_pressure_pa",
                              "temperature": "baro_temp_celcius"}),
        ("vehicle_air_data", {"height": "baro_alt_meter", "pressure": "baro_pressure_pa"}),
        ("sensor_combined", {"height": "baro_alt_meter"}),
        ("sensor_baro", {"pressure": "pressure", "temperature": "temperature"}),
    ),
    "gps": tuple(
        (topic, dict(zip(GEODETIC, fields, strict=True)) | _vector(VELOCITY, "vel_", ("n_m_s", "e_m_s", "d_m_s"))
         | {"fix": "fix_type"})
        for topic in ("vehicle_gps_position", "sensor_gps")
        for fields in (("lat", "lon", "alt_ellipsoid"), ("latitude_deg", "longitude_deg", "altitude_ellipsoid_m"))
    ),
    "air": (
        ("airspeed", {"airspeed": "true_airspeed_m_s"}),
        ("airspeed_validated", {"airspeed": "true_airspeed_m_s"}),
    ),
}  # fmt: skip
#: Where no topic has both: what has one of them, first what PX4 has corrected of the IMU that it selected.
_PARTS = (
    (("vehicle_angular_velocity", _vector(GYRO, "xyz")), ("sensor_gyro", _vector(GYRO, "", "xyz"))),
    (("vehicle_acceleration", _vector(ACCEL, "xyz")), ("sensor_accel", _vector(ACCEL, "", "xyz"))),
)
#: Of the readings before the autopilot's own correction.
_RAW = {"imu": "sensor_gyro", "mag": "sensor_mag"}


def read_ulog(path: Path, choice: Choice = FIRST) -> Recording:
    """A PX4 log or its tables as a recording: IMU, magnetometer, barometer, range, GPS, supply, motors and air.

    Positions are in NED at the first fix with three dimensions; times begin with the log's first sample, and are those
    at which samples were taken, where the log says it. Of what the
    vehicle's own estimator says the attitude is kept, as a reference. Of a damaged log `notes` say what could not be
    read, and how many rows were left out because their time goes back or they hold what is no number.

    Parameters
    ----------
    choice : which of several sensors; the first IMU is the one that PX4 has selected (`sensor_combined`); `raw` reads
        `sensor_mag`, `sensor_accel` and `sensor_gyro`, before PX4's correction

    Raises
    ------
    InputError : a sensor that is not there; no accelerometer and gyroscope; what `topics_of`, `Recording` find wrong
    """
    topics = topics_of(path)
    notes: list[str] = []
    imu, sensors = _imu(path, topics, choice, notes)
    streams = {"imu": imu, **_streams(path, topics, choice, notes)}
    there = sorted({name.split("#")[0] for name in topics.topics})
    attitude, kind = _attitude(topics)
    said = (*topics.notes, *notes)
    return recording_of(path, streams, attitude, sensors, said, there, kind).replace(name=log_name(path))


def ulog_facts(path: Path) -> Facts:
    """What a log says of itself."""
    topics = topics_of(path)
    tables = []
    for name in topics.topics:
        t = topics.get(f"{name}.timestamp", np.empty(0)) * _MICROSECOND
        span = (float(np.min(t)), float(np.max(t))) if len(t) else None
        fields = tuple(column.split(".", 1)[1] for column in topics if column.startswith(f"{name}."))
        tables.append(Table(name, topics.rows(name), span, fields))
    known = topics.said.information
    firmware = " ".join(known[key] for key in ("sys_name", "ver_sw_release", "ver_sw", "ver_hw") if key in known)
    several = {sensor: len(_instances(topics, sensor)) for sensor in ("imu", "mag", "baro", "gps")}
    kind = "PX4 ULog" if isinstance(topics, Topics) else "tables of a PX4 ULog, a topic a file"
    return Facts(kind, firmware, topics.said.parameters, tuple(tables), several, tuple(topics.said.texts),
                 str(known.get("sys_uuid", "")), "PX4")  # fmt: skip


def _streams(path: Path, topics: Log, choice: Choice, notes: list[str]) -> dict[str, Stream | None]:
    """The streams of the topics that are there but the IMU, on the log's clock."""
    return {
        "mag": _mag(path, topics, choice, notes), "baro": _baro(path, topics, choice.baro),
        "gps": _gps(path, topics, choice.gps),
        "laser": _range(topics, _LASER), "sonar": _range(topics, _ULTRASOUND), "power": _power(topics),
        "motors": _motors(topics), "air": _named(topics, "air", 0)[1],
    }  # fmt: skip


def _called(topic: str, number: int) -> str:
    return f"{topic}#{number}" if number else topic


def _named(topics: Log, sensor: str, number: int, raw: bool = False) -> tuple[str, Stream | None]:
    """The topic of one of several sensors, and its columns; empty and None: it is not there."""
    for topic, names in NAMES[sensor]:
        if raw and topic != _RAW.get(sensor, topic):
            continue
        stream = _columns(topics, _called(topic, number), names)
        if stream is not None and len(stream):
            return _called(topic, number), stream
    return "", None


def _instances(topics: Log, sensor: str) -> list[int]:
    """Which of several sensors there are."""
    return [k for k in range(_MOST_INSTANCES) if _named(topics, sensor, k)[1] is not None]


def _asked(path: Path, topics: Log, sensor: str, number: int, raw: bool = False) -> tuple[str, Stream | None]:
    """The same; an error where another than the first is asked for and is not there, or none without a correction."""
    topic, stream = _named(topics, sensor, number, raw)
    if stream is None and number:
        not_there(path, sensor, number, _instances(topics, sensor))
    if stream is None and raw and _named(topics, sensor, number)[1] is not None:
        raise InputError(path, f"no {_called(_RAW[sensor], number)}", "a log with readings before correction", "--raw")
    return topic, stream


def _attitude(topics: Log) -> tuple[Stream | None, str]:
    """The attitude of the vehicle's own estimator, else of visual odometry whose world's z is down; and what it is."""
    names = {column: f"q[{k}]" for k, column in enumerate(QUATERNION)}
    own = _columns(topics, "vehicle_attitude", names)
    if own is not None:
        return own, "autopilot"
    for field, downward in _DOWNWARD_FRAMES.items():
        seen = _columns(topics, "vehicle_visual_odometry", {**names, "frame": field})
        if seen is not None:
            return Stream(seen.t, {name: seen[name] for name in names}).rows(np.isin(seen["frame"], downward)), "other"
    return None, "autopilot"


def _columns(topics: Log, topic: str, names: Mapping[str, str]) -> Stream | None:
    """Some fields of a topic as a stream; None where one is missing. A repeated time stamp counts once."""
    wanted = [f"{topic}.{field}" for field in ("timestamp", *names.values())]
    if any(name not in topics for name in wanted):
        return None
    t = _taken(topics, topic) * _MICROSECOND
    first = np.concatenate([[True], np.diff(t) != 0.0]) if len(t) else np.empty(0, dtype=bool)
    return Stream(t[first], {name: topics[f"{topic}.{field}"][first] for name, field in names.items()})


def _taken(topics: Log, topic: str) -> FloatArray:
    """(n,) when the samples of a topic were taken [us]; when they were published, where the log does not say that."""
    published = topics[f"{topic}.timestamp"]
    taken = topics.get(f"{topic}.timestamp_sample", published)
    return taken if np.all(taken > 0.0) else published


def _imu(path: Path, topics: Log, choice: Choice, notes: list[str]) -> tuple[Stream | None, dict[str, SensorSpec]]:
    """The fused samples; of a further IMU the means over its integrals; the chips' own samples where nothing else is,
    or on request. And what the log says of them: samples that fill their steps are averages over them.
    """
    topic, stream = _asked(path, topics, "imu", choice.imu)
    if choice.raw and (own := _named(topics, "imu", choice.imu, raw=True)[1]) is not None and stream is not None:
        if 2 * len(own) > len(stream):
            topic, stream = _called("sensor_gyro", choice.imu), own
        else:
            notes.append(f"imu: --raw has no effect, {len(own)} samples of sensor_gyro beside {len(stream)} of {topic}")
    if stream is None or topic.startswith("sensor_combined"):
        over = topics.get("sensor_combined.accelerometer_integral_dt")
        return stream, averaged(topics["sensor_combined.timestamp"], over) if stream and over is not None else {}
    if not topic.startswith("vehicle_imu"):
        return _of_parts(topics, choice, notes), {}
    notes.append(f"imu: read from {topic}")
    over = stream["over_v"] * _MICROSECOND
    with np.errstate(divide="ignore", invalid="ignore"):
        columns = {name: stream[name] / over for name in ACCEL}
        columns |= {name: stream[name] / (stream["over_a"] * _MICROSECOND) for name in GYRO}
    return Stream(stream.t, columns), averaged(stream.t, over)


def _of_parts(topics: Log, choice: Choice, notes: list[str]) -> Stream | None:
    """The gyroscope, and the accelerometer brought to its stamps; of each what was logged most often."""
    (gyro_topic, gyro), (accel_topic, accel) = (_most_often(topics, part, choice) for part in _PARTS)
    if gyro is None or accel is None:
        return None
    notes.append(f"imu: read from {gyro_topic} and {accel_topic}")
    brought = {name: np.interp(gyro.t, accel.t, accel[name], left=np.nan, right=np.nan) for name in ACCEL}
    warmth = _columns(topics, gyro_topic, {"temperature": "temperature"})
    return Stream(gyro.t, {**brought, **gyro.columns, **(warmth.columns if warmth else {})})


def _most_often(topics: Log, parts: Sequence[tuple[str, dict[str, str]]], choice: Choice) -> tuple[str, Stream | None]:
    """Of several topics with the same sensor that with the most readings; before correction the last alone."""
    found: tuple[str, Stream | None] = "", None
    for topic, names in parts[-1:] if choice.raw else parts:
        stream = _columns(topics, _called(topic, choice.imu), names)
        if stream is not None and len(stream) > (0 if found[1] is None else len(found[1])):
            found = _called(topic, choice.imu), stream
    return found


def _mag(path: Path, topics: Log, choice: Choice, notes: list[str]) -> Stream | None:
    topic, stream = _asked(path, topics, "mag", choice.mag, choice.raw)
    if topic.startswith("sensor_mag"):
        notes.append(f"mag: read from {topic}, without the autopilot's correction and rotation")
    return stream


def _baro(path: Path, topics: Log, number: int) -> Stream | None:
    _, stream = _asked(path, topics, "baro", number)
    if stream is None or "height" in stream:
        return stream
    in_pascal = np.nanmedian(stream["pressure"]) > _PRESSURE_IN_PASCAL
    pressure = stream["pressure"] * (1.0 if in_pascal else _HECTOPASCAL)  # up to PX4 1.13
    return Stream(stream.t, {**stream.columns, "pressure": pressure})


def _range(topics: Log, kind: int) -> Stream | None:
    """Downward ranges of one kind of sensor within its own limits: beyond them there was no echo. The first that has
    any.
    """
    names = {
        "range": "current_distance",
        "low": "min_distance",
        "high": "max_distance",
        "kind": "type",
        "facing": "orientation",
    }
    for k in range(_MOST_INSTANCES):
        stream = _columns(topics, _called("distance_sensor", k), names)
        if stream is None:
            continue
        inside = (stream["range"] > stream["low"]) & (stream["range"] < stream["high"])
        keep = (stream["kind"] == kind) & (stream["facing"] == _DOWNWARD) & inside
        if np.any(keep):
            return Stream(stream.t[keep], {"range": stream["range"][keep]})
    return None


def _gps(path: Path, topics: Log, number: int) -> Stream | None:
    """Fixes in three dimensions: geodetic, with velocity. Older logs have integers of 1e-7 deg and mm, newer floats."""
    topic, stream = _asked(path, topics, "gps", number)
    if stream is None:
        return None
    said = {name: f"{topic}.{field}" for name, field in _FIX_QUALITY.items()}
    there = {name: field for name, field in said.items() if field in topics and np.all(np.isfinite(topics[field]))}
    quality = _columns(topics, topic, {name: field.split(".")[1] for name, field in there.items()})
    assert quality is not None
    good = stream["fix"] >= 3
    units = (1e-7, 1e-7, 1e-3) if f"{topic}.lat" in topics else (1.0, 1.0, 1.0)
    scale = dict(zip(GEODETIC, units, strict=True))
    columns = {name: stream[name] * scale.get(name, 1.0) for name in (*GEODETIC, *VELOCITY)}
    return Stream(stream.t, {**columns, **quality.columns}).rows(good)


def _power(topics: Log) -> Stream | None:
    """Current and voltage of the first battery, and those of further ones beside them."""
    names = {"current": "current_a", "voltage": "voltage_v"}
    found = [_columns(topics, _called("battery_status", k), names) for k in range(_MOST_INSTANCES)]
    return numbered([battery for battery in found if battery is not None])


def _motors(topics: Log) -> Stream | None:
    """Speeds over the largest of the log, 0 to 1; where no controller tells them, commands."""
    return _speeds(topics) or _commands(topics)


def _speeds(topics: Log) -> Stream | None:
    count = topics.get("esc_status.esc_count")
    if count is None or len(count) == 0 or not 1 <= count[0] <= _MOST_MOTORS:
        return None
    names = {f"motor_{k + 1}": f"esc[{k}].esc_rpm" for k in range(int(count[0]))}
    stream = _columns(topics, "esc_status", names)
    if stream is None or len(stream) == 0:
        return None
    if not any(np.any(values) for values in stream.columns.values()):  # controllers that tell no speed
        return None
    top = max(1.0, *(float(np.nanmax(np.abs(values), initial=0.0)) for values in stream.columns.values()))
    return Stream(stream.t, {name: np.abs(values) / top for name, values in stream.columns.items()})


def _commands(topics: Log) -> Stream | None:
    """`actuator_motors` 0 to 1, NaN where there is no motor; before PX4 1.13 the first `actuator_outputs` that drive
    any, pulse widths or throttles of DShot.
    """
    for topic, field in (
        ("actuator_motors", "control"),
        *((_called("actuator_outputs", k), "output") for k in range(_MOST_INSTANCES)),
    ):
        names = {f"motor_{k + 1}": f"{field}[{k}]" for k in range(_MOST_MOTORS) if f"{topic}.{field}[{k}]" in topics}
        stream = _columns(topics, topic, names) if names else None
        if stream is None or len(stream) == 0:
            continue
        least, most = (0.0, 1.0) if field == "control" else _of_outputs(stream)
        driven = {
            name: np.clip((values - least) / (most - least), 0.0, 1.0) for name, values in stream.columns.items()
            if np.all(np.isfinite(values)) and np.all(values <= 1.2 * most) and np.ptp(values) > 0.0
        }  # fmt: skip
        if driven:
            return Stream(stream.t, {f"motor_{k}": values for k, values in enumerate(driven.values(), 1)})
    return None


def _of_outputs(stream: Stream) -> tuple[float, float]:
    """Least and full throttle of outputs; those that are off are zero."""
    on = stream.array(tuple(stream.columns))
    on = on[on > 0.0]
    if np.max(on, initial=0.0) <= 1.0:  # simulated
        return 0.0, 1.0
    return _DSHOT if len(on) and np.min(on) < _SHORTEST_PULSE else PULSES
