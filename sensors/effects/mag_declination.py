"""mag.declination: the Earth's field points elsewhere than declared."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import cross, rotate_back, rotation_exp

PLAUSIBLE = 0.2  # rad; between the polar circles the declination reaches +-25 deg (WMM2025), half of it forgotten


def regressor(motion: Motion) -> FloatArray:
    """(n, 3, 1): C_bn (e_down x m_n)."""
    eastward = cross(np.array([0.0, 0.0, 1.0]), motion.m_n)
    return rotate_back(motion.q_nb, np.broadcast_to(eastward, (len(motion), 3)))[:, :, None]


def exact(plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None) -> FloatArray:
    """B_ned = Rz(b) B_declared, positive to the east."""
    turn = rotation_exp(np.array([0.0, 0.0, beta[0]])) - np.eye(3)
    return plain + rotate_back(motion.q_nb, np.broadcast_to(motion.m_n @ turn.T, (len(motion), 3)))


EFFECT = Effect(
    name="mag.declination",
    stream="mag",
    summary="The magnetometer's field points elsewhere than the declared one.",
    enters="B_ned -> Rz(b) B_declared,  positive to the east",
    physics=(
        "B_ned = Rz(b) B_declared: the declared field lacks the declination, or iron in the ground turns it. Needs "
        "something else that sees the heading: accelerations with GPS."
    ),
    source="A. Chulliat et al., The US/UK World Magnetic Model for 2025-2030, NOAA",
    parameters=(Parameter("east", "rad", PLAUSIBLE),),
    needs=("q_nb", "m_n"),
    regressor=regressor,
    exact=exact,
    scenario="figure_eight",
    separates="horizontal accelerations under GPS",
)
