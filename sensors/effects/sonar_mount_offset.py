"""sonar.mount_offset: the sonar sits above or below the reference point."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

PLAUSIBLE = 0.1  # m, the size of a landing gear


def regressor(motion: Motion) -> FloatArray:
    """(n, 1, 1): range + b."""
    return np.ones((len(motion), 1, 1))


EFFECT = Effect(
    name="sonar.mount_offset",
    stream="sonar",
    summary="The sonar counts its range from another point.",
    enters="range += b",
    physics=(
        "range + b: the transducer sits b further from the ground, along the beam, than the reference point, or the "
        "electronics delay the echo. Exact. Only the difference of two range sensors is seen: `laser.mount_offset` is "
        "its twin, and the height biases absorb it where there is one range sensor."
    ),
    source="The course, section 4 (form: this project's)",
    parameters=(Parameter("b", "m", PLAUSIBLE),),
    needs=("p_n", "q_nb"),
    regressor=regressor,
    scenario="low_pass",
    separates="a second range sensor whose offset is known",
)
