"""baro.temperature: the barometer's reading drifts with its temperature."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.algebra import warmth
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

PLAUSIBLE = 0.15  # m/K; BMP280 data sheet BST-BMP280-DS001: offset 1.5 Pa/K, 0.13 m/K


def regressor(motion: Motion) -> FloatArray:
    """(n, 1, 1): height += b (T - T0), T0 = 25 degC."""
    return warmth(motion)[:, None, None]


EFFECT = Effect(
    name="baro.temperature",
    stream="baro",
    summary="The barometer's height follows its own temperature.",
    enters="height += b (T - 25 degC)",
    physics="height += b (T - 25 degC): what is left of the cell's temperature compensation. Exact in the first order.",
    source="Bosch BMP280 data sheet BST-BMP280-DS001, table 2 (temperature coefficient of the offset, 1.5 Pa/K)",
    parameters=(Parameter("b", "m/K", PLAUSIBLE),),
    needs=("temperature",),
    regressor=regressor,
    scenario="warm_up",
    separates="a change of temperature with a second height sensor",
)
