"""ArduPilot's dataflash log as a recording: its kinds of messages as streams, its parameters, its own attitude.

Sources: ArduPilot, `AP_Logger/LogFile.cpp` and the `LogStructure.h` of each library (fields and units),
`AP_Compass_Backend.cpp` and `AP_InertialSensor_Backend.cpp` (what is in a reading), `AP_RangeFinder_Params.cpp`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import FIRST, Choice, not_there
from sinan.sensors.formats.dataflash_messages import Dataflash, read_messages
from sinan.sensors.formats.facts import Facts, Table
from sinan.sensors.formats.logged import PULSES, averaged, numbered, recording_of
from sinan.sensors.recording import ACCEL, GEODETIC, GYRO, MAG, QUATERNION, VELOCITY, Recording, SensorSpec, Stream
from sinan.sensors.rotation import quaternion_from_rpy, quaternion_multiply

_AXES = "XYZ"
#: What the text that names ArduPilot's firmware begins with; "APM:Copter" until 2016.
FIRMWARES = ("ArduCopter", "ArduPlane", "ArduRover", "ArduSub", "Rover", "Blimp", "AntennaTracker", "APM:")
_GOOD_FIX = 3
#: `RFND.Stat` of a good range, `.Orient` of one that looks down; `RNGFNDn_TYPE` of those that work by ultrasound.
_GOOD_RANGE, _DOWN = 4, 25
_MOST_RANGES = 10
ULTRASOUND = (2, 9, 13, 30, 31)
#: `SERVOn_FUNCTION` of a motor: 1 to 8, 9 to 12, throttle, left and right throttle.
_MOTORS = (*range(33, 41), *range(82, 86), 70, 73, 74)
#: Pulse widths of no and of full throttle where no parameter says them [us].
#: `AP_Compass` takes a scale between this and one over it; a matrix whose determinant is smaller has no inverse.
_LARGEST_SCALE, _SINGULAR = 1.5, 1e-6
#: The text by which a board tells its name and its chip's number.
_BOARD = re.compile(r"\S+ ([0-9A-F]{8} [0-9A-F]{8} [0-9A-F]{8})")
#: A clock of 32 bits in us starts again after 71 minutes.
_WRAP = 2.0**32 * 1e-6
#: Kinds that hold an attitude, the filter that flew newer logs first: its roll, pitch and yaw in deg.
_ATTITUDES = ("XKF1", "NKF1", "AHR2", "ATT")


def read_ardupilot(path: Path, choice: Choice = FIRST) -> Recording:
    """A log as a recording; see `recording_of_dataflash`."""
    return recording_of_dataflash(read_messages(path), choice)


def recording_of_dataflash(log: Dataflash, choice: Choice = FIRST) -> Recording:
    """IMU, magnetometer, barometer, GPS with what the receiver says of itself, range, supply, motors and air.

    Of the IMU the integrals (`IMT`) are taken where they are there, else `IMU`, else `ACC` brought to the stamps of
    `GYR`. Heights above the sea stand for those above the ellipsoid. Of what the autopilot estimated the attitude is
    kept, as a reference. Neglected: `ISBH`, `ISBD` (bursts), `ESC`, `OF`, `VISP`.

    Parameters
    ----------
    choice : which of several sensors; `raw` takes the offsets, scales and compensation off that the parameters and the
        messages say, not a temperature calibration

    Raises
    ------
    InputError : no accelerometer and gyroscope with a clock, a sensor that is not there, corrections that nothing says
    """
    parameters = parameters_of(log)
    notes = list(log.notes)
    imu, sensors = _imu(log, choice.imu, notes)
    found = {
        "imu": imu, "mag": _mag(log, choice.mag), "baro": _baro(log, choice.baro), "gps": _gps(log, choice.gps),
        "power": _power(log), "motors": _motors(log, parameters, notes), "air": _air(log),
        **_ranges(log, parameters, notes),
    }  # fmt: skip
    if choice.raw:
        found["imu"], found["mag"] = _raw_imu(log, found["imu"], parameters, choice), _raw_mag(log, parameters, choice)
    if found["gps"] is not None:
        notes.append("gps: heights above the sea stand for those above the ellipsoid")
    attitude = _attitude(log, parameters, notes)
    return recording_of(log.path, found, attitude, sensors, notes, sorted(log.kinds))


def ardupilot_facts(path: Path) -> Facts:
    """What a log says of itself."""
    log = read_messages(path)
    texts = log.texts("MSG", "Message") if log.has("MSG", "Message") else []
    firmwares = log.texts("VER", "FWS")[:1] if log.has("VER", "FWS") else []
    firmware = next((text for text in (*firmwares, *texts, *log.heading) if text.startswith(FIRMWARES)), "")
    tables = tuple(
        Table(name, count, _table_rate(log, name), kind.fields, tuple(kind.units))
        for name, (count, kind) in ((name, (log.counts[name], log.kinds[name])) for name in sorted(log.kinds))
    )
    several = {
        sensor: log.instances(base)
        for sensor, base in (("imu", "IMU"), ("mag", "MAG"), ("baro", "BARO"), ("gps", "GPS"))
    }
    what = "ArduPilot dataflash, " + ("text" if log.as_text else "binary")
    boards = (_BOARD.fullmatch(text.strip()) for text in texts)
    board = next((found[1] for found in boards if found), "")
    return Facts(what, firmware, parameters_of(log), tables, several, tuple(texts), board, "ArduPilot")


def parameters_of(log: Dataflash) -> dict[str, float]:
    """The parameters as they were when they were last told."""
    if not log.has("PARM", "Name", "Value"):
        return {}
    return dict(zip(log.texts("PARM", "Name"), log.raw("PARM", "Value").tolist(), strict=True))


def _table_rate(log: Dataflash, kind: str) -> tuple[float, float] | None:
    """The first and the last time of a kind's messages [s]."""
    t = _clock(log, kind)
    good = t[np.isfinite(t)] if t is not None else np.empty(0)
    return (float(np.min(good)), float(np.max(good))) if len(good) else None


def _clock(log: Dataflash, kind: str) -> FloatArray | None:
    """When the messages of a kind were written [s]."""
    if log.has(kind, "TimeUS"):
        return log.column(kind, "TimeUS", "time", "us")
    name = "T" if log.has(kind, "Week") else "TimeMS"  # beside a week TimeMS is the time in it
    return log.column(kind, name, "time", "ms") if log.has(kind, name) else None


def _stream(
    log: Dataflash, found: tuple[str, BoolArray] | None, columns: Mapping[str, tuple[str, str, str]],
    further: Mapping[str, tuple[str, str, str]] | None = None,
) -> Stream | None:  # fmt: skip
    """Some fields of the messages of one sensor as a stream; None where one of `columns` or the clock is missing.

    Parameters
    ----------
    found : the kind, and which of its messages
    columns, further : name of the column: (field, quantity, unit where the log names none)
    """
    if found is None or not log.has(found[0], *(name for name, *_ in columns.values())):
        return None
    kind, mine = found
    t = _clock(log, kind)
    if t is None:
        return None
    there = {name: rule for name, rule in (further or {}).items() if log.has(kind, rule[0])}
    values = {name: log.column(kind, *rule)[mine] for name, rule in {**columns, **there}.items()}
    return Stream(t[mine], values)


def _vector(names: Sequence[str], fields: str, quantity: str, unit: str) -> dict[str, tuple[str, str, str]]:
    """The rules of three columns whose fields end in X, Y, Z."""
    return {name: (f"{fields}{axis}", quantity, unit) for name, axis in zip(names, _AXES, strict=True)}


_TRIADS = {**_vector(ACCEL, "Acc", "acceleration", "m/s^2"), **_vector(GYRO, "Gyr", "rate", "rad/s")}


def _imu(log: Dataflash, number: int, notes: list[str]) -> tuple[Stream | None, dict[str, SensorSpec]]:
    """The IMU, and what is declared of it."""
    there = max(log.instances(base) for base in ("IMU", "IMT", "GYR", "GYR1"))
    if number and number >= there:
        not_there(log.path, "imu", number, there)
    plain = _stream(log, log.rows_of("IMU", number), _TRIADS, {"temperature": ("T", "temperature", "degC")})
    integrated = _integrated(log, number)
    raw = _unfiltered(log, number)
    stream = next((one for one in (integrated and integrated[0], plain, raw) if one is not None), None)
    names = [name for name, one in (("IMT", integrated), ("IMU", plain), ("ACC and GYR", raw)) if one is not None]
    if len(names) > 1:
        notes.append(f"imu: {names[0]} is read, not {' or '.join(names[1:])}")
    if stream is None:
        return None, {}
    if stream is not plain and plain is not None and "temperature" in plain and len(plain):
        warm = np.interp(stream.t, plain.t, plain["temperature"])
        stream = Stream(stream.t, {**stream.columns, "temperature": warm})
    if "temperature" in stream and not np.any(stream["temperature"]):  # a chip that tells none
        stream = Stream(stream.t, {name: value for name, value in stream.columns.items() if name != "temperature"})
    return stream, averaged(integrated[0].t, integrated[1]) if integrated else {}


def _integrated(log: Dataflash, number: int) -> tuple[Stream, FloatArray] | None:
    """Means over the steps of the inertial integrals, and the time over which each was taken [s]."""
    rules = {
        "over_v": ("DelvT", "time", "s"), "over_a": ("DelaT", "time", "s"),
        **{f"v{axis}": (f"DelV{axis}", "speed", "m/s") for axis in _AXES},
        **{f"a{axis}": (f"DelA{axis}", "angle", "rad") for axis in _AXES},
    }  # fmt: skip
    stream = _stream(log, log.rows_of("IMT", number), rules)
    if stream is None or len(stream) == 0:
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        columns = {name: stream[f"v{axis}"] / stream["over_v"] for name, axis in zip(ACCEL, _AXES, strict=True)}
        columns |= {name: stream[f"a{axis}"] / stream["over_a"] for name, axis in zip(GYRO, _AXES, strict=True)}
    return Stream(stream.t, columns), stream["over_v"]


def _unfiltered(log: Dataflash, number: int) -> Stream | None:
    """Samples as the chips gave them, the accelerometer brought to the stamps of the gyroscope."""
    accel, gyro = (
        _stream(log, log.rows_of(kind, number), {name: _TRIADS[name] for name in names},
                {"taken": ("SampleUS", "time", "us")})
        for kind, names in (("ACC", ACCEL), ("GYR", GYRO))
    )  # fmt: skip
    if accel is None or gyro is None or min(len(accel), len(gyro)) == 0:
        return None
    t, when = (_taken(stream) for stream in (gyro, accel))
    columns = {name: np.interp(t, when, accel[name], left=np.nan, right=np.nan) for name in ACCEL}
    return Stream(t, columns | {name: gyro[name] for name in GYRO})


def _taken(stream: Stream) -> FloatArray:
    """When samples were taken: what their column `taken` says, a clock of 32 bits or more; else when written [s]."""
    if "taken" not in stream or not np.all(stream["taken"] > 0.0):
        return stream.t
    return np.asarray(stream.t - np.mod(stream.t - stream["taken"], _WRAP))


_MAG_RULES = _vector(MAG, "Mag", "field", "mGauss")


def _mag(log: Dataflash, number: int) -> Stream | None:
    found = log.rows_of("MAG", number)
    if found is None and number:
        not_there(log.path, "mag", number, log.instances("MAG"))
    stream = _stream(log, found, _MAG_RULES, {"taken": ("S", "time", "us"), "health": ("Health", "number", "1")})
    if stream is None:
        return None
    stream = Stream(_taken(stream), stream.columns)
    good = stream["health"] > 0.0 if "health" in stream and np.any(stream["health"]) else np.ones(len(stream), bool)
    first = np.concatenate([[True], np.diff(stream.t) != 0.0]) if len(stream) else good  # one reading, written twice
    return Stream(stream.t, {name: stream[name] for name in MAG}).rows(good & first)


def _baro(log: Dataflash, number: int) -> Stream | None:
    found = log.rows_of("BARO", number)
    if found is None and number:
        not_there(log.path, "baro", number, log.instances("BARO"))
    rules = {"height": ("Alt", "length", "m"), "pressure": ("Press", "pressure", "Pa")}
    return _stream(log, found, rules, {"temperature": ("Temp", "temperature", "degC")})


def _gps(log: Dataflash, number: int) -> Stream | None:
    """Fixes in three dimensions, with what the receiver says of them in `GPA`, written with them."""
    found = log.rows_of("GPS", number)
    if found is None and number:
        not_there(log.path, "gps", number, log.instances("GPS"))
    rules = dict(zip(GEODETIC, (("Lat", "degrees", "deg"), ("Lng", "degrees", "deg"), ("Alt", "length", "m")),
                     strict=True))  # fmt: skip
    rules |= {"fix": ("Status", "number", "1"), "speed": ("Spd", "speed", "m/s"), "course": ("GCrs", "degrees", "deg")}
    further = {
        "down": ("VZ", "speed", "m/s"), "hdop": ("HDop", "number", "1"), "satellites": ("NSats", "number", "1")
    }  # fmt: skip
    stream = _stream(log, found, rules, further)
    if stream is None:
        return None
    columns = {name: stream[name] for name in (*GEODETIC, "hdop", "satellites") if name in stream}
    if "down" in stream:
        course = np.radians(stream["course"])
        north, east = stream["speed"] * np.cos(course), stream["speed"] * np.sin(course)
        columns |= dict(zip(VELOCITY, (north, east, stream["down"]), strict=True))
    said = _stream(log, log.rows_of("GPA", number), {"eph": ("HAcc", "length", "m"), "epv": ("VAcc", "length", "m")}, {
        "s_variance": ("SAcc", "speed", "m/s"), "vdop": ("VDop", "number", "1")})  # fmt: skip
    if said is not None and len(said):
        order = np.argsort(said.t, kind="stable")
        latest = order[np.maximum(np.searchsorted(said.t[order], stream.t, side="right") - 1, 0)]
        columns |= {name: values[latest] for name, values in said.columns.items()}
    return Stream(stream.t, columns).rows(stream["fix"] >= _GOOD_FIX)


def _power(log: Dataflash) -> Stream | None:
    """Current and voltage of the first battery, and those of further ones beside them."""
    rules = {"current": ("Curr", "current", "A"), "voltage": ("Volt", "voltage", "V")}
    batteries = [_stream(log, log.rows_of("BAT", k), rules) for k in range(log.instances("BAT"))]
    return numbered([battery for battery in batteries if battery is not None])


def motor_outputs(parameters: Mapping[str, float], most: int) -> list[int]:
    """The outputs that drive a motor, counted from 1."""
    return [k for k in range(1, most + 1) if parameters.get(f"SERVO{k}_FUNCTION") in _MOTORS]


def motor_stream(t: FloatArray, pulses: Sequence[FloatArray], parameters: Mapping[str, float]) -> Stream:
    """Commands from no throttle 0 to full throttle 1, of pulse widths [us]."""
    least, most = (
        parameters.get(name, 0.0) or pulse for name, pulse in zip(("MOT_PWM_MIN", "MOT_PWM_MAX"), PULSES, strict=True)
    )
    if not least < most:
        least, most = PULSES
    columns = {f"motor_{m}": np.clip((one - least) / (most - least), 0.0, 1.0) for m, one in enumerate(pulses, 1)}
    return Stream(t, columns)


def _motors(log: Dataflash, parameters: Mapping[str, float], notes: list[str]) -> Stream | None:
    """Commands of the outputs that drive a motor."""
    if "RCOU" not in log.kinds:
        return None
    outputs = motor_outputs(parameters, 14)
    if not outputs:
        notes.append("motors: no parameter SERVOn_FUNCTION says which output drives one, left out")
        return None
    names = [next((name for name in (f"C{k}", f"Ch{k}", f"Chan{k}") if log.has("RCOU", name)), "") for k in outputs]
    t = _clock(log, "RCOU")
    if t is None or not all(names):
        return None
    return motor_stream(t, [log.raw("RCOU", name) for name in names], parameters)


def _ranges(log: Dataflash, parameters: Mapping[str, float], notes: list[str]) -> dict[str, Stream]:
    """Good ranges downward, of the first that measures by light and the first that measures by sound."""
    found: dict[str, Stream] = {}
    for k in range(_MOST_RANGES):
        stream = _one_range(log, k)
        if stream is None:
            continue
        good = stream["facing"] == _DOWN
        if "state" in stream:
            good &= stream["state"] == _GOOD_RANGE
        if not np.any(good):
            continue
        made = parameters.get(f"RNGFND{k + 1}_TYPE", parameters.get("RNGFND_TYPE") if k == 0 else None)
        name = "sonar" if made in ULTRASOUND else "laser"
        if made is None and name not in found:
            notes.append("laser: no parameter RNGFNDn_TYPE says how it measures: by light, it is assumed")
        found.setdefault(name, Stream(stream.t[good], {"range": stream["range"][good]}))
    return found


def _one_range(log: Dataflash, k: int) -> Stream | None:
    """The ranges of one sensor: newer logs have a message each, older ones (3.4 to 4.0) two sensors in one message."""
    end = f"{k + 1}" if log.has("RFND", "Dist1") else ""
    found = log.rows_of("RFND", 0 if end else k)
    rules = {"range": (f"Dist{end}", "length", "m"), "facing": (f"Orient{end}", "number", "1")}
    return _stream(log, found, rules, {"state": (f"Stat{end}", "number", "1")})


def _air(log: Dataflash) -> Stream | None:
    return _stream(log, log.rows_of("ARSP", 0), {"airspeed": ("Airspeed", "speed", "m/s")}, {
        "temperature": ("Temp", "temperature", "degC")})  # fmt: skip


def trim_of(parameters: Mapping[str, float], notes: list[str]) -> FloatArray:
    """(3,) `AHRS_TRIM` [rad]: by how much the vehicle is turned against the board, which reads; told where not zero."""
    trim = _three(parameters, "AHRS_TRIM", 0.0)
    trim = np.where(np.isfinite(trim), trim, 0.0)
    if np.any(trim):
        angles = ", ".join(f"{angle:.3g}" for angle in np.degrees(trim[:2]))
        what = f"without AHRS_TRIM ({angles} deg of roll, pitch)"
        notes.append(f"reference: the autopilot's attitude is that of its board, {what}")
    return trim


def board_attitude(logged: FloatArray, trim: FloatArray) -> FloatArray:
    """(n, 4) q_nb of the board, whose axes the readings have, where the vehicle's is logged.

    Parameters
    ----------
    logged : (n, 3) angles of an EKF, which are the board's less the trim, axis by axis, in every attitude; or (n, 4)
        quaternions of the vehicle, which is turned by the trim in the board: C_nb = C_nv C(trim)
    trim : (3,) [rad]

    Source: ArduPilot, `NavEKF3_core::getEulerAngles`, `AP_AHRS_DCM::update`, `AP_AHRS::update_trim_rotation_matrices`
    """
    if logged.shape[1] == 3:
        return quaternion_from_rpy(logged + trim)
    return quaternion_multiply(logged, quaternion_from_rpy(trim[None, :]))


def _attitude(log: Dataflash, parameters: Mapping[str, float], notes: list[str]) -> Stream | None:
    """The board's attitude as the autopilot estimated it, of its first core; `AHR2` is its DCM's, a rotation."""
    rules = {axis: (axis.capitalize(), "degrees", "deg") for axis in ("roll", "pitch", "yaw")}
    for kind in _ATTITUDES:
        stream = _stream(log, log.rows_of(kind, 0), rules)
        if stream is not None and len(stream):
            rpy = np.radians(stream.array(("roll", "pitch", "yaw")))
            q = board_attitude(quaternion_from_rpy(rpy) if kind == "AHR2" else rpy, trim_of(parameters, notes))
            return Stream(stream.t, dict(zip(QUATERNION, q.T, strict=True)))
    return None


# --- what the autopilot has put into its readings -------------------------------------------------------------------


def _three(parameters: Mapping[str, float], name: str, default: float) -> FloatArray:
    """(3,) a parameter of three axes."""
    return np.array([parameters.get(f"{name}_{axis}", default) for axis in _AXES])


def _raw_imu(log: Dataflash, stream: Stream | None, parameters: Mapping[str, float], choice: Choice) -> Stream | None:
    """reading = (raw - offset) * scale of the accelerometer, raw - offset of the gyroscope, about the board's axes."""
    k = "" if choice.imu == 0 else str(choice.imu + 1)
    if stream is None:
        return None
    if f"INS_ACC{k}OFFS_X" not in parameters or f"INS_GYR{k}OFFS_X" not in parameters:
        raise InputError(log.path, f"no parameters INS_ACC{k}OFFS and INS_GYR{k}OFFS", "a log that has them", "--raw")
    if parameters.get("AHRS_ORIENTATION", 0.0) != 0.0:
        found = f"a board that is mounted turned (AHRS_ORIENTATION {parameters['AHRS_ORIENTATION']:g})"
        raise InputError(log.path, found, "readings without --raw: the offsets are about the board's axes", "--raw")
    scale = _three(parameters, f"INS_ACC{k}SCAL", 1.0)
    scale = np.where(scale == 0.0, 1.0, scale)
    accel = stream.array(ACCEL) / scale + _three(parameters, f"INS_ACC{k}OFFS", 0.0)
    gyro = stream.array(GYRO) + _three(parameters, f"INS_GYR{k}OFFS", 0.0)
    columns = dict(zip((*ACCEL, *GYRO), np.hstack([accel, gyro]).T, strict=True))
    return Stream(stream.t, {**stream.columns, **columns})


def _raw_mag(log: Dataflash, parameters: Mapping[str, float], choice: Choice) -> Stream | None:
    """The field before offsets o, scale s, soft-iron matrix D and compensation c: reading = D s (raw + o) + c."""
    found = log.rows_of("MAG", choice.mag)
    stream = _mag(log, choice.mag)
    if found is None or stream is None:
        return None
    kind = found[0]
    motor = "MO" if log.has(kind, "MOX") else "MOfs"
    names = [f"{prefix}{axis}" for prefix in ("o", "c") for axis in _AXES]
    rules = {f"o{axis}": (f"Ofs{axis}", "field", "mGauss") for axis in _AXES}
    rules |= {f"c{axis}": (f"{motor}{axis}", "field", "mGauss") for axis in _AXES}
    offsets = _stream(log, found, rules)
    if offsets is None:
        raise InputError(log.path, f"no offsets in {kind}", "a log that has them", "--raw")
    at = np.clip(np.searchsorted(offsets.t, stream.t), 0, len(offsets) - 1)  # a reading is told when it has been taken
    offset, compensation = np.split(offsets.array(names)[at], 2, axis=1)
    k = _compass(parameters, offset[-1], choice.mag)
    diagonal, off = _three(parameters, f"COMPASS_DIA{k}", 0.0), _three(parameters, f"COMPASS_ODI{k}", 0.0)
    D = np.diag(diagonal) if np.any(diagonal) else np.eye(3)
    if np.any(diagonal):
        D[[0, 0, 1], [1, 2, 2]] = D[[1, 2, 2], [0, 0, 1]] = off
    if not (np.all(np.isfinite(D)) and abs(np.linalg.det(D)) > _SINGULAR):
        raise InputError(log.path, f"COMPASS_DIA{k} and COMPASS_ODI{k} that cannot be undone", "others", "--raw")
    scale = parameters.get(f"COMPASS_SCALE{k}", 0.0)
    scale = scale if 1.0 / _LARGEST_SCALE < scale < _LARGEST_SCALE else 1.0
    raw = np.linalg.solve(D, (stream.array(MAG) - compensation).T).T / scale - offset
    return Stream(stream.t, dict(zip(MAG, raw.T, strict=True)))


def compass_of(log: Dataflash, parameters: Mapping[str, float], number: int) -> str:
    """The number in the parameters of the compass that a log calls `number`: nothing, 2 or 3."""
    found = log.rows_of("MAG", number)
    offsets = _stream(log, found, {axis: (f"Ofs{axis}", "field", "mGauss") for axis in _AXES})
    offset = np.full(3, np.nan) if offsets is None or len(offsets) == 0 else offsets.array(tuple(_AXES))[-1]
    return _compass(parameters, offset, number)


def _compass(parameters: Mapping[str, float], offset: FloatArray, number: int) -> str:
    """The number in the parameters of a compass: of that with its last offsets [gauss], since the order of the messages
    is that of `COMPASS_PRIOn_ID`.
    """
    own = ("", "2", "3")[min(number, 2)]
    for k in (own, "", "2", "3"):
        if np.allclose(_three(parameters, f"COMPASS_OFS{k}", np.inf), 1e3 * offset, atol=1.0):  # mGauss, whole ones
            return k
    return own
