"""<stream>.step: from an unknown instant on, a stream is off by a constant."""

from __future__ import annotations

import math

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.effects.streams import STREAMS
from sinan.sensors.motion import Motion


def regressor_over(motion: Motion, t0: float, t1: float, size: int) -> FloatArray:
    """(n, size, size): the identity at t0 <= t < t1, zero elsewhere."""
    within = (motion.t >= t0) & (motion.t < t1)
    return within[:, None, None] * np.eye(size)


def for_stream(stream: str, t0: float = -math.inf, t1: float = math.inf, size: int | None = None) -> Effect:
    """The step of one stream, from t0 on; `Effect.over(t0, t1)` moves it.

    Parameters
    ----------
    stream : accel, gyro, mag, baro, sonar, laser, gps or base
    t0, t1 : the onset and, for a step that is looked at over a part of the recording, the end [s]
    size : components that it enters; None: the stream's (gps: the position; 6: the velocity too)
    """
    sizes = STREAMS[stream]
    names = sizes.components if size is None or size == len(sizes.components) else tuple(f"c{i}" for i in range(size))
    n = len(names)
    return Effect(
        name=f"{stream}.step",
        stream=stream,
        summary=f"The {sizes.title} is off by a constant from some instant on.",
        enters="reading += b  for t >= t0",
        physics=(
            "reading += b from an unknown instant on: a knock, a shock of temperature, a part that moved, a receiver "
            "that changed its satellites. The instant is searched. Exact; neglects the transition."
        ),
        source="A. S. Willsky, H. L. Jones, IEEE Trans. Automatic Control 21(1), 1976 (jumps)",
        parameters=tuple(Parameter(name, sizes.unit, sizes.plausible) for name in names),
        needs=(),
        regressor=lambda motion: regressor_over(motion, t0, t1, n),
        kinds=sizes.kinds,
        scenario="base_receiver" if stream == "base" else "figure_eight",
        separates="a longer stretch before and after the step",
        interval=(t0, t1),
        localised=lambda start, end: for_stream(stream, start, end, size),
        in_field_units=stream == "mag",
    )
