"""What a trace found, in ArduPilot's parameters.

Sources: ArduPilot 4.5, `AP_Compass_Backend::correct_field` (field = D s (R raw + OFS) + MOT I, in mGauss),
`AP_InertialSensor_Backend` (f = R (raw - OFFS) SCAL), `AP_InertialSensor_tempcal` (coefficients times 1e6),
`AP_Baro_Wind`, `AP_NavEKF3`, and the parameters' own documentation.
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
    turn_then_stretch,
    undoing,
)
from sinan.experiments.autopilots.findings import Findings
from sinan.experiments.autopilots.orientations import rotation_of, to_degrees
from sinan.experiments.autopilots.parameter_set import ParameterSet
from sinan.sensors.arrays import FloatArray

_THROTTLE, _CURRENT = 1, 2  # COMPASS_MOTCT
_CUSTOM_1 = 101  # COMPASS_ORIENT: CUST_ROT1_*
MILLIGAUSS = 1000.0
_TEMPERATURE_SCALE = 1e6  # of INS_TCALn_*
_MOST_DELAY = 250.0  # ms
_MOST_PRESSURE = 1.0  # BARO1_WCF_*
_DOWN = 25  # RNGFNDn_ORIENT
_MOST_RANGES = 10


def ardupilot_params(found: Findings, parameters: Mapping[str, float], log: Path | None = None) -> ParameterSet:
    """The parameters that take out what was found.

    Parameters
    ----------
    parameters : of the log
    log : which tells the number of the compass that was read; None: the first
    """
    params = ParameterSet("ardupilot", parameters)
    _mag(found, params, compass_number(found, params, log))
    _imu(found, params)
    _estimator(found, params)
    return params


def compass_number(found: Findings, params: ParameterSet, log: Path | None) -> str:
    """The number in the parameters of the compass that was read: nothing, 2 or 3."""
    from sinan.sensors.formats import what_is
    from sinan.sensors.formats.ardupilot import compass_of
    from sinan.sensors.formats.dataflash_messages import read_messages

    if log is None or not what_is(log).startswith("dataflash"):
        return ("", "2", "3")[min(found.choice.mag, 2)]
    return compass_of(read_messages(log), params.parameters, found.choice.mag)


def _mag(found: Findings, params: ParameterSet, k: str) -> None:
    """D, MOT and the turn of a compass. With A what takes out scale, soft iron and turn, k_I the field an ampere:
    A (D s (R raw + OFS) + MOT I - k_I I) = P s (Q R raw + Q OFS) + A (MOT - k_I) I,  P Q = A D.
    Where nothing can be turned, A D = Q P, and Q^T turns all of it: P s (R raw + OFS) + Q^T A (MOT - k_I) I.
    """
    effects = found.named(*SOFT_IRON, TURN)
    if not (effects or CURRENT in found.effects):
        return
    mounted = _mounting(params, k)
    turned = TURN in effects and mounted is not None and not found.choice.raw
    if TURN in effects and not turned:
        why = "it is the board's own compass, or its mounting is not known: no parameter turns it alone"
        params.refuse(TURN, "the readings are those before ArduPilot's correction" if found.choice.raw else why)
        effects = found.named(*SOFT_IRON)
    A, scale = undoing(found, turned), params.get(f"COMPASS_SCALE{k}") or 1.0
    D = np.eye(3) / scale if found.choice.raw else _soft_iron(params, k)
    P, Q = turn_then_stretch(A @ D)
    if not turned:
        Q, P = stretch_then_turn(A @ D)
        A = Q.T @ A
    if effects:
        _put_matrix(params, k, P, effects)
    if turned and mounted is not None:
        _put_turn(params, k, Q, mounted, effects)
    _put_current(found, params, k, A, effects)


def _mounting(params: ParameterSet, k: str) -> FloatArray | None:
    """(3, 3) R of an external compass that parameters can turn; None: there is none."""
    if not params.get("COMPASS_EXTERNAL" if k == "" else f"COMPASS_EXTERN{k}", 0.0 if params.parameters else 1.0):
        return None
    return rotation_of(params.get(f"COMPASS_ORIENT{k}"))


def _put_matrix(params: ParameterSet, k: str, P: FloatArray, effects: tuple[str, ...]) -> None:
    params.put_three(f"COMPASS_DIA{k}_{{}}", np.diag(P), *effects)
    params.put_three(f"COMPASS_ODI{k}_{{}}", (P[0, 1], P[0, 2], P[1, 2]), *effects)


def _put_turn(params: ParameterSet, k: str, Q: FloatArray, mounted: FloatArray, effects: tuple[str, ...]) -> None:
    """A compass that is mounted turned by Q R, and its offsets, which are about the body's axes."""
    params.put_three(f"COMPASS_OFS{k}_{{}}", Q @ params.three(f"COMPASS_OFS{k}_{{}}"), *effects)
    params.put(f"COMPASS_ORIENT{k}", _CUSTOM_1, *effects, whole=True)
    params.put("CUST_ROT_ENABLE", 1, *effects, whole=True)
    for angle, value in zip(("ROLL", "PITCH", "YAW"), to_degrees(Q @ mounted), strict=True):
        params.put(f"CUST_ROT1_{angle}", value, *effects)
    params.notes.append("CUST_ROT1_* need ArduPilot 4.2 or newer: load the file, restart, and load it again")


def _soft_iron(params: ParameterSet, k: str) -> FloatArray:
    """(3, 3) D of the log; ArduPilot takes none where its diagonal is zero."""
    diagonal = params.three(f"COMPASS_DIA{k}_{{}}")
    if not np.any(diagonal):
        return np.eye(3)
    x, y, z = params.three(f"COMPASS_ODI{k}_{{}}")
    return np.asarray(np.diag(diagonal) + np.array([[0.0, x, y], [x, 0.0, z], [y, z, 0.0]]))


def _put_current(found: Findings, params: ParameterSet, k: str, A: FloatArray, effects: tuple[str, ...]) -> None:
    """MOT of a compass [mGauss/A]; what is in use already goes through A with the rest."""
    kind, form = params.get("COMPASS_MOTCT"), f"COMPASS_MOT{k}_{{}}"
    used = kind > 0.0 and not found.choice.raw
    before = params.three(form) if used else np.zeros(3)
    known = current_known(found, params)
    if known and kind == _THROTTLE and np.any(before):
        params.refuse(CURRENT, "COMPASS_MOTCT 1 takes off what goes with throttle: set it to 0, fly, trace again")
        known = False
    if not known:
        if np.any(before) and effects:
            params.put_three(form, A @ before, *effects)
        return
    params.put("COMPASS_MOTCT", _CURRENT, CURRENT, whole=True)
    params.put_three(form, A @ (before - MILLIGAUSS * found.effects[CURRENT]), CURRENT, *effects)
    for other in ("", "2", "3"):
        if kind != _CURRENT and other != k and np.any(params.three(f"COMPASS_MOT{other}_{{}}")):
            params.put_three(f"COMPASS_MOT{other}_{{}}", np.zeros(3), CURRENT)


def _imu(found: Findings, params: ParameterSet) -> None:
    """Scale factors of the accelerometer, zeros over temperature."""
    effects = found.named("accel.scale", "accel.temperature", "gyro.temperature")
    C = rotation_of(params.get("AHRS_ORIENTATION"))
    if C is None:
        for effect in effects:
            why = f"the board is mounted in a way that is not known here ({params.get('AHRS_ORIENTATION'):g})"
            params.refuse(effect, why)
        return
    k = found.choice.imu
    form = f"INS_ACC{k + 1 if k else ''}SCAL_{{}}"
    before = np.where(params.three(form, 1.0) == 0.0, 1.0, params.three(form, 1.0))
    if "accel.scale" in effects:
        new = axis_factors(found, C)
        if new is None:
            params.refuse("accel.scale", "the chip's axes are not those of the body, and scale factors are along them")
        else:
            params.put_three(form, new * (1.0 if found.choice.raw else before), "accel.scale")
    for sensor, kind, scale in (("accel", "ACC", before), ("gyro", "GYR", np.ones(3))):
        if f"{sensor}.temperature" in effects:
            slope = C.T @ found.effects[f"{sensor}.temperature"]
            _put_temperature(found, params, sensor, kind, slope / (1.0 if found.choice.raw else scale))


def _put_temperature(found: Findings, params: ParameterSet, sensor: str, kind: str, slope: FloatArray) -> None:
    """A zero that moves by `slope` a kelvin, between TMIN and TMAX; what is in use already stays beside it."""
    effect, tcal = f"{sensor}.temperature", f"INS_TCAL{found.choice.imu + 1}"
    if sensor not in found.temperatures:
        params.refuse(effect, "the chip's temperature is not known")
        return
    used = params.get(f"{tcal}_ENABLE") == 1.0
    least, most = found.temperatures[sensor]
    params.put(f"{tcal}_ENABLE", 1, effect, whole=True)
    params.put(f"{tcal}_TMIN", min(least, params.get(f"{tcal}_TMIN", least)) if used else least, effect)
    params.put(f"{tcal}_TMAX", max(most, params.get(f"{tcal}_TMAX", most)) if used else most, effect)
    form = f"{tcal}_{kind}1_{{}}"
    params.put_three(form, (params.three(form) if used else 0.0) + _TEMPERATURE_SCALE * slope, effect)


def _estimator(found: Findings, params: ParameterSet) -> None:
    """What the estimator and the barometer's driver correct."""
    n, k = found.choice.gps + 1, found.choice.imu + 1
    newer = f"GPS{n}_POS_X" in params.parameters or f"GPS_POS{n}_X" not in params.parameters
    antenna = f"GPS{n}_POS_{{}}" if newer else f"GPS_POS{n}_{{}}"
    imu, gps = places(found, params.three(f"INS_POS{k}_{{}}"), params.three(antenna))
    if imu is not None:
        params.put_three(f"INS_POS{k}_{{}}", imu, "accel.lever_arm")
    if gps is not None:
        params.put_three(antenna, gps, *found.named("gps.lever_arm", "accel.lever_arm"))
    late = f"GPS{n}_DELAY_MS" if newer else f"GPS_DELAY_MS{n if n > 1 else ''}"
    put_delay(params, found, "gps.latency", late, _MOST_DELAY, 1.0, whole=True)
    put_delay(params, found, "baro.time_offset", "EK3_HGT_DELAY", _MOST_DELAY, whole=True)
    _range_finder(found, params, params.get(f"INS_POS{k}_Z") if imu is None else float(imu[2]))
    _static_pressure(found, params)
    if "mag.declination" in found.effects:
        if found.declination is None:
            params.refuse("mag.declination", "the declination that the trace assumed is not known")
            return
        params.put("COMPASS_DEC", found.declination + found.effects["mag.declination"][0], "mag.declination")
        params.put("COMPASS_AUTODEC", 0, "mag.declination", whole=True)


def _range_finder(found: Findings, params: ParameterSet, imu_down: float) -> None:
    """Height in the body of the first range finder that looks down: range + POS_Z - INS_POS_Z."""
    from sinan.sensors.formats.ardupilot import ULTRASOUND

    for effect in found.named("laser.mount_offset", "sonar.mount_offset"):
        sounds = effect.startswith("sonar")
        own = [
            n
            for n in range(1, _MOST_RANGES + 1)
            if params.get(f"RNGFND{n}_TYPE") and params.get(f"RNGFND{n}_ORIENT", _DOWN) == _DOWN
            if (params.get(f"RNGFND{n}_TYPE") in ULTRASOUND) == sounds
        ]
        params.put(f"RNGFND{own[0] if own else 1}_POS_Z", imu_down - found.effects[effect][0], effect)


def _static_pressure(found: Findings, params: ParameterSet) -> None:
    """Coefficients of the pressure at a barometer's port; what is in use already is in the logged height."""
    if "baro.airspeed" not in found.effects:
        return
    group = f"BARO{found.choice.baro + 1}_WCF"
    used = params.get(f"{group}_ENABLE") == 1.0
    ways = ("FWD", "BCK", "RGT", "LFT", "UP", "DN")
    new = {way: pressure_coefficient(found) + used * params.get(f"{group}_{way}") for way in ways}
    if max(map(abs, new.values())) > _MOST_PRESSURE:
        params.refuse("baro.airspeed", f"{group}_FWD takes -1 to 1, and it is {new['FWD']:.2f}")
        return
    params.put(f"{group}_ENABLE", 1, "baro.airspeed", whole=True)
    for way, value in new.items():
        params.put(f"{group}_{way}", value, "baro.airspeed")
