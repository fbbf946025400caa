"""mag.temperature: the magnetometer's zero drifts with its temperature."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.algebra import warmth_on_each_axis
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

#: Some 0.1 to 0.2 uT/K, up to half a per cent of the field a kelvin, for bridges without compensation
PLAUSIBLE = 0.005  # share of the field, 1/K


def regressor(motion: Motion) -> FloatArray:
    """(n, 3, 3): B += b (T - T0), T0 = 25 degC; the IMU's temperature where the magnetometer has none."""
    return warmth_on_each_axis(motion)


EFFECT = Effect(
    name="mag.temperature",
    stream="mag",
    summary="The magnetometer's zero follows its temperature.",
    enters="B += b (T - 25 degC)",
    physics=(
        "B += b (T - 25 degC): offset of the bridge and of its amplifier. Exact in the first order; neglects the "
        "change of the scale factor with temperature. Warming together with the load it looks like `mag.current`."
    ),
    source="Honeywell HMC5883L data sheet (offset and sensitivity over temperature; the size is an assumption)",
    parameters=tuple(Parameter(axis, "1/K", PLAUSIBLE) for axis in "xyz"),
    needs=("temperature",),
    regressor=regressor,
    kinds=frozenset({"flight", "poses"}),
    scenario="warm_up",
    separates="a change of temperature at constant load",
    in_field_units=True,
)
