"""What both autopilots' corrections have in common: a field's matrix, an axis' scale factor, places and delays."""

from __future__ import annotations

import numpy as np

from sinan.experiments.autopilots.findings import Findings
from sinan.experiments.autopilots.parameter_set import ParameterSet
from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import STANDARD_GRAVITY
from sinan.sensors.rotation import rotation_exp

#: Effects on the field that a symmetric matrix takes out; with them a turn.
SOFT_IRON = ("mag.scale", "mag.cross_axis")
TURN = "mag.misalignment"
CURRENT = "mag.current"


def undoing(found: Findings, turned: bool) -> FloatArray:
    """(3, 3) A = (Exp(-b) + M)^-1: the field without its scale, soft iron and, where `turned`, its turn."""
    N = rotation_exp(-found.effects[TURN]) if turned else np.eye(3)
    N = N + np.diag(found.effects.get("mag.scale", np.zeros(3)))
    xy, xz, yz = found.effects.get("mag.cross_axis", np.zeros(3))
    return np.asarray(np.linalg.inv(N + np.array([[0.0, xy, xz], [xy, 0.0, yz], [xz, yz, 0.0]])))


def turn_then_stretch(X: FloatArray) -> tuple[FloatArray, FloatArray]:
    """X = P Q: a symmetric matrix and a rotation (polar decomposition)."""
    U, s, Vt = np.linalg.svd(X)
    return U * s @ U.T, U @ Vt


def stretch_then_turn(X: FloatArray) -> tuple[FloatArray, FloatArray]:
    """X = Q P: a rotation and a symmetric matrix."""
    U, s, Vt = np.linalg.svd(X)
    return U @ Vt, (Vt.T * s) @ Vt


def axis_factors(found: Findings, C: FloatArray) -> FloatArray | None:
    """(3,) what takes out accel.scale, along a chip's axes, C: chip -> body; None: it lies across those axes."""
    A = C.T @ np.diag(1.0 / (1.0 + found.effects["accel.scale"])) @ C
    across = A - np.diag(np.diag(A))
    return None if np.max(np.abs(across)) > 1e-9 else np.diag(A).copy()


def current_known(found: Findings, params: ParameterSet) -> bool:
    """Whether mag.current is of one battery's current; else it is refused."""
    if CURRENT not in found.effects:
        return False
    if found.batteries == 1:
        return True
    why = "it was found of the motors' commands, which are not the throttle that the autopilot multiplies by"
    several = "the autopilot multiplies by one battery's current, and there are several"
    params.refuse(CURRENT, several if found.batteries else why)
    return False


def pressure_coefficient(found: Findings) -> float:
    """Static pressure's error over dynamic pressure: height += b V^2 is -K V^2 / (2 g)."""
    return float(-2.0 * STANDARD_GRAVITY * found.effects["baro.airspeed"][0])


def places(found: Findings, imu: FloatArray, gps: FloatArray) -> tuple[FloatArray | None, FloatArray | None]:
    """New places of the IMU and of the antenna; None: as it was. Both autopilots use nothing but their difference."""
    arm, own = found.effects.get("gps.lever_arm"), found.effects.get("accel.lever_arm")
    if arm is not None:
        return None, imu + arm - (0.0 if own is None else own)
    return (None if own is None else gps + own), None


def put_delay(
    params: ParameterSet, found: Findings, effect: str, name: str, most: float, least: float = 0.0, whole: bool = False
) -> None:
    """A delay in ms, where the autopilot takes it."""
    if effect not in found.effects:
        return
    if params.has(name):
        params.refuse(effect, f"{name} is one for all such sensors, and another effect has set it")
        return
    delay = 1e3 * float(found.effects[effect][0])
    if least <= delay <= most:
        params.put(name, delay, effect, whole=whole)
    else:
        params.refuse(effect, f"{name} takes {least:g} to {most:g} ms, and it is {delay:.0f} ms")
