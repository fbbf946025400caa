"""What a trace found, in PX4's parameters.

Sources: PX4 1.14, `lib/sensor_calibration/` (`Magnetometer::Correct`: field = R S (raw + COMP p - OFF), p in kA;
`Accelerometer::Correct`: f = R (raw - thermal - OFF) SCALE; `Gyroscope::Correct`), `modules/temperature_compensation`,
`modules/ekf2` and its parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sinan.experiments.autopilots.corrections import (
    CURRENT,
    SOFT_IRON,
    TURN,
    axis_factors,
    current_known,
    places,
    pressure_coefficient,
    put_delay,
    stretch_then_turn,
    undoing,
)
from sinan.experiments.autopilots.findings import Findings
from sinan.experiments.autopilots.orientations import from_degrees, rotation_of, to_degrees
from sinan.experiments.autopilots.parameter_set import ParameterSet
from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import REFERENCE_TEMPERATURE

_MOST_SENSORS = 4
_CUSTOM, _INTERNAL = 100, -1  # CAL_MAGn_ROT
_THROTTLE, _CURRENT = 1, 2  # CAL_MAG_COMP_TYP
_LOOKED_UP = 1  # bit of EKF2_DECL_TYPE: declination by a table, not EKF2_MAG_DECL
_PER_KILOAMPERE = 1000.0
_MOST_DELAY = 300.0  # ms
_MOST_PRESSURE = 0.5  # EKF2_PCOEF_*
#: Which field of which topic names the chip that was read.
_CHIPS = {
    "MAG": ("vehicle_magnetometer.device_id", "vehicle_magnetometer#{}.device_id"),
    "ACC": ("sensor_selection.accel_device_id", "vehicle_imu#{}.accel_device_id"),
    "GYRO": ("sensor_selection.gyro_device_id", "vehicle_imu#{}.gyro_device_id"),
}


def px4_params(found: Findings, parameters: Mapping[str, float], log: Path | None = None) -> ParameterSet:
    """The parameters that take out what was found.

    Parameters
    ----------
    parameters : of the log
    log : which names the chips that were read; None: the first of each
    """
    params = ParameterSet("px4", parameters)
    chips = chips_of(found, params, log)
    _mag(found, params, chips["MAG"])
    _imu(found, params, chips)
    _estimator(found, params)
    return params


def chips_of(found: Findings, params: ParameterSet, log: Path | None) -> dict[str, int]:
    """Number in `CAL_MAGn`, `CAL_ACCn`, `CAL_GYROn` of each chip that was read, by its device's number."""
    from sinan.sensors.formats import what_is
    from sinan.sensors.formats.ulog_messages import read_topics

    topics = read_topics(log) if log is not None and what_is(log) == "ulog" else None
    numbers = {}
    for kind, (first, further) in _CHIPS.items():
        asked = found.choice.mag if kind == "MAG" else found.choice.imu
        column = first if asked == 0 else further.format(asked)
        ids = topics[column] if topics is not None and column in topics else np.empty(0)
        own = [k for k in range(_MOST_SENSORS) if len(ids) and params.get(f"CAL_{kind}{k}_ID", -1.0) == ids[-1]]
        numbers[kind] = own[0] if own else asked
    return numbers


def _board(params: ParameterSet) -> FloatArray | None:
    """(3, 3) board -> body."""
    C = rotation_of(params.get("SENS_BOARD_ROT"))
    return None if C is None else from_degrees(params.three("SENS_BOARD_{}_OFF")) @ C


def _mag(found: Findings, params: ParameterSet, k: int) -> None:
    """S, COMP and the turn of a compass. With R the mounting, A what takes out scale, soft iron and turn, k_I the
    field an ampere:  A (R S (raw + COMP p - OFF) - k_I I) = R Q P (raw + COMP' p - OFF),  Q P = R^T A R S,
    COMP' = COMP - 1000 S^-1 R^T k_I.
    """
    if not found.named(*SOFT_IRON, TURN, CURRENT):
        return
    cal, raw = f"CAL_MAG{k}", found.choice.raw
    mounting = params.get(f"{cal}_ROT", _INTERNAL if params.parameters else 0.0)
    if mounting == _CUSTOM:
        C = from_degrees(np.array([params.get(f"{cal}_{angle}") for angle in ("ROLL", "PITCH", "YAW")]))
    else:
        C = _board(params) if mounting == _INTERNAL else rotation_of(mounting)  # type: ignore[assignment]
    if raw:  # the chip's own readings, which nothing turned
        C = np.eye(3)
    if C is None:
        for effect in found.named(*SOFT_IRON, TURN, CURRENT):
            params.refuse(effect, f"the compass is mounted in a way that is not known here ({cal}_ROT {mounting:g})")
        return
    turned = TURN in found.effects and not raw and mounting != _INTERNAL
    if TURN in found.effects and not turned:
        inside = f"{cal}_ROT says that it turns with the board, so that no parameter turns it alone"
        params.refuse(TURN, "the readings are those before PX4's own mounting" if raw else inside)
    S = np.eye(3) if raw else _soft_iron(params, cal)
    _put_matrix(found, params, cal, C, S, turned)
    if current_known(found, params):
        _put_current(found, params, k, np.linalg.inv(S) @ C.T @ found.effects[CURRENT])


def _soft_iron(params: ParameterSet, cal: str) -> FloatArray:
    """(3, 3) S of the log."""
    S = np.diag(params.three(f"{cal}_{{}}SCALE", 1.0))
    x, y, z = params.three(f"{cal}_{{}}ODIAG")
    return np.asarray(S + np.array([[0.0, x, y], [x, 0.0, z], [y, z, 0.0]]))


def _put_matrix(found: Findings, params: ParameterSet, cal: str, C: FloatArray, S: FloatArray, turned: bool) -> None:
    effects = found.named(*SOFT_IRON, *((TURN,) if turned else ()))
    if not effects:
        return
    Q, P = stretch_then_turn(C.T @ undoing(found, turned) @ C @ S)
    params.put_three(f"{cal}_{{}}SCALE", np.diag(P), *effects)
    params.put_three(f"{cal}_{{}}ODIAG", (P[0, 1], P[0, 2], P[1, 2]), *effects)
    if turned:
        params.put(f"{cal}_ROT", _CUSTOM, *effects, whole=True)
        for angle, value in zip(("ROLL", "PITCH", "YAW"), to_degrees(C @ Q), strict=True):
            params.put(f"{cal}_{angle}", value, *effects)
        params.notes.append(f"{cal}_ROT {_CUSTOM} needs PX4 1.14 or newer")


def _put_current(found: Findings, params: ParameterSet, k: int, per_ampere: FloatArray) -> None:
    """COMP of a compass [gauss/kA]; those of others, if nothing used them until now, are set to zero."""
    kind = params.get("CAL_MAG_COMP_TYP")
    if kind == _THROTTLE and np.any(params.three(f"CAL_MAG{k}_{{}}COMP")):
        params.refuse(CURRENT, "CAL_MAG_COMP_TYP 1 takes off what goes with throttle: set it to 0, fly, trace again")
        return
    used = kind > _THROTTLE and not found.choice.raw
    before = params.three(f"CAL_MAG{k}_{{}}COMP") if used else np.zeros(3)
    params.put("CAL_MAG_COMP_TYP", max(kind, _CURRENT), CURRENT, whole=True)
    params.put_three(f"CAL_MAG{k}_{{}}COMP", before - _PER_KILOAMPERE * per_ampere, CURRENT)
    for other in range(_MOST_SENSORS):
        if kind < _CURRENT and other != k and np.any(params.three(f"CAL_MAG{other}_{{}}COMP")):
            params.put_three(f"CAL_MAG{other}_{{}}COMP", np.zeros(3), CURRENT)


def _imu(found: Findings, params: ParameterSet, chips: Mapping[str, int]) -> None:
    """Scale factors of the accelerometer, zeros over temperature."""
    effects = found.named("accel.scale", "accel.temperature", "gyro.temperature")
    C = np.eye(3) if found.choice.raw else _board(params)
    if C is None:
        for effect in effects:
            params.refuse(
                effect, f"the board is mounted in a way that is not known here ({params.get('SENS_BOARD_ROT')})"
            )
        return
    cal = f"CAL_ACC{chips['ACC']}"
    before = params.three(f"{cal}_{{}}SCALE", 1.0)
    if "accel.scale" in effects:
        new = axis_factors(found, C)
        if new is None:
            params.refuse("accel.scale", "the chip's axes are not those of the body, and scale factors are along them")
        else:
            params.put_three(f"{cal}_{{}}SCALE", new * (1.0 if found.choice.raw else before), "accel.scale")
    for sensor, kind, scale in (("accel", "A", before), ("gyro", "G", np.ones(3))):
        if f"{sensor}.temperature" in effects:
            slope = C.T @ found.effects[f"{sensor}.temperature"]
            _put_temperature(found, params, sensor, kind, slope / (1.0 if found.choice.raw else scale))


def _put_temperature(found: Findings, params: ParameterSet, sensor: str, kind: str, slope: FloatArray) -> None:
    """A zero that moves by `slope` a kelvin:  thermal offset = X0 + X1 (T - TREF) + ...,  T between TMIN and TMAX."""
    effect, number = f"{sensor}.temperature", 0
    device = params.get(f"CAL_{'ACC' if sensor == 'accel' else 'GYRO'}0_ID")
    name, on = f"TC_{kind}{number}", params.get(f"TC_{kind}_ENABLE") == 1.0
    if found.choice.imu or sensor not in found.temperatures:
        params.refuse(effect, "which chip's temperature it follows is not known")
        return
    before = on and not found.choice.raw
    reference = params.get(f"{name}_TREF", REFERENCE_TEMPERATURE) if before else REFERENCE_TEMPERATURE
    least, most = found.temperatures[sensor]
    params.put(f"TC_{kind}_ENABLE", 1, effect, whole=True)
    if device:
        params.put(f"{name}_ID", device, effect, whole=True)
    params.put(f"{name}_TREF", reference, effect)
    params.put(f"{name}_TMIN", min(least, params.get(f"{name}_TMIN", least)) if before else least, effect)
    params.put(f"{name}_TMAX", max(most, params.get(f"{name}_TMAX", most)) if before else most, effect)
    for axis in range(3):
        for order, more in ((0, slope[axis] * (reference - REFERENCE_TEMPERATURE)), (1, slope[axis])):
            own = f"{name}_X{order}_{axis}"
            params.put(own, (params.get(own) if before else 0.0) + more, effect)


def _estimator(found: Findings, params: ParameterSet) -> None:
    """What the estimator corrects, which no logged reading has in it."""
    antenna = "SENS_GPS0_OFF{}" if "SENS_GPS0_OFFX" in params.parameters else "EKF2_GPS_POS_{}"
    imu, gps = places(found, params.three("EKF2_IMU_POS_{}"), params.three(antenna))
    if imu is not None:
        params.put_three("EKF2_IMU_POS_{}", imu, "accel.lever_arm")
    if gps is not None:
        params.put_three(antenna, gps, *found.named("gps.lever_arm", "accel.lever_arm"))
    for effect, name in (
        ("gps.latency", "EKF2_GPS_DELAY"),
        ("mag.time_offset", "EKF2_MAG_DELAY"),
        ("baro.time_offset", "EKF2_BARO_DELAY"),
        ("laser.time_offset", "EKF2_RNG_DELAY"),
        ("sonar.time_offset", "EKF2_RNG_DELAY"),
    ):
        put_delay(params, found, effect, name, _MOST_DELAY)
    _range_finder(found, params, params.get("EKF2_IMU_POS_Z") if imu is None else float(imu[2]))
    if "baro.airspeed" in found.effects:
        K = pressure_coefficient(found)
        if abs(K) > _MOST_PRESSURE:
            params.refuse("baro.airspeed", f"EKF2_PCOEF_XP takes -0.5 to 0.5, and it is {K:.2f}")
        else:
            for way in ("XP", "XN", "YP", "YN", "Z"):
                params.put(f"EKF2_PCOEF_{way}", K, "baro.airspeed")
    if "mag.declination" in found.effects:
        if found.declination is None:
            params.refuse("mag.declination", "the declination that the trace assumed is not known")
            return
        east = np.degrees(found.declination + found.effects["mag.declination"][0])
        params.put("EKF2_MAG_DECL", east, "mag.declination")
        kind = int(params.get("EKF2_DECL_TYPE", 7.0))
        params.put("EKF2_DECL_TYPE", kind & ~_LOOKED_UP, "mag.declination", whole=True)


def _range_finder(found: Findings, params: ParameterSet, imu_down: float) -> None:
    """Height of the range finder in the body, and the pitch of its beam: range + POS_Z - IMU_POS_Z, Ry(PITCH) down."""
    for effect in found.named("laser.mount_offset", "sonar.mount_offset")[:1]:
        params.put("EKF2_RNG_POS_Z", imu_down - found.effects[effect][0], effect)
    if "laser.boresight" in found.effects:
        params.put("EKF2_RNG_PITCH", found.effects["laser.boresight"][1], "laser.boresight")
        params.notes.append("laser.boresight: its pitch alone; PX4 has no parameter for the roll of the beam")
