"""gyro.scale: each axis of the gyroscope has a scale factor of its own."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.algebra import diagonal
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

#: MPU-6000 data sheet PS-MPU-6000A-00 rev. 3.4, section 6.1: sensitivity scale factor tolerance +-3 %
PLAUSIBLE = 0.03


def regressor(motion: Motion) -> FloatArray:
    """(n, 3, 3): w_i += b_i w_i."""
    return diagonal(motion.w_ib_b)


EFFECT = Effect(
    name="gyro.scale",
    stream="gyro",
    summary="The gyroscope's scale factor is off.",
    enters="w_i += b_i w_i",
    physics=(
        "w_i += b_i w_i. Exact. After a turn by an angle a the attitude is off by b a, which the magnetometer or the "
        "force sees; a turn back takes it away again, so turns of one sense show it best."
    ),
    source="D. Tedaldi, A. Pretto, E. Menegatti, ICRA 2014; size: MPU-6000 data sheet, section 6.1 (+-3 %)",
    parameters=tuple(Parameter(axis, "1", PLAUSIBLE) for axis in "xyz"),
    needs=("w_ib_b",),
    regressor=regressor,
    kinds=frozenset({"flight", "poses"}),
    scenario="aerobatics",
    separates="turns about all axes, yaw turns of one sense",
)
