"""accel.scale_nonlinearity: the accelerometer's scale factor grows with the force."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.algebra import diagonal
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

#: MPU-6000 data sheet, section 6.2: nonlinearity 0.5 % of full scale; of +-2 g that is 0.1 m/s^2 at 2 g: 2.5e-4 s^2/m;
#: four times that for sensors with an uncompensated spring
PLAUSIBLE = 1e-3  # s^2/m


def regressor(motion: Motion) -> FloatArray:
    """(n, 3, 3): f_i += b_i f_i^2."""
    return diagonal(motion.f_b**2)


EFFECT = Effect(
    name="accel.scale_nonlinearity",
    stream="accel",
    summary="The accelerometer's scale factor depends on the force.",
    enters="f_i += b_i f_i^2",
    physics=(
        "f_i += b_i f_i^2, the second term of the sensor's characteristic (K2 of IEEE Std 1293): spring and "
        "electrostatic forces are not symmetric about zero. Exact. Neglects the third order. In flight f_z keeps its "
        "sign, where the square looks like a scale: `accel.scale` is the usual companion in its class; static poses "
        "separate them."
    ),
    source="IEEE Std 1293-2018 (model equation, K2); size: MPU-6000 data sheet, section 6.2",
    parameters=tuple(Parameter(axis, "s^2/m", PLAUSIBLE) for axis in "xyz"),
    needs=("f_b",),
    regressor=regressor,
    kinds=frozenset({"flight", "poses"}),
    scenario="accel_poses",
    separates="static poses in both senses of each axis",
)
