"""baro.airspeed: the stream of air changes the pressure at the barometer's port."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.algebra import airspeed
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

#: A pressure coefficient C_p shifts the height by -C_p V^2 / (2 g): 0.025 s^2/m for C_p = -0.5, a port in suction
PLAUSIBLE = 0.03  # s^2/m


def regressor(motion: Motion) -> FloatArray:
    """(n, 1, 1): height += b V^2, V = airspeed, else |v - wind|."""
    return (airspeed(motion) ** 2)[:, None, None]


EFFECT = Effect(
    name="baro.airspeed",
    stream="baro",
    summary="The barometer's port feels the airspeed.",
    enters="height += b V^2",
    physics=(
        "height += b V^2: the static port sits where the flow around the body has a pressure coefficient C_p, so the "
        "pressure is off by C_p rho V^2 / 2 and the height by b = -C_p / (2 g). Exact for a C_p that does not depend "
        "on the direction of the flow."
    ),
    source="W. Gracey, Measurement of aircraft speed and altitude, NASA RP-1046, 1980 (position error)",
    parameters=(Parameter("b", "s^2/m", PLAUSIBLE),),
    needs=("airspeed",),
    regressor=regressor,
    scenario="square",
    separates="level legs at several speeds",
)
