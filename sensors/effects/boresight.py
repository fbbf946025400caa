"""<sonar or laser>.boresight: the range sensor does not look along body down."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.beams import boresight_range, boresight_slope
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion

PLAUSIBLE = 0.05  # rad; a module glued by hand is straight to some degrees
SCENARIOS = {"sonar": "low_pass", "laser": "square"}


def regressor(motion: Motion) -> FloatArray:
    """(n, beams, 2): see `boresight_slope`."""
    return boresight_slope(motion)


def exact(plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None) -> FloatArray:
    """Ranges along Rx(b0) Ry(b1) beam, the whole rotation."""
    return boresight_range(motion, beta)


def for_stream(stream: str) -> Effect:
    """Of sonar or laser."""
    return Effect(
        name=f"{stream}.boresight",
        stream=stream,
        summary=f"The {stream} does not look straight down.",
        enters="beam -> Rx(b_roll) Ry(b_pitch) (0, 0, 1) in the body",
        physics=(
            "The beam points along Rx(b0) Ry(b1) (0, 0, 1) in the body, the whole rotation: level it reads too long by "
            "the square of the angle, tilted by the first order. Exact over flat ground."
        ),
        source="J. Skaloud, D. Lichti, ISPRS J. Photogrammetry and Remote Sensing 61(1), 2006 (bore-sight)",
        parameters=(Parameter("roll", "rad", PLAUSIBLE), Parameter("pitch", "rad", PLAUSIBLE)),
        needs=("p_n", "q_nb"),
        regressor=regressor,
        exact=exact,
        scenario=SCENARIOS[stream],
        separates="tilts to both sides at some height",
    )
