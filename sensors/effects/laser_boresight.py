"""laser.boresight: the laser does not look along body down."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.beams import BORESIGHT_AXES, beams_b
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion
from sinan.sensors.ranging import slant_range
from sinan.sensors.rotation import cross, rotate_back, rotation_exp

PLAUSIBLE = 0.05  # rad; a module glued by hand is straight to some degrees


def regressor(motion: Motion) -> FloatArray:
    """(n, beams, 2): d range / d b_j = -range / c (d_b . (e_j x beam)), c = d_b . beam, d_b = C_bn e_down."""
    d_b = rotate_back(motion.q_nb, np.broadcast_to(np.array([0.0, 0.0, 1.0]), (len(motion), 3)))
    rows = []
    for beam in beams_b(motion):
        turned = cross(BORESIGHT_AXES, beam)
        rows.append(-(slant_range(motion, beam) / (d_b @ beam))[:, None] * (d_b @ turned.T))
    return np.stack(rows, axis=1)


def exact(plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None) -> FloatArray:
    """Ranges along Rx(b0) Ry(b1) beam, the whole rotation."""
    turn = rotation_exp(np.array([beta[0], 0.0, 0.0])) @ rotation_exp(np.array([0.0, beta[1], 0.0]))
    return np.stack([slant_range(motion, turn @ beam) for beam in beams_b(motion)], axis=1)


EFFECT = Effect(
    name="laser.boresight",
    stream="laser",
    summary="The laser does not look straight down.",
    enters="beam -> Rx(b_roll) Ry(b_pitch) (0, 0, 1) in the body",
    physics=(
        "The beam points along Rx(b0) Ry(b1) (0, 0, 1) in the body, the whole rotation: level it reads too long by the "
        "square of the angle, tilted by the first order. Exact over flat ground."
    ),
    source="J. Skaloud, D. Lichti, ISPRS J. Photogrammetry and Remote Sensing 61(1), 2006 (bore-sight)",
    parameters=(Parameter("roll", "rad", PLAUSIBLE), Parameter("pitch", "rad", PLAUSIBLE)),
    needs=("p_n", "q_nb"),
    regressor=regressor,
    exact=exact,
    scenario="square",
    separates="tilts to both sides at some height",
)
