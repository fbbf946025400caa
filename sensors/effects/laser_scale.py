"""laser.scale: the laser's metres have the wrong length."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.beams import beams_b
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion
from sinan.sensors.ranging import slant_range

PLAUSIBLE = 0.02  # 1; Garmin LIDAR-Lite v3 manual: accuracy +-2.5 cm below 5 m, 1 to 2 % beyond


def regressor(motion: Motion) -> FloatArray:
    """(n, beams, 1): range x (1 + b)."""
    return np.stack([slant_range(motion, beam) for beam in beams_b(motion)], axis=1)[:, :, None]


EFFECT = Effect(
    name="laser.scale",
    stream="laser",
    summary="The laser's metres have the wrong length.",
    enters="range -> range x (1 + b)",
    physics="range x (1 + b): the clock or the modulation frequency of the range finder is off. Exact.",
    source="J.-M. Rueger, Electronic distance measurement, 4th ed. (scale error); size: LIDAR-Lite v3 manual",
    parameters=(Parameter("b", "1", PLAUSIBLE),),
    needs=("p_n", "q_nb"),
    regressor=regressor,
    scenario="climb_descent",
    separates="several heights with a second height sensor",
)
