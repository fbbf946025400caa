"""A calibration of what an autopilot sends, in the autopilot's own parameters.

What it sends it has corrected already, with the parameters that it has now; those that are printed do both at once.
With R the mounting (chip -> body) and u = M (r + b) what the calibration makes of a sent reading r:

ArduPilot   accelerometer  r = R ((raw - OFFS) SCAL)               field  r = D s (R raw + OFS) + MOT I
PX4         accelerometer  r = R ((raw - thermal - OFF) SCALE)     field  r = R S (raw + COMP p - OFF)

A field is known but for a turn of all of it (calibration by norm), so that a symmetric matrix can always be written:
M D = Q P, and Q' takes the turn off. Sources: `ardupilot.py` and `px4.py` of this folder.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sinan.calibration.poses.triad import Calibration
from sinan.experiments.autopilots.ardupilot import MILLIGAUSS, compass_number
from sinan.experiments.autopilots.corrections import stretch_then_turn
from sinan.experiments.autopilots.findings import Findings
from sinan.experiments.autopilots.orientations import from_degrees, rotation_of
from sinan.experiments.autopilots.parameter_set import AXES, ParameterSet
from sinan.experiments.autopilots.parameters import autopilot_of, facts_of_log
from sinan.experiments.autopilots.px4 import chips_of
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import Choice

#: Where a calibration is named in place of an effect.
LABEL = {"accel": "accelerometer calibration", "mag": "compass calibration"}
_BOARD, _CUSTOM = -1, 100  # CAL_MAGn_ROT
_SMALL = 1e-6


def parameter_names(autopilot: str, sensor: str, number: int = 0) -> tuple[str, ...]:
    """The parameters that what an autopilot sends depends on.

    Parameters
    ----------
    number : of the sensor, from 0
    """
    forms = {
        ("ardupilot", "accel"): ("INS_ACC{}OFFS_{{}}", "INS_ACC{}SCAL_{{}}"),
        ("ardupilot", "mag"): ("COMPASS_OFS{}_{{}}", "COMPASS_DIA{}_{{}}", "COMPASS_ODI{}_{{}}", "COMPASS_MOT{}_{{}}"),
        ("px4", "accel"): ("CAL_ACC{}_{{}}OFF", "CAL_ACC{}_{{}}SCALE", "SENS_BOARD_{{}}_OFF"),
        ("px4", "mag"): ("CAL_MAG{}_{{}}OFF", "CAL_MAG{}_{{}}SCALE", "CAL_MAG{}_{{}}ODIAG", "SENS_BOARD_{{}}_OFF"),
    }[autopilot, sensor]
    k = _number(autopilot, number)
    ones = {
        ("ardupilot", "accel"): ("AHRS_ORIENTATION",), ("ardupilot", "mag"): (f"COMPASS_SCALE{k}", "COMPASS_MOTCT"),
        ("px4", "accel"): ("SENS_BOARD_ROT",),
        ("px4", "mag"): ("SENS_BOARD_ROT", *(f"CAL_MAG{k}_{end}" for end in ("ROT", "ROLL", "PITCH", "YAW"))),
    }[autopilot, sensor]  # fmt: skip
    return (*(form.format(k).format(axis) for form in forms for axis in AXES), *ones)


def calibration_params(
    autopilot: str, sensor: str, result: Calibration, parameters: Mapping[str, float], number: int = 0
) -> ParameterSet:
    """The parameters with which the autopilot's readings are calibrated.

    Parameters
    ----------
    autopilot : "ardupilot" or "px4"
    sensor : "accel", readings in m/s^2, or "mag", in gauss
    result : of what the autopilot sent while it had `parameters`
    number : of the sensor, from 0

    Raises
    ------
    InputError : the board is mounted in a way that is not known here, or its axes lie across the chip's
    """
    params = ParameterSet(autopilot, parameters)
    missing = [name for name in parameter_names(autopilot, sensor, number) if name not in parameters]
    if missing:
        params.notes.append(f"not told by the autopilot, taken at their defaults: {', '.join(missing)}")
    M = result.T_seen * result.K
    b = result.offset * result.normalised_by
    k = _number(autopilot, number)
    put = {("ardupilot", "accel"): _ardupilot_accel, ("ardupilot", "mag"): _ardupilot_mag,
           ("px4", "accel"): _px4_accel, ("px4", "mag"): _px4_mag}[autopilot, sensor]  # fmt: skip
    put(params, k, M, b)
    return params


def params_of_log(sensor: str, result: Calibration, log: Path, choice: Choice) -> ParameterSet | None:
    """The same for a log of an autopilot, which tells them; None: no autopilot's log, or readings without corrections.

    Raises
    ------
    InputError : as `calibration_params`
    """
    facts = facts_of_log(log)
    name = autopilot_of(facts)
    if facts is None or not name or choice.raw:
        return None
    found, params = Findings({}, choice=choice), ParameterSet(name, facts.parameters)
    number = choice.mag if sensor == "mag" else choice.imu
    if name == "px4":
        number = chips_of(found, params, log)["MAG" if sensor == "mag" else "ACC"]
    elif sensor == "mag":
        number = int(compass_number(found, params, log) or "1") - 1
    return calibration_params(name, sensor, result, facts.parameters, number)


def _number(autopilot: str, number: int) -> str:
    """How a sensor is numbered in names: PX4 0, 1, ...; ArduPilot nothing, 2, 3."""
    return str(number) if autopilot == "px4" else ("", "2", "3")[number]


def _axis_factors(M: FloatArray, C: FloatArray | None, who: str) -> FloatArray:
    """(3,) of the chip's axes, of a matrix about the body's.

    Raises
    ------
    InputError : there are none
    """
    if C is None:
        raise InputError(who, "a board that is mounted in a way that is not known here", "one of the known rotations")
    chip = C.T @ M @ C
    if np.max(np.abs(chip - np.diag(np.diag(chip)))) > _SMALL:
        raise InputError(who, "axes that are not at right angles, or across the chip's", "`--axes none`: parameters "
                         "of an accelerometer are a scale and an offset of each axis of the chip")  # fmt: skip
    return np.diag(chip).copy()


def _ardupilot_accel(params: ParameterSet, k: str, M: FloatArray, b: FloatArray) -> None:
    C = rotation_of(params.get("AHRS_ORIENTATION"))
    _put_accel(params, M, b, C, f"INS_ACC{k}OFFS_{{}}", f"INS_ACC{k}SCAL_{{}}", "AHRS_ORIENTATION")


def _px4_accel(params: ParameterSet, k: str, M: FloatArray, b: FloatArray) -> None:
    C = _px4_board(params)
    _put_accel(params, M, b, C, f"CAL_ACC{k}_{{}}OFF", f"CAL_ACC{k}_{{}}SCALE", "SENS_BOARD_ROT")


def _put_accel(
    params: ParameterSet, M: FloatArray, b: FloatArray, C: FloatArray | None, off: str, scale: str, who: str
) -> None:
    """K ((raw - OFF) S + b) = K S (raw - (OFF - b / S)), all of the chip's axes."""
    factors = _axis_factors(M, C, who)
    assert C is not None
    before = params.three(scale, 1.0)
    before = np.where(before == 0.0, 1.0, before)
    params.put_three(scale, factors * before, LABEL["accel"])
    params.put_three(off, params.three(off) - C.T @ b / before, LABEL["accel"])


def _px4_board(params: ParameterSet) -> FloatArray | None:
    C = rotation_of(params.get("SENS_BOARD_ROT"))
    return None if C is None else from_degrees(params.three("SENS_BOARD_{}_OFF")) @ C


def _ardupilot_mag(params: ParameterSet, k: str, M: FloatArray, b: FloatArray) -> None:
    """M (D s (R raw + OFS) + MOT I + b) = Q (P s (R raw + OFS + (D s)^-1 b) + Q' M MOT I),  Q P = M D."""
    dia, odi = f"COMPASS_DIA{k}_{{}}", f"COMPASS_ODI{k}_{{}}"
    scale = params.get(f"COMPASS_SCALE{k}") or 1.0
    D = _symmetric(params.three(dia), params.three(odi)) if np.any(params.three(dia)) else np.eye(3)
    Q, P = stretch_then_turn(M @ D)
    ofs, mot = f"COMPASS_OFS{k}_{{}}", f"COMPASS_MOT{k}_{{}}"
    params.put_three(ofs, params.three(ofs) + np.linalg.solve(D * scale, MILLIGAUSS * b), LABEL["mag"])
    _put_matrix(params, dia, odi, P)
    if params.get("COMPASS_MOTCT") and np.any(params.three(mot)):
        params.put_three(mot, Q.T @ M @ params.three(mot), LABEL["mag"])


def _px4_mag(params: ParameterSet, k: str, M: FloatArray, b: FloatArray) -> None:
    """M (R S (raw + COMP p - OFF) + b) = R Q P (raw + COMP p - (OFF - S^-1 R' b)),  Q P = R' M R S."""
    cal = f"CAL_MAG{k}"
    mounting = params.get(f"{cal}_ROT", float(_BOARD))
    if mounting == _CUSTOM:
        R: FloatArray | None = from_degrees(np.array([params.get(f"{cal}_{a}") for a in ("ROLL", "PITCH", "YAW")]))
    else:
        R = _px4_board(params) if mounting == _BOARD else rotation_of(mounting)
    if R is None:
        raise InputError(f"{cal}_ROT", f"{mounting:g}, which is not known here", "one of the known rotations")
    S = _symmetric(params.three(f"{cal}_{{}}SCALE", 1.0), params.three(f"{cal}_{{}}ODIAG"))
    _, P = stretch_then_turn(R.T @ M @ R @ S)
    params.put_three(f"{cal}_{{}}OFF", params.three(f"{cal}_{{}}OFF") - np.linalg.solve(S, R.T @ b), LABEL["mag"])
    _put_matrix(params, f"{cal}_{{}}SCALE", f"{cal}_{{}}ODIAG", P)


def _put_matrix(params: ParameterSet, diagonal: str, off: str, P: FloatArray) -> None:
    params.put_three(diagonal, np.diag(P), LABEL["mag"])
    if np.max(np.abs(P - np.diag(np.diag(P)))) > _SMALL or np.any(params.three(off)):
        params.put_three(off, (P[0, 1], P[0, 2], P[1, 2]), LABEL["mag"])


def _symmetric(diagonal: FloatArray, off: FloatArray) -> FloatArray:
    """(3, 3) of its diagonal, and of xy, xz, yz."""
    x, y, z = off
    return np.asarray(np.diag(diagonal) + np.array([[0.0, x, y], [x, 0.0, z], [y, z, 0.0]]))
