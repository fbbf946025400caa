"""baro.propwash: the rotors' wash raises the pressure near the ground."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

PLAUSIBLE = 2.0  # m; heights in flight logs move by 1 to 3 m at take-off
DECAY_HEIGHT = 2.0  # m, EFFECTS: exp(-h / 2 m), about twice the rotor diameter of a mid-size multicopter


def regressor(motion: Motion) -> FloatArray:
    """(n, 1, 1): height += b x mean throttle x exp(-h / 2 m), h above the ground."""
    return (motion.covariates["throttle"] * np.exp(-motion.height / DECAY_HEIGHT))[:, None, None]


EFFECT = Effect(
    name="baro.propwash",
    stream="baro",
    summary="The barometer feels the rotors' wash near the ground.",
    enters="height += b x mean throttle x exp(-h / 2 m)",
    physics=(
        "height += b x mean throttle x exp(-h / 2 m): the wash piles up between the body and the ground. Exact by "
        "definition; neglects that the decay height depends on the rotor's size."
    ),
    source="ArduPilot documentation, 'Ground effect compensation' (the form is this project's)",
    parameters=(Parameter("b", "m", PLAUSIBLE),),
    needs=("p_n", "throttle"),
    regressor=regressor,
    scenario="takeoff_landing",
    separates="take-off, landing and low passes with a second height sensor",
)
