"""mag.misalignment: the magnetometer is turned against the IMU."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.algebra import turned_triad
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.magnetometer import field_b
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import skew

PLAUSIBLE = 0.1  # rad; an external compass on a mast is aligned by eye, to some degrees


def regressor(motion: Motion) -> FloatArray:
    """(n, 3, 3): B = Exp(-b) B, to first order B - b x B = B + [B]x b."""
    return skew(field_b(motion))


def exact(plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None) -> FloatArray:
    """Exp(-b) B with the whole rotation."""
    return turned_triad(plain, beta)


EFFECT = Effect(
    name="mag.misalignment",
    stream="mag",
    summary="The magnetometer is turned against the IMU.",
    enters="B -> Exp(-b) B",
    physics=(
        "B = Exp(-b) B with a rotation vector b. In poses the length of B does not see it, so it is a candidate in "
        "flight alone. In level flight its yaw component looks like `mag.declination`."
    ),
    source="M. Kok, T. B. Schon, IEEE Sensors Journal 16(14), 2016",
    parameters=tuple(Parameter(axis, "rad", PLAUSIBLE) for axis in "xyz"),
    needs=("m_b",),
    regressor=regressor,
    exact=exact,
    scenario="aerobatics",
    separates="large tilts at several headings",
)
