"""`pseudorange.satellite_clock`: the satellite's clock is ahead of the system's time by what its message says."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import SPEED_OF_LIGHT
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion


def regressor(motion: Motion) -> FloatArray:
    """(n, 1, 1) -c dt_s [m], dt_s the broadcast clock polynomial."""
    return (-SPEED_OF_LIGHT * motion.covariates["satellite_clock"])[:, None, None]


EFFECT = Effect(
    name="pseudorange.satellite_clock",
    stream="pseudorange",
    summary="The pseudorange is too short by what the satellite's clock is ahead.",
    enters="range += - b c dt_s,  b = 1 in full",
    physics=(
        "A clock that is ahead stamps the signal with a later time of transmission. Satellites are left to run up to a "
        "millisecond (300 km) off; the message says by how much, dt_s = af0 + af1 (t - toc) + af2 (t - toc)^2. It is "
        "the lecture's correction of the satellite clock, c dt_s added to the pseudorange. Its periodic relativistic "
        "part is `pseudorange.relativity`, the delay between the signals `pseudorange.group_delay`. Neglected: what "
        "the message is wrong by, some decimetres; a satellite that is off by more is `pseudorange.satellite_fault`."
    ),
    source="IS-GPS-200N, 20.3.3.3.3.1",
    parameters=(Parameter("share", "1", 1.0),),
    needs=("satellite_clock",),
    regressor=regressor,
    kinds=frozenset({"pseudoranges"}),
    separates="more satellites",
)
