"""mag.scale: each axis of the magnetometer has a scale factor of its own."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.algebra import diagonal
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.magnetometer import field_b
from sinan.sensors.motion import Motion

PLAUSIBLE = 0.05  # 1; HMC5883L data sheet (rev. E), table 2: tolerance of the scale factor +-5 %


def regressor(motion: Motion) -> FloatArray:
    """(n, 3, 3): B_i += b_i B_i."""
    return diagonal(field_b(motion))


EFFECT = Effect(
    name="mag.scale",
    stream="mag",
    summary="The magnetometer's scale factor is off.",
    enters="B_i += b_i B_i",
    physics=(
        "B_i += b_i B_i: the scale factor of each axis, and the symmetric part of soft iron along the axes. Exact. "
        "Poses have the scale in the plain model, so it is a candidate in flight alone."
    ),
    source="V. Renaudin, M. H. Afzal, G. Lachapelle, Journal of Sensors 2010, 967245; size: HMC5883L data sheet",
    parameters=tuple(Parameter(axis, "1", PLAUSIBLE) for axis in "xyz"),
    needs=("m_b",),
    regressor=regressor,
    scenario="yaw_turns",
    separates="headings all around and large tilts",
)
