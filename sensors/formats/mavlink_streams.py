"""What MAVLink's messages mean: which of them make which stream, in SI units.

A stream is found once, in a whole log or in the first second of a link: which message it is read from, and which of
its columns the vehicle sends. What was found then reads any later part of the vehicle's messages into these columns.
Source: MAVLink common message set.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.constants import STANDARD_GRAVITY
from sinan.sensors.formats.ardupilot import FIRMWARES, board_attitude, motor_outputs, motor_stream, trim_of
from sinan.sensors.formats.choice import Choice, not_there
from sinan.sensors.formats.logged import numbered
from sinan.sensors.formats.mavlink_frames import Telemetry
from sinan.sensors.recording import ACCEL, GEODETIC, GYRO, MAG, QUATERNION, Stream

_MILLI, _CENTI, _HECTO = 1e-3, 1e-2, 1e2
#: Messages of an IMU with its magnetometer, best first: name, number of the IMU.
IMU_MESSAGES = (
    ("HIGHRES_IMU", 0), ("RAW_IMU", 0), ("SCALED_IMU", 0), ("SCALED_IMU2", 1), ("SCALED_IMU3", 2),
)  # fmt: skip
PRESSURE_MESSAGES = ("SCALED_PRESSURE", "SCALED_PRESSURE2", "SCALED_PRESSURE3")
RECEIVER_MESSAGES = ("GPS_RAW_INT", "GPS2_RAW")
#: `HIGHRES_IMU.fields_updated`: bits of the magnetometer, of the pressure and of its height.
_NEW_MAG, _NEW_PRESSURE = 0x1C0, 0xA00
_GOOD_FIX, _UNKNOWN_16 = 3, 65535
_LASER, _ULTRASOUND, _DOWN = 0, 1, 25
_OUTPUTS = 16
#: Who wrote the autopilot, as its HEARTBEAT says.
AUTOPILOTS = {3: "ArduPilot", 12: "PX4"}
_INTEGERS = {1: "<u1", 2: "<i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4"}
#: A clock beyond this counts from 1970, not from the start of the autopilot [s].
LONGEST_ON = 1e8
#: The clock of SERVO_OUTPUT_RAW has 32 bits of us [s].
WRAP = 2.0**32 * 1e-6
#: Fields that say when a reading was taken, and their units [s].
OWN_CLOCKS = (("time_boot_ms", 1e-3), ("time_usec", 1e-6))


class Clock(Protocol):
    """When the messages of a part of a log were taken."""

    def of(self, name: str) -> FloatArray:
        """(n,) of the messages of a kind [s]."""


#: Reads a stream out of messages; None: it is not among them.
Reader = Callable[[Telemetry, Clock], Stream | None]
_Source = tuple[str, int | None]


#: What finds each stream, by its name; `attitude` is the autopilot's own. Of the messages, with a choice of sensors,
#: the autopilot's parameters, and notes to which is added what was chosen, and what is not read.
FINDERS: Mapping[str, Callable[[Telemetry, Choice, Mapping[str, float], list[str]], Reader | None]] = {
    "imu": lambda log, choice, parameters, notes: _imu(log, choice.imu, notes),
    "mag": lambda log, choice, parameters, notes: _mag(log, choice.mag),
    "baro": lambda log, choice, parameters, notes: _baro(log, choice.baro),
    "gps": lambda log, choice, parameters, notes: _gps(log, choice.gps, notes),
    "laser": lambda log, choice, parameters, notes: _range(log, _LASER),
    "sonar": lambda log, choice, parameters, notes: _range(log, _ULTRASOUND),
    "power": lambda log, choice, parameters, notes: _power(log),
    "motors": lambda log, choice, parameters, notes: _motors(log, parameters, notes),
    "attitude": lambda log, choice, parameters, notes: _attitude(log, trim_of(parameters, notes)),
}


def readers_of(log: Telemetry, choice: Choice, parameters: Mapping[str, float], notes: list[str]) -> dict[str, Reader]:
    """What reads each stream that messages hold, by its name in `FINDERS`.

    Parameters
    ----------
    choice : which of several sensors
    parameters : of the autopilot, which say what its outputs drive
    notes : to which is added what was chosen, and what is not read

    Raises
    ------
    InputError : a sensor that is asked for and is not there
    """
    found = {name: find(log, choice, parameters, notes) for name, find in FINDERS.items()}
    return {name: reader for name, reader in found.items() if reader is not None}


def instances_of(log: Telemetry) -> dict[str, int]:
    """How many of each sensor there are."""
    return {
        "imu": len(_imus(log)), "mag": len(_mags(log)), "baro": sum(name in log for name in PRESSURE_MESSAGES),
        "gps": sum(name in log for name in RECEIVER_MESSAGES),
    }  # fmt: skip


def autopilot_of(log: Telemetry) -> int:
    """Which autopilot says most often that it is alive; where none does, whose firmware tells its name; 0: none.

    A text is asked last: ArduPilot also tells the middleware of its board, which is PX4's ("PX4: b0cb142b NuttX: ...").
    """
    kinds = log.numbers("HEARTBEAT", "autopilot").astype(int) if "HEARTBEAT" in log else np.empty(0, int)
    known = [kind for kind in kinds.tolist() if kind in AUTOPILOTS]
    if known:
        return max(sorted(set(known)), key=known.count)
    return next((kind for kind in AUTOPILOTS if firmware_of(log, kind)), 0)


def firmware_of(log: Telemetry, autopilot: int) -> str:
    """The text by which an autopilot's firmware tells its name; empty: there is none."""
    names = {"ArduPilot": FIRMWARES, "PX4": ("PX4",)}.get(AUTOPILOTS.get(autopilot, ""), ())
    texts = log.texts("STATUSTEXT", "text") if "STATUSTEXT" in log else []
    return next((text for text in texts if names and text.startswith(names)), "")


def parameters_of(log: Telemetry, autopilot: int) -> dict[str, float]:
    """Parameters as they were told last. PX4 sends whole numbers byte by byte in the place of a float."""
    if "PARAM_VALUE" not in log:
        return {}
    values = log.raw("PARAM_VALUE", "param_value")
    kinds = log.numbers("PARAM_VALUE", "param_type").astype(int)
    found = {}
    for name, value, kind in zip(log.texts("PARAM_VALUE", "param_id"), values, kinds.tolist(), strict=True):
        whole = AUTOPILOTS.get(autopilot) == "PX4" and kind in _INTEGERS
        found[name] = float(np.frombuffer(value.tobytes(), _INTEGERS[kind], count=1)[0]) if whole else float(value)
    return found


def _imus(log: Telemetry) -> dict[int, _Source]:
    """The messages of each IMU by its number: name, and the identity that `HIGHRES_IMU` gives it."""
    found: dict[int, _Source] = {}
    if "HIGHRES_IMU" in log:
        identities = np.unique(log.numbers("HIGHRES_IMU", "id")).astype(int).tolist()
        found = {k: ("HIGHRES_IMU", identity) for k, identity in enumerate(identities)}
    for name, number in IMU_MESSAGES[1:]:
        if name in log:
            found.setdefault(number, (name, None))
    return found


def _mags(log: Telemetry) -> dict[int, _Source]:
    """The messages of each magnetometer: those of the IMUs that hold a field."""
    return {
        number: source for number, source in _imus(log).items()
        if np.any(_three(log, source[0], "mag", 1.0)[_rows(log, source)])
    }  # fmt: skip


def _rows(log: Telemetry, source: _Source) -> BoolArray:
    name, identity = source
    return np.ones(log.counts[name], dtype=bool) if identity is None else log.numbers(name, "id") == identity


def _three(log: Telemetry, name: str, end: str, unit: float) -> FloatArray:
    """(n, 3) the fields of three axes."""
    return np.stack([log.numbers(name, f"{axis}{end}") for axis in "xyz"], axis=-1) * unit


def _one_of(log: Telemetry, sensor: str, number: int, sources: Mapping[int, _Source]) -> _Source | None:
    if number not in sources and number:
        not_there(log.path, sensor, number, sorted(sources))
    return sources.get(number)


def _imu(log: Telemetry, number: int, notes: list[str]) -> Reader | None:
    source = _one_of(log, "imu", number, _imus(log))
    if source is None:
        return None
    name, fine = source[0], source[0] == "HIGHRES_IMU"
    warm = bool(np.any(log.numbers(name, "temperature")))  # zero: not told
    if not fine:
        notes.append(f"imu: {name}, rounded to 1 mg and 1 mrad/s")

    def read(log: Telemetry, clock: Clock) -> Stream | None:
        if name not in log:
            return None
        force = _three(log, name, "acc", 1.0 if fine else _MILLI * STANDARD_GRAVITY)
        rate = _three(log, name, "gyro", 1.0 if fine else _MILLI)
        columns = dict(zip((*ACCEL, *GYRO), np.hstack([force, rate]).T, strict=True))
        if warm:
            columns["temperature"] = log.numbers(name, "temperature") * (1.0 if fine else _CENTI)
        return Stream(clock.of(name), columns).rows(_rows(log, source))

    return read


def _mag(log: Telemetry, number: int) -> Reader | None:
    source = _one_of(log, "mag", number, _mags(log))
    if source is None:
        return None
    name, says = source[0], _says_what_is_new(log, source[0], _NEW_MAG)

    def read(log: Telemetry, clock: Clock) -> Stream | None:
        if name not in log:
            return None
        gauss = _three(log, name, "mag", 1.0 if name == "HIGHRES_IMU" else _MILLI)
        new = _rows(log, source) & _updated(log, name, _NEW_MAG, says)
        return Stream(clock.of(name), dict(zip(MAG, gauss.T, strict=True))).rows(new)

    return read


def _says_what_is_new(log: Telemetry, name: str, bits: int) -> bool:
    """Whether messages say that some of their fields are new."""
    return name == "HIGHRES_IMU" and bool(np.any(_updated(log, name, bits, True)))


def _updated(log: Telemetry, name: str, bits: int, says: bool) -> BoolArray:
    """(n,) whether some fields of a message are new; all, where none says so."""
    if not says:
        return np.ones(log.counts[name], dtype=bool)
    return (log.numbers(name, "fields_updated").astype(np.int64) & bits) != 0


def _baro(log: Telemetry, number: int) -> Reader | None:
    there = [k for k, name in enumerate(PRESSURE_MESSAGES) if name in log]
    if number in there:
        name = PRESSURE_MESSAGES[number]

        def read(log: Telemetry, clock: Clock) -> Stream | None:
            if name not in log:
                return None
            columns = {"pressure": log.numbers(name, "press_abs") * _HECTO,
                       "temperature": log.numbers(name, "temperature") * _CENTI}  # fmt: skip
            return Stream(clock.of(name), columns)

        return read
    if number:
        not_there(log.path, "baro", number, there)
    if "HIGHRES_IMU" not in log or not np.any(log.numbers("HIGHRES_IMU", "abs_pressure")):
        return None
    says = _says_what_is_new(log, "HIGHRES_IMU", _NEW_PRESSURE)

    def read_highres(log: Telemetry, clock: Clock) -> Stream | None:
        if "HIGHRES_IMU" not in log:
            return None
        columns = {"pressure": log.numbers("HIGHRES_IMU", "abs_pressure") * _HECTO}
        new = _updated(log, "HIGHRES_IMU", _NEW_PRESSURE, says)
        return Stream(clock.of("HIGHRES_IMU"), columns).rows(new)

    return read_highres


#: What a receiver says of its fix: column, field, unit, the value that stands for nothing known.
_QUALITY = {
    "eph": ("h_acc", _MILLI, 0.0), "epv": ("v_acc", _MILLI, 0.0), "s_variance": ("vel_acc", _MILLI, 0.0),
    "hdop": ("eph", _CENTI, _UNKNOWN_16), "vdop": ("epv", _CENTI, _UNKNOWN_16),
    "satellites": ("satellites_visible", 1.0, 255),
}  # fmt: skip


def _gps(log: Telemetry, number: int, notes: list[str]) -> Reader | None:
    """Fixes in three dimensions, with what the receiver says of them where it says it throughout."""
    there = [k for k, name in enumerate(RECEIVER_MESSAGES) if name in log]
    if number not in there:
        if number:
            not_there(log.path, "gps", number, there)
        return None
    name = RECEIVER_MESSAGES[number]
    fixed = log.numbers(name, "fix_type") >= _GOOD_FIX
    above = "alt_ellipsoid"
    if not np.all(log.numbers(name, above)[fixed]):  # zero: not told
        above = "alt"
        notes.append("gps: heights above the sea stand for those above the ellipsoid")
    columns_of = {
        column: said for column, said in _QUALITY.items() if np.all(log.numbers(name, said[0])[fixed] != said[2])
    }  # fmt: skip

    def read(log: Telemetry, clock: Clock) -> Stream | None:
        if name not in log:
            return None
        lla = log.numbers(name, "lat") * 1e-7, log.numbers(name, "lon") * 1e-7, log.numbers(name, above) * _MILLI
        columns = dict(zip(GEODETIC, lla, strict=True))
        for column, (part, unit, unknown) in columns_of.items():
            values = log.numbers(name, part)
            columns[column] = np.where(values == unknown, np.nan, values) * unit
        return Stream(clock.of(name), columns).rows(log.numbers(name, "fix_type") >= _GOOD_FIX)

    return read


def _range(log: Telemetry, kind: int) -> Reader | None:
    """Downward ranges of one kind of sensor within its own limits."""

    def read(log: Telemetry, clock: Clock) -> Stream | None:
        if "DISTANCE_SENSOR" not in log:
            return None
        now = log.numbers("DISTANCE_SENSOR", "current_distance")
        return Stream(clock.of("DISTANCE_SENSOR"), {"range": now * _CENTI}).rows(_good_ranges(log, kind))

    return read if "DISTANCE_SENSOR" in log and np.any(_good_ranges(log, kind)) else None


def _good_ranges(log: Telemetry, kind: int) -> BoolArray:
    near, far, now, made, facing = (
        log.numbers("DISTANCE_SENSOR", part)
        for part in ("min_distance", "max_distance", "current_distance", "type", "orientation")
    )
    return np.asarray((made == kind) & (facing == _DOWN) & (now > near) & (now < far))


def _power(log: Telemetry) -> Reader | None:
    """Current and voltage of the first battery, and those of further ones beside them."""
    name = next((name for name in ("BATTERY_STATUS", "SYS_STATUS") if name in log), None)
    if name is None:
        return None
    columns_of = {
        one: columns for one in np.unique(_battery(log, name)).tolist()
        if (columns := _columns(*_supply(log, name), _battery(log, name) == one))
    }  # fmt: skip

    def read(log: Telemetry, clock: Clock) -> Stream | None:
        if name not in log:
            return None
        values, t = dict(zip(("current", "voltage"), _supply(log, name), strict=True)), clock.of(name)
        found = []
        for one, columns in columns_of.items():
            mine = _battery(log, name) == one
            found.append(Stream(t[mine], {column: values[column][mine] for column in columns}))
        return numbered(found)

    return read if columns_of else None


def _battery(log: Telemetry, name: str) -> FloatArray:
    """(n,) which battery a message is of."""
    return log.numbers(name, "id") if name == "BATTERY_STATUS" else np.zeros(log.counts[name])


def _supply(log: Telemetry, name: str) -> tuple[FloatArray, FloatArray]:
    """Current [A] and voltage [V], each (n,); NaN where it is not known, which -1 and 0 say."""
    current = log.numbers(name, "current_battery") * _CENTI
    if name == "SYS_STATUS":
        voltage = log.numbers(name, "voltage_battery") * _MILLI
    else:
        cells = log.numbers(name, "voltages")
        voltage = np.sum(np.where(cells == _UNKNOWN_16, 0.0, cells), axis=1) * _MILLI
    return np.where(current < 0.0, np.nan, current), np.where(voltage > 0.0, voltage, np.nan)


def _columns(current: FloatArray, voltage: FloatArray, mine: BoolArray) -> tuple[str, ...]:
    """Which of the two a battery tells throughout."""
    known = {"current": current[mine], "voltage": voltage[mine]}
    return tuple(column for column, values in known.items() if np.all(np.isfinite(values)))


def _motors(log: Telemetry, parameters: Mapping[str, float], notes: list[str]) -> Reader | None:
    if "SERVO_OUTPUT_RAW" not in log:
        return None
    outputs = motor_outputs(parameters, _OUTPUTS)
    if not outputs:
        notes.append("motors: no parameter SERVOn_FUNCTION says which output drives one, left out")
        return None

    def read(log: Telemetry, clock: Clock) -> Stream | None:
        if "SERVO_OUTPUT_RAW" not in log:
            return None
        first = log.numbers("SERVO_OUTPUT_RAW", "port") == 0
        pulses = [log.numbers("SERVO_OUTPUT_RAW", f"servo{k}_raw")[first] for k in outputs]
        return motor_stream(clock.of("SERVO_OUTPUT_RAW")[first], pulses, parameters)

    return read


def _attitude(log: Telemetry, trim: FloatArray) -> Reader | None:
    """The attitude of the board, of whose axes the readings are; `trim` as in `board_attitude`."""
    name = next((name for name in ("ATTITUDE_QUATERNION", "ATTITUDE") if name in log), None)

    def read(log: Telemetry, clock: Clock) -> Stream | None:
        if name is None or name not in log:
            return None
        if name == "ATTITUDE_QUATERNION":
            logged = np.stack([log.numbers(name, f"q{k}") for k in range(1, 5)], axis=-1)
        else:
            logged = np.stack([log.numbers(name, part) for part in ("roll", "pitch", "yaw")], axis=-1)
        return Stream(clock.of(name), dict(zip(QUATERNION, board_attitude(logged, trim).T, strict=True)))

    return None if name is None else read
