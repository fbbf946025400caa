"""accel.misalignment: the accelerometer is turned against the gyroscope."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.algebra import turned_triad
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import skew

PLAUSIBLE = 0.03  # rad; two chips soldered on one board agree to 1 or 2 degrees


def regressor(motion: Motion) -> FloatArray:
    """(n, 3, 3): f = Exp(-b) f, to first order f - b x f = f + [f]x b."""
    return skew(motion.f_b)


def exact(plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None) -> FloatArray:
    """Exp(-b) f with the whole rotation."""
    return turned_triad(plain, beta)


EFFECT = Effect(
    name="accel.misalignment",
    stream="accel",
    summary="The accelerometer is turned against the gyroscope.",
    enters="f -> Exp(-b) f",
    physics=(
        "f = Exp(-b) f with a rotation vector b. In static poses the length of f does not see it, so it is a candidate "
        "in flight alone; there the tilt that the accelerometer shows disagrees with the turns of the gyroscope. A "
        "turn about the direction of the force itself is invisible."
    ),
    source="D. Tedaldi, A. Pretto, E. Menegatti, ICRA 2014 (the two triads' frames)",
    parameters=tuple(Parameter(axis, "rad", PLAUSIBLE) for axis in "xyz"),
    needs=("f_b",),
    regressor=regressor,
    exact=exact,
    scenario="aerobatics",
    separates="yaw turns and quick changes of tilt and thrust",
)
