"""How a sensor or a board is mounted: the numbered rotations that PX4 and ArduPilot share, and their Euler angles.

Source: MAVLink common messages, `MAV_SENSOR_ORIENTATION`; PX4 `conversion/rotation.h`; ArduPilot `AP_Math/rotations.h`.
"""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.rotation import (
    matrix_from_quaternion,
    quaternion_from_matrix,
    quaternion_from_rpy,
    rpy_from_quaternion,
)

#: Roll, pitch, yaw [deg] by number.
_ANGLES = (
    (0, 0, 0), (0, 0, 45), (0, 0, 90), (0, 0, 135), (0, 0, 180), (0, 0, 225), (0, 0, 270), (0, 0, 315),
    (180, 0, 0), (180, 0, 45), (180, 0, 90), (180, 0, 135), (0, 180, 0), (180, 0, 225), (180, 0, 270), (180, 0, 315),
    (90, 0, 0), (90, 0, 45), (90, 0, 90), (90, 0, 135), (270, 0, 0), (270, 0, 45), (270, 0, 90), (270, 0, 135),
    (0, 90, 0), (0, 270, 0), (0, 180, 90), (0, 180, 270), (90, 90, 0), (180, 90, 0), (270, 90, 0), (90, 180, 0),
    (270, 180, 0), (90, 270, 0), (180, 270, 0), (270, 270, 0), (90, 180, 90), (90, 0, 270), (90, 68, 293),
    (0, 315, 0), (90, 315, 0),
)  # fmt: skip


def rotation_of(number: float) -> FloatArray | None:
    """(3, 3) sensor -> body of a numbered rotation; None: of another one."""
    if not (float(number).is_integer() and 0 <= number < len(_ANGLES)):
        return None
    return from_degrees(np.array(_ANGLES[int(number)], dtype=np.float64))


def from_degrees(rpy: FloatArray) -> FloatArray:
    """(3, 3) Rz(yaw) Ry(pitch) Rx(roll) of angles in deg."""
    return matrix_from_quaternion(quaternion_from_rpy(np.radians(rpy)))


def to_degrees(C: FloatArray) -> FloatArray:
    """(3,) roll, pitch, yaw [deg] of a rotation."""
    return np.degrees(rpy_from_quaternion(quaternion_from_matrix(C)))
