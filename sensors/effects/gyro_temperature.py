"""gyro.temperature: the gyroscope's zero drifts with its temperature."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.algebra import warmth_on_each_axis
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

#: BMI055 data sheet BST-BMI055-DS000: 0.015 deg/s/K = 2.6e-4 rad/s/K; MPU-6000: +-20 deg/s over 125 K = 2.8e-3 rad/s/K
PLAUSIBLE = 1e-3  # (rad/s)/K


def regressor(motion: Motion) -> FloatArray:
    """(n, 3, 3): w_i += b_i (T - T0), T0 = 25 degC."""
    return warmth_on_each_axis(motion)


EFFECT = Effect(
    name="gyro.temperature",
    stream="gyro",
    summary="The gyroscope's zero follows its temperature.",
    enters="w_i += b_i (T - 25 degC)",
    physics=(
        "w_i += b_i (T - 25 degC): the zero of a vibrating structure moves with its temperature. Exact in the first "
        "order; neglects hysteresis and the change of the scale factor."
    ),
    source="Bosch BMI055 data sheet BST-BMI055-DS000 (TCO); MPU-6000 data sheet, section 6.1 (ZRO variation)",
    parameters=tuple(Parameter(axis, "(rad/s)/K", PLAUSIBLE) for axis in "xyz"),
    needs=("temperature",),
    regressor=regressor,
    kinds=frozenset({"flight", "poses"}),
    scenario="warm_up",
    separates="a recording through a change of temperature of 10 K or more",
)
