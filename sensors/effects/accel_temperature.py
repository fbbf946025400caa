"""accel.temperature: the accelerometer's zero drifts with its temperature."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.algebra import warmth_on_each_axis
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

#: MPU-6000 data sheet, section 6.2: zero-g drift +-35 mg (x, y), +-60 mg (z) over 70 K, so up to 0.86 mg/K
PLAUSIBLE = 0.01  # (m/s^2)/K


def regressor(motion: Motion) -> FloatArray:
    """(n, 3, 3): f_i += b_i (T - T0), T0 = 25 degC."""
    return warmth_on_each_axis(motion)


EFFECT = Effect(
    name="accel.temperature",
    stream="accel",
    summary="The accelerometer's zero follows its temperature.",
    enters="f_i += b_i (T - 25 degC)",
    physics=(
        "f_i += b_i (T - 25 degC): stress in the die and the electronics shift the zero as the board warms up. Exact "
        "in the first order; neglects hysteresis and the change of the scale factor. A linear warming looks like a "
        "steady drift, so a bias walk that is declared large enough absorbs part of it."
    ),
    source="MPU-6000 data sheet PS-MPU-6000A-00 rev. 3.4, section 6.2 (zero-g level change over temperature)",
    parameters=tuple(Parameter(axis, "(m/s^2)/K", PLAUSIBLE) for axis in "xyz"),
    needs=("temperature",),
    regressor=regressor,
    kinds=frozenset({"flight", "poses"}),
    scenario="warm_up",
    separates="a flight through a change of temperature of 10 K or more",
)
