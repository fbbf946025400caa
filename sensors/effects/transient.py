"""<stream>.transient: within an unknown interval, a stream is off by a constant."""

from __future__ import annotations

import math

from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.effects.step import regressor_over
from sinan.sensors.effects.streams import STREAMS

__all__ = ["for_stream", "regressor_over"]


def for_stream(stream: str, t0: float = -math.inf, t1: float = math.inf, size: int | None = None) -> Effect:
    """The transient of one stream over t0 <= t < t1; `Effect.over(t0, t1)` moves it.

    Parameters
    ----------
    stream : accel, gyro, mag, baro, sonar, laser, gps or base
    t0, t1 : s
    size : components that it enters; None: the stream's (gps: the position; 6: the velocity too)
    """
    sizes = STREAMS[stream]
    names = sizes.components if size is None or size == len(sizes.components) else tuple(f"c{i}" for i in range(size))
    n = len(names)
    return Effect(
        name=f"{stream}.transient",
        stream=stream,
        summary=f"The {sizes.title} is disturbed for a while.",
        enters="reading += b  for t0 <= t < t1",
        physics=(
            "reading += b within an unknown interval: iron passed by, a gust, a stretch of multipath, an obstacle "
            "under the beam, a start-up transient. The interval is searched. Exact for a disturbance with sharp edges."
        ),
        source="A. S. Willsky, H. L. Jones, IEEE Trans. Automatic Control 21(1), 1976 (jumps, finite duration)",
        parameters=tuple(Parameter(name, sizes.unit, sizes.plausible) for name in names),
        needs=(),
        regressor=lambda motion: regressor_over(motion, t0, t1, n),
        kinds=sizes.kinds,
        scenario="base_receiver" if stream == "base" else "figure_eight",
        separates="the disturbance again, and a stretch without it",
        interval=(t0, t1),
        localised=lambda start, end: for_stream(stream, start, end, size),
        in_field_units=stream == "mag",
    )
