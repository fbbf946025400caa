"""`pseudorange.relativity`: the satellite's clock on an eccentric orbit runs unevenly."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import SPEED_OF_LIGHT
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion


def regressor(motion: Motion) -> FloatArray:
    """(n, 1, 1) 2 (r_s . v_s) / c [m]; the same in a turning frame, where v_s lacks only w x r_s."""
    satellite_e, velocity_e = motion.covariates["satellite_position"], motion.covariates["satellite_velocity"]
    delay = 2.0 * np.sum(satellite_e * velocity_e, axis=1) / SPEED_OF_LIGHT
    return np.asarray(delay[:, None, None])


EFFECT = Effect(
    name="pseudorange.relativity",
    stream="pseudorange",
    summary="The pseudorange shows the periodic relativistic error of the satellite's clock.",
    enters="range += b 2 (r_s . v_s) / c,  b = 1 in full",
    physics=(
        "Speed and gravitational potential change along an eccentric orbit and with them the rate of the clock: dt = "
        "-2 r.v / c^2, up to 45 ns (14 m) for e = 0.02. Its mean is in the clock's factory offset. Neglected: the "
        "oblateness of the Earth (0.1 ns) and the delay of light in the Earth's gravity (below 2 cm). GLONASS sends "
        "clocks with this already applied."
    ),
    source="IS-GPS-200N, 20.3.3.3.3.1; N. Ashby, Living Reviews in Relativity 6 (2003) 1, eq. 46",
    parameters=(Parameter("share", "1", 1.0),),
    needs=("satellite_position", "satellite_velocity"),
    regressor=regressor,
    kinds=frozenset({"pseudoranges"}),
    separates="satellites of eccentric orbits, or several hours",
)
