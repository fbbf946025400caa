"""gyro.g_sensitivity: the gyroscope feels specific force."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.algebra import matrix_times
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

#: MPU-6000 data sheet, section 6.1: linear acceleration sensitivity 0.1 deg/s/g = 1.8e-4 rad/s per m/s^2;
#: open-loop consumer gyroscopes reach several times that
PLAUSIBLE = 5e-4  # (rad/s)/(m/s^2)


def regressor(motion: Motion) -> FloatArray:
    """(n, 3, 9): w += G f, beta = G row by row."""
    return matrix_times(motion.f_b)


EFFECT = Effect(
    name="gyro.g_sensitivity",
    stream="gyro",
    summary="The gyroscope feels acceleration and gravity.",
    enters="w += G f,  G = b row by row",
    physics=(
        "w += G f, beta = G row by row: specific force bends the vibrating structure. Exact in the first order. In "
        "level flight the column of f_z is a constant that the bias absorbs; in gyroscope calibrations the part of G "
        "that turns about gravity itself, its common diagonal, is invisible."
    ),
    source="IEEE Std 1431-2004, acceleration sensitivity; size: MPU-6000 data sheet, section 6.1",
    parameters=tuple(Parameter(row + column, "(rad/s)/(m/s^2)", PLAUSIBLE) for row in "xyz" for column in "xyz"),
    needs=("f_b",),
    regressor=regressor,
    kinds=frozenset({"flight", "poses"}),
    scenario="gyro_poses",
    separates="long static poses in many directions",
)
