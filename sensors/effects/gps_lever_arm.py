"""gps.lever_arm: the antenna does not sit at the body's reference point."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import matrix_from_quaternion, skew

PLAUSIBLE = 0.3  # m, masts and arms of a multicopter


def regressor(motion: Motion) -> FloatArray:
    """(n, 6, 3): position += C_nb r, velocity += C_nb (w x r); the first three rows are a receiver without velocity."""
    C_nb = matrix_from_quaternion(motion.q_nb)
    return np.concatenate([C_nb, C_nb @ skew(motion.w_ib_b)], axis=1)


EFFECT = Effect(
    name="gps.lever_arm",
    stream="gps",
    summary="The antenna sits beside the reference point.",
    enters="position += R r,  velocity += R (w x r),  r = b",
    physics=(
        "position += R r, velocity += R (w x r) with r = beta, the antenna's place in the body. Exact for a rigid "
        "body. A constant heading hides it in the position bias; without a height sensor it trades with "
        "`accel.lever_arm`."
    ),
    source="P. D. Groves, Principles of GNSS, Inertial and Multisensor Integrated Navigation, 2nd ed.",
    parameters=tuple(Parameter(axis, "m", PLAUSIBLE) for axis in "xyz"),
    needs=("q_nb", "w_ib_b"),
    regressor=regressor,
    scenario="yaw_turns",
    separates="turns through all headings, large tilts",
)
