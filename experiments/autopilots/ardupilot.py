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
from sinan.experiments.autopilots.terms import Terms
from sinan.sensors.arrays import FloatArray

_THROTTLE, _CURRENT = 1, 2  # COMPASS_MOTCT
_CUSTOM_1 = 101  # COMPASS_ORIENT: CUST_ROT1_*
MILLIGAUSS = 1000.0
_TEMPERATURE_SCALE = 1e6  # of INS_TCALn_*
_MOST_DELAY = 250.0  # ms
_MOST_PRESSURE = 1.0  # BARO1_WCF_*
_DOWN = 25  # RNGFNDn_ORIENT
_MOST_RANGES = 10


def ardupilot_terms(found: Findings, parameters: Mapping[str, float], log: Path | None = None) -> Terms:
    """The parameters that take out what was found.

    Parameters
    ----------
    parameters : of the log
    log : which tells the number of the compass that was read; None: the first
    """
    terms = Terms("ardupilot", parameters)
    _mag(found, terms, compass_number(found, terms, log))
    _imu(found, terms)
    _estimator(found, terms)
    return terms


def compass_number(found: Findings, terms: Terms, log: Path | None) -> str:
    """The number in the parameters of the compass that was read: nothing, 2 or 3."""
    from sinan.sensors.formats import what_is
    from sinan.sensors.formats.ardupilot import compass_of
    from sinan.sensors.formats.dataflash_messages import read_messages

    if log is None or not what_is(log).startswith("dataflash"):
        return ("", "2", "3")[min(found.choice.mag, 2)]
    return compass_of(read_messages(log), terms.parameters, found.choice.mag)


def _mag(found: Findings, terms: Terms, k: str) -> None:
    """D, MOT and the turn of a compass. With A what takes out scale, soft iron and turn, k_I the field an ampere:
    A (D s (R raw + OFS) + MOT I - k_I I) = P s (Q R raw + Q OFS) + A (MOT - k_I) I,  P Q = A D.
    Where nothing can be turned, A D = Q P, and Q^T turns all of it: P s (R raw + OFS) + Q^T A (MOT - k_I) I.
    """
    effects = found.named(*SOFT_IRON, TURN)
    if not (effects or CURRENT in found.effects):
        return
    mounted = _mounting(terms, k)
    turned = TURN in effects and mounted is not None and not found.choice.raw
    if TURN in effects and not turned:
        why = "it is the board's own compass, or its mounting is not known: no parameter turns it alone"
        terms.refuse(TURN, "the readings are those before ArduPilot's correction" if found.choice.raw else why)
        effects = found.named(*SOFT_IRON)
    A, scale = undoing(found, turned), terms.get(f"COMPASS_SCALE{k}") or 1.0
    D = np.eye(3) / scale if found.choice.raw else _soft_iron(terms, k)
    P, Q = turn_then_stretch(A @ D)
    if not turned:
        Q, P = stretch_then_turn(A @ D)
        A = Q.T @ A
    if effects:
        _put_matrix(terms, k, P, effects)
    if turned and mounted is not None:
        _put_turn(terms, k, Q, mounted, effects)
    _put_current(found, terms, k, A, effects)


def _mounting(terms: Terms, k: str) -> FloatArray | None:
    """(3, 3) R of an external compass that parameters can turn; None: there is none."""
    if not terms.get("COMPASS_EXTERNAL" if k == "" else f"COMPASS_EXTERN{k}", 0.0 if terms.parameters else 1.0):
        return None
    return rotation_of(terms.get(f"COMPASS_ORIENT{k}"))


def _put_matrix(terms: Terms, k: str, P: FloatArray, effects: tuple[str, ...]) -> None:
    terms.put_three(f"COMPASS_DIA{k}_{{}}", np.diag(P), *effects)
    terms.put_three(f"COMPASS_ODI{k}_{{}}", (P[0, 1], P[0, 2], P[1, 2]), *effects)


def _put_turn(terms: Terms, k: str, Q: FloatArray, mounted: FloatArray, effects: tuple[str, ...]) -> None:
    """A compass that is mounted turned by Q R, and its offsets, which are about the body's axes."""
    terms.put_three(f"COMPASS_OFS{k}_{{}}", Q @ terms.three(f"COMPASS_OFS{k}_{{}}"), *effects)
    terms.put(f"COMPASS_ORIENT{k}", _CUSTOM_1, *effects, whole=True)
    terms.put("CUST_ROT_ENABLE", 1, *effects, whole=True)
    for angle, value in zip(("ROLL", "PITCH", "YAW"), to_degrees(Q @ mounted), strict=True):
        terms.put(f"CUST_ROT1_{angle}", value, *effects)
    terms.notes.append("CUST_ROT1_* need ArduPilot 4.2 or newer: load the file, restart, and load it again")


def _soft_iron(terms: Terms, k: str) -> FloatArray:
    """(3, 3) D of the log; ArduPilot takes none where its diagonal is zero."""
    diagonal = terms.three(f"COMPASS_DIA{k}_{{}}")
    if not np.any(diagonal):
        return np.eye(3)
    x, y, z = terms.three(f"COMPASS_ODI{k}_{{}}")
    return np.asarray(np.diag(diagonal) + np.array([[0.0, x, y], [x, 0.0, z], [y, z, 0.0]]))


def _put_current(found: Findings, terms: Terms, k: str, A: FloatArray, effects: tuple[str, ...]) -> None:
    """MOT of a compass [mGauss/A]; what is in use already goes through A with the rest."""
    kind, form = terms.get("COMPASS_MOTCT"), f"COMPASS_MOT{k}_{{}}"
    used = kind > 0.0 and not found.choice.raw
    before = terms.three(form) if used else np.zeros(3)
    known = current_known(found, terms)
    if known and kind == _THROTTLE and np.any(before):
        terms.refuse(CURRENT, "COMPASS_MOTCT 1 takes off what goes with throttle: set it to 0, fly, trace again")
        known = False
    if not known:
        if np.any(before) and effects:
            terms.put_three(form, A @ before, *effects)
        return
    terms.put("COMPASS_MOTCT", _CURRENT, CURRENT, whole=True)
    terms.put_three(form, A @ (before - MILLIGAUSS * found.effects[CURRENT]), CURRENT, *effects)
    for other in ("", "2", "3"):
        if kind != _CURRENT and other != k and np.any(terms.three(f"COMPASS_MOT{other}_{{}}")):
            terms.put_three(f"COMPASS_MOT{other}_{{}}", np.zeros(3), CURRENT)


def _imu(found: Findings, terms: Terms) -> None:
    """Scale factors of the accelerometer, zeros over temperature."""
    effects = found.named("accel.scale", "accel.temperature", "gyro.temperature")
    C = rotation_of(terms.get("AHRS_ORIENTATION"))
    if C is None:
        for effect in effects:
            why = f"the board is mounted in a way that is not known here ({terms.get('AHRS_ORIENTATION'):g})"
            terms.refuse(effect, why)
        return
    k = found.choice.imu
    form = f"INS_ACC{k + 1 if k else ''}SCAL_{{}}"
    before = np.where(terms.three(form, 1.0) == 0.0, 1.0, terms.three(form, 1.0))
    if "accel.scale" in effects:
        new = axis_factors(found, C)
        if new is None:
            terms.refuse("accel.scale", "the chip's axes are not those of the body, and scale factors are along them")
        else:
            terms.put_three(form, new * (1.0 if found.choice.raw else before), "accel.scale")
    for sensor, kind, scale in (("accel", "ACC", before), ("gyro", "GYR", np.ones(3))):
        if f"{sensor}.temperature" in effects:
            slope = C.T @ found.effects[f"{sensor}.temperature"]
            _put_temperature(found, terms, sensor, kind, slope / (1.0 if found.choice.raw else scale))


def _put_temperature(found: Findings, terms: Terms, sensor: str, kind: str, slope: FloatArray) -> None:
    """A zero that moves by `slope` a kelvin, between TMIN and TMAX; what is in use already stays beside it."""
    effect, tcal = f"{sensor}.temperature", f"INS_TCAL{found.choice.imu + 1}"
    if sensor not in found.temperatures:
        terms.refuse(effect, "the chip's temperature is not known")
        return
    used = terms.get(f"{tcal}_ENABLE") == 1.0
    least, most = found.temperatures[sensor]
    terms.put(f"{tcal}_ENABLE", 1, effect, whole=True)
    terms.put(f"{tcal}_TMIN", min(least, terms.get(f"{tcal}_TMIN", least)) if used else least, effect)
    terms.put(f"{tcal}_TMAX", max(most, terms.get(f"{tcal}_TMAX", most)) if used else most, effect)
    form = f"{tcal}_{kind}1_{{}}"
    terms.put_three(form, (terms.three(form) if used else 0.0) + _TEMPERATURE_SCALE * slope, effect)


def _estimator(found: Findings, terms: Terms) -> None:
    """What the estimator and the barometer's driver correct."""
    n, k = found.choice.gps + 1, found.choice.imu + 1
    newer = f"GPS{n}_POS_X" in terms.parameters or f"GPS_POS{n}_X" not in terms.parameters
    antenna = f"GPS{n}_POS_{{}}" if newer else f"GPS_POS{n}_{{}}"
    imu, gps = places(found, terms.three(f"INS_POS{k}_{{}}"), terms.three(antenna))
    if imu is not None:
        terms.put_three(f"INS_POS{k}_{{}}", imu, "accel.lever_arm")
    if gps is not None:
        terms.put_three(antenna, gps, *found.named("gps.lever_arm", "accel.lever_arm"))
    late = f"GPS{n}_DELAY_MS" if newer else f"GPS_DELAY_MS{n if n > 1 else ''}"
    put_delay(terms, found, "gps.latency", late, _MOST_DELAY, 1.0, whole=True)
    put_delay(terms, found, "baro.time_offset", "EK3_HGT_DELAY", _MOST_DELAY, whole=True)
    _range_finder(found, terms, terms.get(f"INS_POS{k}_Z") if imu is None else float(imu[2]))
    _static_pressure(found, terms)
    if "mag.declination" in found.effects:
        if found.declination is None:
            terms.refuse("mag.declination", "the declination that the trace assumed is not known")
            return
        terms.put("COMPASS_DEC", found.declination + found.effects["mag.declination"][0], "mag.declination")
        terms.put("COMPASS_AUTODEC", 0, "mag.declination", whole=True)


def _range_finder(found: Findings, terms: Terms, imu_down: float) -> None:
    """Height in the body of the first range finder that looks down: range + POS_Z - INS_POS_Z."""
    from sinan.sensors.formats.ardupilot import ULTRASOUND

    for effect in found.named("laser.mount_offset", "sonar.mount_offset"):
        sounds = effect.startswith("sonar")
        own = [
            n
            for n in range(1, _MOST_RANGES + 1)
            if terms.get(f"RNGFND{n}_TYPE") and terms.get(f"RNGFND{n}_ORIENT", _DOWN) == _DOWN
            if (terms.get(f"RNGFND{n}_TYPE") in ULTRASOUND) == sounds
        ]
        terms.put(f"RNGFND{own[0] if own else 1}_POS_Z", imu_down - found.effects[effect][0], effect)


def _static_pressure(found: Findings, terms: Terms) -> None:
    """Coefficients of the pressure at a barometer's port; what is in use already is in the logged height."""
    if "baro.airspeed" not in found.effects:
        return
    group = f"BARO{found.choice.baro + 1}_WCF"
    used = terms.get(f"{group}_ENABLE") == 1.0
    ways = ("FWD", "BCK", "RGT", "LFT", "UP", "DN")
    new = {way: pressure_coefficient(found) + used * terms.get(f"{group}_{way}") for way in ways}
    if max(map(abs, new.values())) > _MOST_PRESSURE:
        terms.refuse("baro.airspeed", f"{group}_FWD takes -1 to 1, and it is {new['FWD']:.2f}")
        return
    terms.put(f"{group}_ENABLE", 1, "baro.airspeed", whole=True)
    for way, value in new.items():
        terms.put(f"{group}_{way}", value, "baro.airspeed")
