"""<stream>.transient: within an unknown interval, a stream is off by a constant."""

from __future__ import annotations

import math
from dataclasses import replace

from sinan.sensors.effects import step
from sinan.sensors.effects.declaration import Effect
from sinan.sensors.effects.streams import STREAMS


def for_stream(stream: str, t0: float = -math.inf, t1: float = math.inf, size: int | None = None) -> Effect:
    """The transient of one stream over t0 <= t < t1; `Effect.over(t0, t1)` moves it.

    Parameters
    ----------
    stream : accel, gyro, mag, baro, sonar, laser, gps or base
    t0, t1 : s
    size : components that it enters; None: the stream's (gps: the position; 6: the velocity too)
    """
    return replace(
        step.for_stream(stream, t0, t1, size),
        name=f"{stream}.transient",
        summary=f"The {STREAMS[stream].title} is disturbed for a while.",
        enters="reading += b  for t0 <= t < t1",
        physics=(
            "reading += b within an unknown interval: iron passed by, a gust, a stretch of multipath, an obstacle "
            "under the beam, a start-up transient. The interval is searched. Exact for a disturbance with sharp edges."
        ),
        source="A. S. Willsky, H. L. Jones, IEEE Trans. Automatic Control 21(1), 1976 (jumps, finite duration)",
        separates="the disturbance again, and a stretch without it",
        localised=lambda start, end: for_stream(stream, start, end, size),
    )
