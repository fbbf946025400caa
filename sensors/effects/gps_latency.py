"""gps.latency: position and velocity are those of an earlier instant; of a receiver whose velocity is older than its
position (`Gps.lead`) b is the velocity's, and the position is of t - b + lead.
"""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.effects.streams import textbook_model
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion

PLAUSIBLE = 0.2  # s; u-blox receivers report 0.05 to 0.25 s late over a serial line


def regressor(motion: Motion) -> FloatArray:
    """(n, 6, 1): position -v, velocity -a; the first three rows are a receiver without velocity."""
    return -np.concatenate([motion.v_n, motion.acceleration_n()], axis=1)[:, :, None]


def exact(plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None) -> FloatArray:
    """Position and velocity at t - b, the position `lead` later."""
    earlier = motion.at(motion.t - beta[0])
    return (model or textbook_model("gps", plain.shape[1], motion)).predict(earlier)


EFFECT = Effect(
    name="gps.latency",
    stream="gps",
    summary="The GPS reports late.",
    opposite="The GPS's time stamps are early.",
    enters="position and velocity -> those of t - b,  b > 0",
    physics=(
        "Position and velocity are those of t - b (of the antenna, where there is a lever arm), b > 0: the receiver "
        "computes and transmits before the log stamps. The state at t - b is used, not its first order. Where a log "
        "declares no noise its velocities may be older than its positions, as its notes say: b then is how late the "
        "velocity is."
    ),
    source="I. Skog, P. Handel, IEEE Trans. Intelligent Transportation Systems 12, 2011 (time synchronisation errors)",
    parameters=(Parameter("b", "s", PLAUSIBLE),),
    needs=("p_n", "v_n", "q_nb", "f_b"),
    regressor=regressor,
    exact=exact,
    other_instants=True,
    scenario="square",
    separates="accelerations along both horizontal axes",
)
