"""MAVLink telemetry logs as recordings: what a vehicle sent over its radio, as a ground station kept it.

Rates are those of the link and readings are rounded to what a message holds (1 mg, 1 mrad/s, 1 mGauss, but in
`HIGHRES_IMU`): the autopilot's own log is better where there is one. Source: MAVLink common message set.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.constants import STANDARD_GRAVITY
from sinan.sensors.errors import InputError
from sinan.sensors.formats.ardupilot import motor_outputs, motor_stream
from sinan.sensors.formats.choice import FIRST, Choice, not_there
from sinan.sensors.formats.facts import Facts, Table
from sinan.sensors.formats.logged import beside, recording_of
from sinan.sensors.formats.mavlink_frames import Telemetry, read_telemetry
from sinan.sensors.recording import ACCEL, GEODETIC, GYRO, MAG, QUATERNION, Recording, Stream
from sinan.sensors.rotation import quaternion_from_rpy

_MILLI, _CENTI, _HECTO = 1e-3, 1e-2, 1e2
#: Messages of an IMU with its magnetometer, best first: name, number of the IMU.
_IMUS = (
    ("HIGHRES_IMU", 0), ("RAW_IMU", 0), ("SCALED_IMU", 0), ("SCALED_IMU2", 1), ("SCALED_IMU3", 2),
)  # fmt: skip
_PRESSURES = ("SCALED_PRESSURE", "SCALED_PRESSURE2", "SCALED_PRESSURE3")
_RECEIVERS = ("GPS_RAW_INT", "GPS2_RAW")
#: `HIGHRES_IMU.fields_updated`: bits of the magnetometer, of the pressure and of its height.
_NEW_MAG, _NEW_PRESSURE = 0x1C0, 0xA00
_GOOD_FIX, _UNKNOWN_16 = 3, 65535
_LASER, _ULTRASOUND, _DOWN = 0, 1, 25
#: A clock beyond this counts from 1970, not from the start of the autopilot [s].
_LONGEST_ON = 1e8
_WRAP = 2.0**32 * 1e-6
_AUTOPILOTS = {3: "ArduPilot", 12: "PX4"}
_INTEGERS = {1: "<u1", 2: "<i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4"}


def read_tlog(path: Path, choice: Choice = FIRST) -> Recording:
    """A telemetry log as a recording: IMU, magnetometer, barometer, GPS, range, supply, motors; attitude as reference.

    A reading is stamped by the autopilot's clock where its message has one, else by its arrival less the least delay of
    the IMU's. Neglected: velocities (`GPS_RAW_INT` has none downward), what the autopilot estimates but its attitude.

    Raises
    ------
    InputError : what `read_telemetry` finds wrong; no IMU, a sensor that is not there, `raw`
    """
    if choice.raw:
        raise InputError(path, "a telemetry log, which does not hold what was corrected", "no --raw", "--raw")
    log = read_telemetry(path)
    clock = _Clock(log)
    notes = list(log.notes)
    found = {
        "imu": _imu(log, clock, choice.imu, notes), "mag": _mag(log, clock, choice.mag),
        "baro": _baro(log, clock, choice.baro), "gps": _gps(log, clock, choice.gps, notes),
        "laser": _range(log, clock, _LASER), "sonar": _range(log, clock, _ULTRASOUND), "power": _power(log, clock),
        "motors": _motors(log, clock, notes),
    }  # fmt: skip
    return recording_of(path, found, _attitude(log, clock), {}, notes, list(log.counts))


def tlog_facts(path: Path) -> Facts:
    """What a telemetry log says of itself."""
    log = read_telemetry(path)
    tables = []
    for name, count in log.counts.items():
        t = log.arrived(name)
        tables.append(Table(name, count, (float(np.min(t)), float(np.max(t)))))
    several = {
        "imu": len(_imus(log)), "mag": len(_mags(log)), "baro": sum(name in log for name in _PRESSURES),
        "gps": sum(name in log for name in _RECEIVERS),
    }  # fmt: skip
    texts = tuple(log.texts("STATUSTEXT", "text")) if "STATUSTEXT" in log else ()
    maker = _AUTOPILOTS.get(_autopilot(log), "")
    version = next((text for text in texts if text.startswith(("Ardu", "PX4", "Rover", "Blimp"))), "")
    return Facts("MAVLink telemetry log", version or maker, _parameters(log), tuple(tables), several, texts)


def _autopilot(log: Telemetry) -> int:
    """Which autopilot says that it is alive; 0: none."""
    kinds = log.numbers("HEARTBEAT", "autopilot").astype(int) if "HEARTBEAT" in log else np.empty(0, int)
    known = [kind for kind in kinds.tolist() if kind in _AUTOPILOTS]
    return known[0] if known else 0


def _parameters(log: Telemetry) -> dict[str, float]:
    """Parameters as they were told last. PX4 sends whole numbers byte by byte in the place of a float."""
    if "PARAM_VALUE" not in log:
        return {}
    values = log.raw("PARAM_VALUE", "param_value")
    kinds = log.numbers("PARAM_VALUE", "param_type").astype(int)
    bytewise = _autopilot(log) == 12
    found = {}
    for name, value, kind in zip(log.texts("PARAM_VALUE", "param_id"), values, kinds.tolist(), strict=True):
        whole = bytewise and kind in _INTEGERS
        found[name] = float(np.frombuffer(value.tobytes(), _INTEGERS[kind], count=1)[0]) if whole else float(value)
    return found


class _Clock:
    """When readings were taken, on the autopilot's clock.

    Parameters
    ----------
    log : whose arrivals are brought to that clock by the least delay of its IMU's messages
    """

    def __init__(self, log: Telemetry) -> None:
        self.log = log
        delays = [
            float(np.min(log.arrived(name) - own)) for name, _ in _IMUS
            if name in log and (own := self._own(name)) is not None
        ]  # fmt: skip
        self.offset = min(delays) if delays else float(np.min(log.arrived(next(iter(log.counts)))))

    def of(self, name: str) -> FloatArray:
        """(n,) of the messages of a kind [s]."""
        own = self._own(name)
        arrived = self.log.arrived(name) - self.offset
        if own is None:
            return arrived
        if name == "SERVO_OUTPUT_RAW":  # 32 bits of us
            return np.asarray(arrived + np.mod(own - arrived + 0.5 * _WRAP, _WRAP) - 0.5 * _WRAP)
        return own

    def _own(self, name: str) -> FloatArray | None:
        """(n,) what a message says itself; None: nothing, or a time of the day."""
        for part, unit in (("time_boot_ms", 1e-3), ("time_usec", 1e-6)):
            if self.log.has(name, part):
                t = self.log.numbers(name, part) * unit
                return t if np.all((t > 0.0) & (t < _LONGEST_ON)) else None
        return None


def _imus(log: Telemetry) -> dict[int, tuple[str, int | None]]:
    """The messages of each IMU by its number: name, and the identity that `HIGHRES_IMU` gives it."""
    found: dict[int, tuple[str, int | None]] = {}
    if "HIGHRES_IMU" in log:
        identities = np.unique(log.numbers("HIGHRES_IMU", "id")).astype(int).tolist()
        found = {k: ("HIGHRES_IMU", identity) for k, identity in enumerate(identities)}
    for name, number in _IMUS[1:]:
        if name in log:
            found.setdefault(number, (name, None))
    return found


def _of_imu(log: Telemetry, source: tuple[str, int | None]) -> BoolArray:
    name, identity = source
    return np.ones(log.counts[name], dtype=bool) if identity is None else log.numbers(name, "id") == identity


def _three(log: Telemetry, name: str, end: str, unit: float) -> FloatArray:
    """(n, 3) the fields of three axes."""
    return np.stack([log.numbers(name, f"{axis}{end}") for axis in "xyz"], axis=-1) * unit


def _imu(log: Telemetry, clock: _Clock, number: int, notes: list[str]) -> Stream | None:
    sources = _imus(log)
    if number not in sources:
        if number:
            not_there(log.path, "imu", number, sorted(sources))
        return None
    name, _ = sources[number]
    fine = name == "HIGHRES_IMU"
    force = _three(log, name, "acc", 1.0 if fine else _MILLI * STANDARD_GRAVITY)
    rate = _three(log, name, "gyro", 1.0 if fine else _MILLI)
    columns = dict(zip((*ACCEL, *GYRO), np.hstack([force, rate]).T, strict=True))
    warm = log.numbers(name, "temperature") * (1.0 if fine else _CENTI)
    if np.any(warm):  # zero: not told
        columns["temperature"] = warm
    if not fine:
        notes.append(f"imu: {name}, rounded to 1 mg and 1 mrad/s")
    return Stream(clock.of(name), columns).rows(_of_imu(log, sources[number]))


def _mags(log: Telemetry) -> dict[int, tuple[str, int | None]]:
    """The messages of each magnetometer: those of the IMUs that hold a field."""
    return {
        number: source for number, source in _imus(log).items()
        if np.any(_three(log, source[0], "mag", 1.0)[_of_imu(log, source)])
    }  # fmt: skip


def _mag(log: Telemetry, clock: _Clock, number: int) -> Stream | None:
    sources = _mags(log)
    if number not in sources:
        if number:
            not_there(log.path, "mag", number, sorted(sources))
        return None
    name, _ = sources[number]
    gauss = _three(log, name, "mag", 1.0 if name == "HIGHRES_IMU" else _MILLI)
    new = _of_imu(log, sources[number]) & _updated(log, name, _NEW_MAG)
    return Stream(clock.of(name), dict(zip(MAG, gauss.T, strict=True))).rows(new)


def _updated(log: Telemetry, name: str, bits: int) -> BoolArray:
    """(n,) whether a message says that some of its fields are new; all, where none says so."""
    if name != "HIGHRES_IMU":
        return np.ones(log.counts[name], dtype=bool)
    new = (log.numbers(name, "fields_updated").astype(np.int64) & bits) != 0
    return new if np.any(new) else ~new


def _baro(log: Telemetry, clock: _Clock, number: int) -> Stream | None:
    there = [k for k, name in enumerate(_PRESSURES) if name in log]
    if number in there:
        name = _PRESSURES[number]
        columns = {"pressure": log.numbers(name, "press_abs") * _HECTO,
                   "temperature": log.numbers(name, "temperature") * _CENTI}  # fmt: skip
        return Stream(clock.of(name), columns)
    if number:
        not_there(log.path, "baro", number, there)
    if "HIGHRES_IMU" not in log or not np.any(log.numbers("HIGHRES_IMU", "abs_pressure")):
        return None
    columns = {"pressure": log.numbers("HIGHRES_IMU", "abs_pressure") * _HECTO}
    return Stream(clock.of("HIGHRES_IMU"), columns).rows(_updated(log, "HIGHRES_IMU", _NEW_PRESSURE))


def _gps(log: Telemetry, clock: _Clock, number: int, notes: list[str]) -> Stream | None:
    """Fixes in three dimensions, with what the receiver says of them where it says it throughout."""
    there = [k for k, name in enumerate(_RECEIVERS) if name in log]
    if number not in there:
        if number:
            not_there(log.path, "gps", number, there)
        return None
    name = _RECEIVERS[number]
    fixed = log.numbers(name, "fix_type") >= _GOOD_FIX
    height = log.numbers(name, "alt_ellipsoid")
    if not np.all(height[fixed]):  # zero: not told
        height = log.numbers(name, "alt")
        notes.append("gps: heights above the sea stand for those above the ellipsoid")
    lla = log.numbers(name, "lat") * 1e-7, log.numbers(name, "lon") * 1e-7, height * _MILLI
    columns = dict(zip(GEODETIC, lla, strict=True))
    said = {
        "eph": ("h_acc", _MILLI, 0.0), "epv": ("v_acc", _MILLI, 0.0), "s_variance": ("vel_acc", _MILLI, 0.0),
        "hdop": ("eph", _CENTI, _UNKNOWN_16), "vdop": ("epv", _CENTI, _UNKNOWN_16),
        "satellites": ("satellites_visible", 1.0, 255),
    }  # fmt: skip
    for column, (part, unit, unknown) in said.items():
        values = log.numbers(name, part)
        if np.all(values[fixed] != unknown):
            columns[column] = values * unit
    return Stream(clock.of(name), columns).rows(fixed)


def _range(log: Telemetry, clock: _Clock, kind: int) -> Stream | None:
    """Downward ranges of one kind of sensor within its own limits."""
    if "DISTANCE_SENSOR" not in log:
        return None
    near, far, now, made, facing = (
        log.numbers("DISTANCE_SENSOR", part)
        for part in ("min_distance", "max_distance", "current_distance", "type", "orientation")
    )
    keep = (made == kind) & (facing == _DOWN) & (now > near) & (now < far)
    return Stream(clock.of("DISTANCE_SENSOR"), {"range": now * _CENTI}).rows(keep) if np.any(keep) else None


def _power(log: Telemetry, clock: _Clock) -> Stream | None:
    """Current and voltage of the first battery, and those of further ones beside them."""
    found = []
    if "BATTERY_STATUS" in log:
        identity, t = log.numbers("BATTERY_STATUS", "id"), clock.of("BATTERY_STATUS")
        cells = log.numbers("BATTERY_STATUS", "voltages")
        voltage = np.sum(np.where(cells == _UNKNOWN_16, 0.0, cells), axis=1) * _MILLI
        current = log.numbers("BATTERY_STATUS", "current_battery") * _CENTI
        for one in np.unique(identity):
            found.append(_supply(t, current, voltage, identity == one))
    elif "SYS_STATUS" in log:
        voltage = log.numbers("SYS_STATUS", "voltage_battery") * _MILLI
        current = log.numbers("SYS_STATUS", "current_battery") * _CENTI
        found.append(_supply(clock.of("SYS_STATUS"), current, voltage, np.ones(len(voltage), dtype=bool)))
    return beside([stream for stream in found if stream is not None])


def _supply(t: FloatArray, current: FloatArray, voltage: FloatArray, mine: BoolArray) -> Stream | None:
    """One battery; -1 is no current, 0 no voltage."""
    columns = {"current": current[mine]} if np.all(current[mine] >= 0.0) else {}
    columns |= {"voltage": voltage[mine]} if np.all(voltage[mine] > 0.0) else {}
    return Stream(t[mine], columns) if columns else None


def _motors(log: Telemetry, clock: _Clock, notes: list[str]) -> Stream | None:
    if "SERVO_OUTPUT_RAW" not in log:
        return None
    parameters = _parameters(log)
    outputs = motor_outputs(parameters, 16)
    if not outputs:
        notes.append("motors: no parameter SERVOn_FUNCTION says which output drives one, left out")
        return None
    first = log.numbers("SERVO_OUTPUT_RAW", "port") == 0
    pulses = [log.numbers("SERVO_OUTPUT_RAW", f"servo{k}_raw")[first] for k in outputs]
    return motor_stream(clock.of("SERVO_OUTPUT_RAW")[first], pulses, parameters)


def _attitude(log: Telemetry, clock: _Clock) -> Stream | None:
    if "ATTITUDE_QUATERNION" in log:
        columns = {name: log.numbers("ATTITUDE_QUATERNION", f"q{k}") for k, name in enumerate(QUATERNION, 1)}
        return Stream(clock.of("ATTITUDE_QUATERNION"), columns)
    if "ATTITUDE" not in log:
        return None
    rpy = np.stack([log.numbers("ATTITUDE", part) for part in ("roll", "pitch", "yaw")], axis=-1)
    return Stream(clock.of("ATTITUDE"), dict(zip(QUATERNION, quaternion_from_rpy(rpy).T, strict=True)))
