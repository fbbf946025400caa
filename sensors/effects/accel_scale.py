"""accel.scale: each axis of the accelerometer has a scale factor of its own."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.algebra import diagonal
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

#: MPU-6000 data sheet PS-MPU-6000A-00 rev. 3.4, section 6.2: initial calibration tolerance +-3 %
PLAUSIBLE = 0.03


def regressor(motion: Motion) -> FloatArray:
    """(n, 3, 3): f_i += b_i f_i."""
    return diagonal(motion.f_b)


EFFECT = Effect(
    name="accel.scale",
    stream="accel",
    summary="The accelerometer's scale factor is off.",
    enters="f_i += b_i f_i",
    physics=(
        "f_i += b_i f_i: the spring and the read-out of each axis have a scale factor of their own. Exact. In hover "
        "the force hardly changes, so the scale cannot be told from the bias; climbs, descents and hard turns "
        "separate them. Poses have the scale in the plain model, so it is a candidate in flight alone."
    ),
    source="D. Tedaldi, A. Pretto, E. Menegatti, ICRA 2014; size: MPU-6000 data sheet, section 6.2 (+-3 %)",
    parameters=tuple(Parameter(axis, "1", PLAUSIBLE) for axis in "xyz"),
    needs=("f_b",),
    regressor=regressor,
    scenario="aerobatics",
    separates="climbs and descents with strong changes of thrust",
)
