"""accel.vibration: the accelerometer rectifies vibration into an offset."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.algebra import diagonal
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

#: Rectification of MEMS sensors is given as 0.1 to 10 mg/g^2, 1e-5 to 1e-3 s^2/m; clipping near the end of the
#: range raises it by a factor of ten or more (order of magnitude)
PLAUSIBLE = 0.01  # s^2/m


def regressor(motion: Motion) -> FloatArray:
    """(n, 3, 3): f_i += b_i P_i, P = covariate `vibration` [(m/s^2)^2]."""
    return diagonal(motion.covariates["vibration"])


EFFECT = Effect(
    name="accel.vibration",
    stream="accel",
    summary="The accelerometer turns vibration into an offset.",
    enters="f_i += b_i P_i,  P_i the variance of the vibration on that axis over 0.5 s",
    physics=(
        "f_i += b_i P_i, P_i the variance of the vibration on that axis over about 0.5 s without the white noise "
        "(`sensors.vibration.vibration_power`): the even part of the characteristic and clipping do not average out. "
        "Exact in P; neglects the coupling of one axis's vibration into another. The square of a shaken force has the "
        "mean f_i^2 + P_i, so `accel.scale_nonlinearity` looks the same in flight; static poses tell them apart."
    ),
    source="L. Pham, A. DeSimone, Vibration rectification in MEMS accelerometers, Analog Devices, 2017",
    parameters=tuple(Parameter(axis, "s^2/m", PLAUSIBLE) for axis in "xyz"),
    needs=("vibration",),
    regressor=regressor,
    scenario="vibration",
    separates="static poses, and the same flight without the shaking",
)
