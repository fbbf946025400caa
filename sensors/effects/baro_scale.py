"""baro.scale: the barometer counts metres of the wrong length."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

PLAUSIBLE = 0.05  # 1; air 15 K warmer than the standard atmosphere stretches heights by 5 % (ISO 2533)


def regressor(motion: Motion) -> FloatArray:
    """(n, 1, 1): height += b x height."""
    return -motion.p_n[:, 2, None, None]


EFFECT = Effect(
    name="baro.scale",
    stream="baro",
    summary="The barometer's metres have the wrong length.",
    enters="height += b x height",
    physics=(
        "height += b x height: pressure falls with height as the air's density, so air warmer than the standard "
        "atmosphere by dT makes heights too small by dT / 288 K. Exact for a column of constant error."
    ),
    source="ISO 2533:1975, eq. 12",
    parameters=(Parameter("b", "1", PLAUSIBLE),),
    needs=("p_n",),
    regressor=regressor,
    scenario="climb_descent",
    separates="climbs and descents with a second height sensor",
)
