"""What is flown when: manoeuvres by name, from a scenario or from the motion itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.manoeuvres import Manoeuvre
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import rotate
from sinan.sensors.scenario import Scenario

#: Window over which a motion is given a name [s].
WINDOW = 2.0
#: What makes a window more than rest: about the tilt, turn or speed that a person would call a manoeuvre.
ACCELERATION = 0.5  # m/s^2, root mean square in the horizontal: 3 deg of tilt
TURN_RATE = 0.1  # rad/s, root mean square about the vertical
TILT_RATE = 0.2  # rad/s, root mean square about the horizontal
SPEED = 0.5  # m/s
#: More stretches than this are shown by kind, not one by one.
MOST_SEGMENTS = 14
_WORDS = {"hold": "hold", "circle": "circle", "square": "square", "figure_eight": "figure of eight",
          "shake": "to and fro", "take_off": "take-off", "land": "landing"}  # fmt: skip


@dataclass(frozen=True)
class Segment:
    """A stretch of the flight: what is flown, and from when to when [s]."""

    name: str
    start: float
    stop: float


def manoeuvre_name(manoeuvre: Manoeuvre) -> str:
    """What a person would call a manoeuvre: a leg is a climb, a yaw turn or a leg by what it does."""
    if manoeuvre.kind != "leg":
        return _WORDS[manoeuvre.kind]
    north, east, up, yaw = (manoeuvre.keys.get(key, 0.0) for key in ("north", "east", "up", "yaw"))
    along, turning = float(np.hypot(north, east)), abs(yaw) >= 30.0
    if along == 0.0 and up == 0.0:
        return "yaw turn" if yaw else "hold"
    if abs(up) >= along:
        word = "climb" if up > 0.0 else "descent"
    else:
        word = "leg"
    return f"{word} with turn" if turning else word


def of_scenario(scenario: Scenario) -> tuple[Segment, ...]:
    """The manoeuvres of a scenario; none where it is turned by hand or on a table."""
    ends = np.cumsum([0.0, *(manoeuvre.duration for manoeuvre in scenario.manoeuvres)])
    return tuple(
        Segment(manoeuvre_name(manoeuvre), float(start), float(stop))
        for manoeuvre, start, stop in zip(scenario.manoeuvres, ends[:-1], ends[1:], strict=True)
    )


def within(segments: Sequence[Segment], start: float, stop: float) -> tuple[Segment, ...]:
    """What of them is flown between two instants [s]."""
    return tuple(
        Segment(segment.name, max(segment.start, start), min(segment.stop, stop))
        for segment in segments
        if segment.start < stop and segment.stop > start
    )


def of_motion(motion: Motion) -> tuple[Segment, ...]:
    """Stretches of like motion: rest, cruise, yaw turn, tilting, acceleration, climb, descent.

    Each window of `WINDOW` is called after what exceeds its own bound the most; equal neighbours are one stretch.
    """
    t = motion.t
    count = max(1, round((t[-1] - t[0]) / WINDOW))
    edges = np.linspace(t[0], t[-1], count + 1)
    rows = np.searchsorted(t, edges)
    w_n = rotate(motion.q_nb, motion.w_ib_b)
    a_n = motion.acceleration_n()
    names = [
        _name(motion.v_n[i:j], a_n[i:j], w_n[i:j])
        for i, j in zip(rows[:-1], np.maximum(rows[1:], rows[:-1] + 1), strict=True)
    ]
    starts = [0, *[k for k in range(1, count) if names[k] != names[k - 1]]]
    stops = [*starts[1:], count]
    return tuple(Segment(names[a], float(edges[a]), float(edges[b])) for a, b in zip(starts, stops, strict=True))


def _name(v_n: FloatArray, a_n: FloatArray, w_n: FloatArray) -> str:
    """The name of one window."""
    quarters = [part.mean(axis=0) for part in np.array_split(a_n, min(8, len(a_n)))]  # the sensor's noise averages out
    turned = [part.mean(axis=0) for part in np.array_split(w_n, min(8, len(w_n)))]
    a, w = np.array(quarters), np.array(turned)
    climb = -float(v_n[:, 2].mean())
    size = {
        "acceleration": float(np.sqrt(np.mean(np.sum(a[:, :2] ** 2, axis=1)))) / ACCELERATION,
        "yaw turn": float(np.sqrt(np.mean(w[:, 2] ** 2))) / TURN_RATE,
        "tilting": float(np.sqrt(np.mean(np.sum(w[:, :2] ** 2, axis=1)))) / TILT_RATE,
        "climb" if climb > 0.0 else "descent": abs(climb) / SPEED,
    }
    name = max(size, key=lambda key: size[key])
    if size[name] >= 1.0:
        return name
    return "cruise" if float(np.mean(np.hypot(v_n[:, 0], v_n[:, 1]))) >= SPEED else "rest"


def columns(segments: Sequence[Segment]) -> Mapping[str, list[int]]:
    """Columns of a table of manoeuvres: one a stretch, numbered; one a kind where they are many."""
    if len(segments) <= MOST_SEGMENTS:
        return {f"{k + 1} {segment.name}": [k] for k, segment in enumerate(segments)}
    kinds: dict[str, list[int]] = {}
    for k, segment in enumerate(segments):
        kinds.setdefault(segment.name, []).append(k)
    return {f"{name} ({len(places)} times)" if len(places) > 1 else name: places for name, places in kinds.items()}
