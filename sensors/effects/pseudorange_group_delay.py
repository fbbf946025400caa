"""`pseudorange.group_delay`: the broadcast clock is that of another signal than the one measured."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import SPEED_OF_LIGHT
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion


def regressor(motion: Motion) -> FloatArray:
    """(n, 1, 1) c T_GD [m] of the signal that was measured."""
    return (SPEED_OF_LIGHT * motion.covariates["group_delay"])[:, None, None]


EFFECT = Effect(
    name="pseudorange.group_delay",
    stream="pseudorange",
    summary="The pseudorange of one frequency shows the satellite's delay between its signals.",
    enters="range += b c T_GD,  b = 1 in full",
    physics=(
        "The clock polynomial is meant for a combination of two signals (GPS L1 P and L2 P, Galileo E1 and E5) or for "
        "another one (BeiDou B3I); a receiver of one signal sees c T_GD (BGD) more, up to some metres, different for "
        "each satellite. Their common part goes into the receiver clock. Neglected: the bias between the C/A and the P "
        "code (some decimetres)."
    ),
    source="IS-GPS-200N, 20.3.3.3.3.2; Galileo OS SIS ICD 2.1, 5.1.5; BDS-SIS-ICD-B1I-3.0, 5.2.4.10",
    parameters=(Parameter("share", "1", 1.0),),
    needs=("group_delay",),
    regressor=regressor,
    kinds=frozenset({"pseudoranges"}),
    separates="more satellites of different blocks",
)
