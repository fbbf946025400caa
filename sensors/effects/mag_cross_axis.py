"""mag.cross_axis: soft iron bends the field."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.magnetometer import field_b
from sinan.sensors.motion import Motion

PLAUSIBLE = 0.05  # 1; soft iron of a few per cent is what compass calibrations of multicopters find


def regressor(motion: Motion) -> FloatArray:
    """(n, 3, 3): B += [[0, b0, b1], [b0, 0, b2], [b1, b2, 0]] B."""
    x, y, z = field_b(motion).T
    zero = np.zeros_like(x)
    rows = [[y, z, zero], [x, zero, z], [zero, x, y]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=1)


EFFECT = Effect(
    name="mag.cross_axis",
    stream="mag",
    summary="Soft iron near the magnetometer bends the field.",
    enters="B += [[0, xy, xz], [xy, 0, yz], [xz, yz, 0]] B",
    physics=(
        "B += [[0, b0, b1], [b0, 0, b2], [b1, b2, 0]] B: iron that the Earth's field magnetises adds a field "
        "proportional to it. The symmetric part is soft iron and crooked axes, the rotation is `mag.misalignment`. "
        "Exact; neglects hysteresis of the iron."
    ),
    source="V. Renaudin, M. H. Afzal, G. Lachapelle, Journal of Sensors 2010, 967245",
    parameters=(Parameter("xy", "1", PLAUSIBLE), Parameter("xz", "1", PLAUSIBLE), Parameter("yz", "1", PLAUSIBLE)),
    needs=("m_b",),
    regressor=regressor,
    kinds=frozenset({"flight", "poses"}),
    scenario="aerobatics",
    separates="headings all around and large tilts, or a slow turn through all directions",
)
