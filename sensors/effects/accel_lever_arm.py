"""accel.lever_arm: the accelerometer does not sit at the body's reference point."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import skew

PLAUSIBLE = 0.1  # m, the size of a small multicopter's frame


def regressor(motion: Motion) -> FloatArray:
    """(n, 3, 3): f += w x (w x r) + dw/dt x r = ([w]x [w]x + [dw]x) r, r = beta."""
    W = skew(motion.w_ib_b)
    return W @ W + skew(motion.dw_b)


EFFECT = Effect(
    name="accel.lever_arm",
    stream="accel",
    summary="The accelerometer sits beside the reference point.",
    enters="f += w x (w x r) + dw/dt x r,  r = b",
    physics=(
        "f += w x (w x r) + dw/dt x r with r = beta, the place of the IMU in the body: turning adds centripetal and "
        "tangential acceleration. Exact for a rigid body. Only turns show it; without a height sensor it trades with "
        "`gps.lever_arm`."
    ),
    source="P. D. Groves, Principles of GNSS, Inertial and Multisensor Integrated Navigation, 2nd ed.",
    parameters=tuple(Parameter(axis, "m", PLAUSIBLE) for axis in "xyz"),
    needs=("w_ib_b", "dw_b"),
    regressor=regressor,
    scenario="aerobatics",
    separates="quick changes of roll, pitch and yaw rate",
)
