"""accel.cross_axis: the accelerometer's axes are not at right angles to each other."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

#: MPU-6000 data sheet PS-MPU-6000A-00 rev. 3.4, section 6.2: cross-axis sensitivity +-2 %
PLAUSIBLE = 0.02


def regressor(motion: Motion) -> FloatArray:
    """(n, 3, 3): f_x += b0 f_y + b1 f_z, f_y += b2 f_z. The sensor's z axis is the body's."""
    f = motion.f_b
    G = np.zeros((len(motion), 3, 3))
    G[:, 0, 0] = f[:, 1]
    G[:, 0, 1] = f[:, 2]
    G[:, 1, 2] = f[:, 2]
    return G


EFFECT = Effect(
    name="accel.cross_axis",
    stream="accel",
    summary="The accelerometer's axes are not orthogonal.",
    enters="f_x += xy f_y + xz f_z,  f_y += yz f_z",
    physics=(
        "The three sensing masses are not etched at right angles, so an axis also reads a share of the force along the "
        "others: f_x += b0 f_y + b1 f_z, f_y += b2 f_z. Three angles describe the axes' skewness; the three that would "
        "turn all axes together are `accel.misalignment`. Exact. In flight a multicopter's force stays close to body "
        "down, so b1 and b2 lean on the biases unless the thrust varies."
    ),
    source="D. Tedaldi, A. Pretto, E. Menegatti, ICRA 2014; size: MPU-6000 data sheet, section 6.2 (+-2 %)",
    parameters=(Parameter("xy", "1", PLAUSIBLE), Parameter("xz", "1", PLAUSIBLE), Parameter("yz", "1", PLAUSIBLE)),
    needs=("f_b",),
    regressor=regressor,
    kinds=frozenset({"flight", "poses"}),
    scenario="aerobatics",
    separates="strong changes of thrust and tilt, or static poses in all directions",
)
