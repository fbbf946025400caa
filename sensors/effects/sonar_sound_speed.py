"""sonar.sound_speed: the sonar counts with the wrong speed of sound."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion
from sinan.sensors.ranging import slant_range

PLAUSIBLE = 0.03  # 1; the speed of sound changes by 0.17 % a kelvin (ISO 2533 eq. 22), so 18 K


def regressor(motion: Motion) -> FloatArray:
    """(n, 1, 1): range x (1 + b)."""
    return slant_range(motion)[:, None, None]


EFFECT = Effect(
    name="sonar.sound_speed",
    stream="sonar",
    summary="The sonar assumes the wrong speed of sound.",
    enters="range -> range x (1 + b)",
    physics=(
        "range x (1 + b): the range is half the time of flight times an assumed speed of sound, which goes with the "
        "square root of the absolute temperature. Exact."
    ),
    source="ISO 2533:1975, eq. 22; the course, section 4",
    parameters=(Parameter("b", "1", PLAUSIBLE),),
    needs=("p_n", "q_nb"),
    regressor=regressor,
    scenario="low_pass",
    separates="several heights with a second height sensor",
)
