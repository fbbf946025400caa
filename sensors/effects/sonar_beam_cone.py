"""sonar.beam_cone: the nearest point inside the sonar's cone answers, not the one on its axis."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import cos_tilt

PLAUSIBLE = 0.2  # rad; transducers of hobby sonars have half angles of 10 to 25 deg


def tilt(motion: Motion) -> FloatArray:
    """(n,) angle between body down and down [rad]."""
    return np.arccos(np.clip(cos_tilt(motion.q_nb), -1.0, 1.0))


def regressor(motion: Motion) -> FloatArray:
    """(n, 1, 1): d/db h / cos(tilt - b) = -h sin(tilt) / cos(tilt)^2."""
    angle = tilt(motion)
    return (-motion.height * np.sin(angle) / np.cos(angle) ** 2)[:, None, None]


def exact(plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None) -> FloatArray:
    """range = h / cos(max(0, tilt - b))."""
    return (motion.height / np.cos(np.maximum(tilt(motion) - beta[0], 0.0)))[:, None]


EFFECT = Effect(
    name="sonar.beam_cone",
    stream="sonar",
    summary="The sonar hears the nearest point of its cone.",
    enters="range -> h / cos(max(0, tilt - b)),  b > 0",
    physics=(
        "range = h / cos(max(0, tilt - b)), b > 0 the half angle of the cone: the first echo comes from where the cone "
        "meets the ground nearest. Tilts below b read the height itself; if no tilt exceeds b, the data hold only a "
        "lower bound."
    ),
    source="L. Kleeman, R. Kuc, Sonar sensing, Springer Handbook of Robotics",
    parameters=(Parameter("half_angle", "rad", PLAUSIBLE, positive=True),),
    needs=("p_n", "q_nb"),
    regressor=regressor,
    exact=exact,
    scenario="low_pass",
    separates="large tilts close to the ground",
)
