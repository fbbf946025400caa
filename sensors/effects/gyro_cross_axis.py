"""gyro.cross_axis: the gyroscope's axes are neither orthogonal nor those of the body."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

#: MPU-6000 data sheet PS-MPU-6000A-00 rev. 3.4, section 6.1: cross-axis sensitivity +-2 %
PLAUSIBLE = 0.02

PAIRS = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))  # reading axis, axis that leaks into it


def regressor(motion: Motion) -> FloatArray:
    """(n, 3, 6): w_x += b0 w_y + b1 w_z, w_y += b2 w_x + b3 w_z, w_z += b4 w_x + b5 w_y."""
    G = np.zeros((len(motion), 3, 6))
    for column, (axis, leaking) in enumerate(PAIRS):
        G[:, axis, column] = motion.w_ib_b[:, leaking]
    return G


EFFECT = Effect(
    name="gyro.cross_axis",
    stream="gyro",
    summary="The gyroscope's axes are crooked.",
    enters="w_x += xy w_y + xz w_z,  w_y += yx w_x + yz w_z,  w_z += zx w_x + zy w_y",
    physics=(
        "Each axis also reads a share of the rate about the two others; six numbers, because both the axes' skewness "
        "and their turn against the body count. Exact."
    ),
    source="D. Tedaldi, A. Pretto, E. Menegatti, ICRA 2014; size: MPU-6000 data sheet, section 6.1 (+-2 %)",
    parameters=tuple(Parameter("xyz"[axis] + "xyz"[other], "1", PLAUSIBLE) for axis, other in PAIRS),
    needs=("w_ib_b",),
    regressor=regressor,
    kinds=frozenset({"flight", "poses"}),
    scenario="aerobatics",
    separates="large turns about one axis at a time",
)
