"""What each effect adds to the reading of IMU, magnetometer and GPS: docs/effects.md, written out once more.

Every function gives reading with the effect minus plain reading, (n, size of the stream), at beta = b.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from sinan.experiments.blind.maker.body import Body
from sinan.experiments.blind.maker.scene import Surroundings
from sinan.experiments.blind.maker.turning import cross_rows, exp_rotation, rot_z
from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import REFERENCE_TEMPERATURE


@dataclass(frozen=True)
class Seen:
    """An instrument's plain reading with what the effects on it need.

    Attributes
    ----------
    body, scene : at the instants that the readings belong to
    plain : (n, k) the perfect sensor's reading
    temperature : (n,) of this instrument [degC]
    """

    body: Body
    scene: Surroundings
    plain: FloatArray
    temperature: FloatArray


Forward = Callable[[FloatArray, Seen], FloatArray]


def diagonal(b: FloatArray, seen: Seen) -> FloatArray:
    """x_i += b_i x_i."""
    return b * seen.plain


def squares(b: FloatArray, seen: Seen) -> FloatArray:
    """x_i += b_i x_i^2."""
    return b * seen.plain**2


def warm(b: FloatArray, seen: Seen) -> FloatArray:
    """x_i += b_i (T - T0)."""
    return np.outer(seen.temperature - REFERENCE_TEMPERATURE, b)


def accel_cross_axis(b: FloatArray, seen: Seen) -> FloatArray:
    """f_x += b0 f_y + b1 f_z; f_y += b2 f_z."""
    return seen.plain @ np.array([[0.0, b[0], b[1]], [0.0, 0.0, b[2]], [0.0, 0.0, 0.0]]).T


def accel_lever_arm(b: FloatArray, seen: Seen) -> FloatArray:
    """f += w x (w x r) + dw/dt x r."""
    w, r = seen.body.w, np.broadcast_to(b, seen.body.w.shape)
    return cross_rows(w, cross_rows(w, r)) + cross_rows(seen.body.dw, r)


def accel_vibration(b: FloatArray, seen: Seen) -> FloatArray:
    """f_i += b_i P_i."""
    vibration = seen.scene.vibration
    return np.zeros_like(seen.plain) if vibration is None else b * vibration.variance(seen.body.t)


def turned(b: FloatArray, seen: Seen) -> FloatArray:
    """x = Exp(-b) x."""
    return seen.plain @ exp_rotation(-b).T - seen.plain


def gyro_cross_axis(b: FloatArray, seen: Seen) -> FloatArray:
    """Off-diagonal, order xy xz yx yz zx zy."""
    return seen.plain @ np.array([[0.0, b[0], b[1]], [b[2], 0.0, b[3]], [b[4], b[5], 0.0]]).T


def gyro_g_sensitivity(b: FloatArray, seen: Seen) -> FloatArray:
    """w += G f, G row by row."""
    return seen.body.f @ b.reshape(3, 3).T


def mag_cross_axis(b: FloatArray, seen: Seen) -> FloatArray:
    """B += [[0, b0, b1], [b0, 0, b2], [b1, b2, 0]] B."""
    return seen.plain @ np.array([[0.0, b[0], b[1]], [b[0], 0.0, b[2]], [b[1], b[2], 0.0]]).T


def mag_current(b: FloatArray, seen: Seen) -> FloatArray:
    """B += b I."""
    return np.outer(seen.scene.current(seen.body), b)


def mag_declination(b: FloatArray, seen: Seen) -> FloatArray:
    """B_ned = Rz(b) B_declared."""
    declared = seen.scene.field_n
    return seen.body.to_body(rot_z(float(b[0])) @ declared - declared)


def gps_lever_arm(b: FloatArray, seen: Seen) -> FloatArray:
    """position += R r, velocity += R (w x r); the columns that the receiver has."""
    r = np.broadcast_to(b, seen.body.w.shape)
    shift = np.concatenate([seen.body.to_ned(r), seen.body.to_ned(cross_rows(seen.body.w, r))], axis=1)
    return shift[:, : seen.plain.shape[1]]


VECTOR_EFFECTS: Mapping[str, Forward] = {
    "accel.cross_axis": accel_cross_axis,
    "accel.scale": diagonal,
    "accel.scale_nonlinearity": squares,
    "accel.temperature": warm,
    "accel.lever_arm": accel_lever_arm,
    "accel.vibration": accel_vibration,
    "accel.misalignment": turned,
    "gyro.scale": diagonal,
    "gyro.cross_axis": gyro_cross_axis,
    "gyro.temperature": warm,
    "gyro.g_sensitivity": gyro_g_sensitivity,
    "mag.cross_axis": mag_cross_axis,
    "mag.scale": diagonal,
    "mag.current": mag_current,
    "mag.temperature": warm,
    "mag.declination": mag_declination,
    "mag.misalignment": turned,
    "gps.lever_arm": gps_lever_arm,
}
