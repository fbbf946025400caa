"""Manoeuvres: where a multicopter is told to be. Each continues where the one before it ended.

A manoeuvre says a command (north, east, down, yaw, lift) as a function of its own time; `sensors.trajectory` rounds the
command off. `lift` is the share of the weight that the rotors carry: 0 on the ground, 1 in the air.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sinan.sensors.arrays import FloatArray

#: columns of a command
NORTH, EAST, DOWN, YAW, LIFT = range(5)
#: (time since its start (n,), state at its start (5,), keys) -> command (n, 5)
Command = Callable[[FloatArray, FloatArray, Mapping[str, float]], FloatArray]


@dataclass(frozen=True)
class Manoeuvre:
    """One manoeuvre of a scenario.

    Attributes
    ----------
    kind : a name of `KINDS`
    duration : s
    keys : its numbers, by name; what is not given has the default of `DEFAULTS`
    """

    kind: str
    duration: float
    keys: Mapping[str, float] = field(default_factory=dict)

    def command(self, t: FloatArray, start: FloatArray) -> FloatArray:
        """(n, 5) the command at the times t since its start."""
        return KINDS[self.kind](t, start, {**DEFAULTS[self.kind], "duration": self.duration, **self.keys})


def hold(t: FloatArray, start: FloatArray, keys: Mapping[str, float]) -> FloatArray:
    """Stay."""
    return np.tile(start, (len(t), 1))


def leg(t: FloatArray, start: FloatArray, keys: Mapping[str, float]) -> FloatArray:
    """Straight on by `north`, `east`, `up` [m] while turning by `yaw` [deg], at even speed."""
    share = np.clip(t / keys["duration"], 0.0, 1.0)[:, None]
    by = np.array([keys["north"], keys["east"], -keys["up"], np.deg2rad(keys["yaw"]), 0.0])
    return start + share * by


def square(t: FloatArray, start: FloatArray, keys: Mapping[str, float]) -> FloatArray:
    """`laps` squares of `side` [m], first north, then east; `rest` [s] at each corner, turning by `yaw` [deg] there."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) * keys["side"]
    legs = int(4 * keys["laps"])
    each = keys["duration"] / legs
    flying = max(each - keys["rest"], 0.1 * each)
    k = np.minimum((t / each).astype(np.int64), legs - 1)
    share = np.clip((t - k * each) / flying, 0.0, 1.0)[:, None]
    out = np.tile(start, (len(t), 1))
    out[:, :2] += corners[k % 4] * (1.0 - share) + corners[(k + 1) % 4] * share
    turned = np.clip((t - k * each - flying) / max(each - flying, 1e-9), 0.0, 1.0)
    out[:, YAW] += np.deg2rad(keys["yaw"]) * (k + turned)
    return out


def figure_eight(t: FloatArray, start: FloatArray, keys: Mapping[str, float]) -> FloatArray:
    """`laps` eights of `length` (north) by `width` (east), up and down by `up` [m], turning by `yaw` [deg] a lap."""
    phase = 2.0 * np.pi * keys["laps"] * _eased(t / keys["duration"])
    out = np.tile(start, (len(t), 1))
    out[:, NORTH] += 0.5 * keys["length"] * np.sin(phase)
    out[:, EAST] += 0.5 * keys["width"] * np.sin(2.0 * phase)
    out[:, DOWN] -= 0.5 * keys["up"] * (1.0 - np.cos(phase))
    out[:, YAW] += np.deg2rad(keys["yaw"]) * phase / (2.0 * np.pi)
    return out


def circle(t: FloatArray, start: FloatArray, keys: Mapping[str, float]) -> FloatArray:
    """`laps` circles of `radius` [m] that begin eastward, turning by `yaw` [deg] a lap."""
    phase = 2.0 * np.pi * keys["laps"] * _eased(t / keys["duration"])
    out = np.tile(start, (len(t), 1))
    out[:, NORTH] += keys["radius"] * (1.0 - np.cos(phase))
    out[:, EAST] += keys["radius"] * np.sin(phase)
    out[:, YAW] += np.deg2rad(keys["yaw"]) * phase / (2.0 * np.pi)
    return out


def shake(t: FloatArray, start: FloatArray, keys: Mapping[str, float]) -> FloatArray:
    """To and fro by `north`, `east`, `up` [m], `yaw` [deg], with periods around `period` [s] that are never in step."""
    by = np.array([keys["north"], keys["east"], -keys["up"], np.deg2rad(keys["yaw"])])
    rate = (
        2.0 * np.pi / keys["period"] * np.array([1.0, 1.272, 0.786, 0.618])
    )  # powers of 1.272, the golden ratio's root
    fade = np.sin(np.pi * np.clip(t / keys["duration"], 0.0, 1.0)) ** 0.5
    out = np.tile(start, (len(t), 1))
    out[:, :4] += by * np.sin(t[:, None] * rate) * fade[:, None]
    return out


def take_off(t: FloatArray, start: FloatArray, keys: Mapping[str, float]) -> FloatArray:
    """Spin up for `spin_up` [s], then climb by `up` [m]."""
    out = np.tile(start, (len(t), 1))
    out[:, LIFT] = np.clip(t / keys["spin_up"], 0.0, 1.0)
    out[:, DOWN] -= keys["up"] * np.clip((t - keys["spin_up"]) / (keys["duration"] - keys["spin_up"]), 0.0, 1.0)
    return out


def land(t: FloatArray, start: FloatArray, keys: Mapping[str, float]) -> FloatArray:
    """Descend by `down` [m], then let the rotors run out for `spin_down` [s]."""
    falling = keys["duration"] - keys["spin_down"]
    out = np.tile(start, (len(t), 1))
    out[:, DOWN] += keys["down"] * np.clip(t / falling, 0.0, 1.0)
    out[:, LIFT] = 1.0 - np.clip((t - falling) / keys["spin_down"], 0.0, 1.0)
    return out


def _eased(share: FloatArray) -> FloatArray:
    """0 to 1 with a soft start and end: even in the middle, a quarter cosine over the first and last tenth."""
    s = np.clip(share, 0.0, 1.0)
    ramp = 0.1
    begin = ramp / 2.0 * (s / ramp - np.sin(np.pi * s / ramp) / np.pi)
    middle = s - ramp / 2.0
    end = 1.0 - ramp - ramp / 2.0 * ((1.0 - s) / ramp - np.sin(np.pi * (1.0 - s) / ramp) / np.pi)
    area = 1.0 - ramp
    return np.where(s < ramp, begin, np.where(s > 1.0 - ramp, end, middle)) / area


KINDS: Mapping[str, Command] = {
    "hold": hold,
    "leg": leg,
    "square": square,
    "figure_eight": figure_eight,
    "circle": circle,
    "shake": shake,
    "take_off": take_off,
    "land": land,
}
#: what a manoeuvre's keys are where the scenario does not say: m, deg, s
DEFAULTS: Mapping[str, Mapping[str, float]] = {
    "hold": {},
    "leg": {"north": 0.0, "east": 0.0, "up": 0.0, "yaw": 0.0},
    "square": {"side": 10.0, "laps": 1.0, "rest": 1.0, "yaw": 0.0},
    "figure_eight": {"length": 20.0, "width": 10.0, "laps": 1.0, "up": 0.0, "yaw": 0.0},
    "circle": {"radius": 5.0, "laps": 1.0, "yaw": 0.0},
    "shake": {"north": 0.0, "east": 0.0, "up": 0.0, "yaw": 0.0, "period": 3.0},
    "take_off": {"up": 3.0, "spin_up": 2.0},
    "land": {"down": 3.0, "spin_down": 2.0},
}


def commands(manoeuvres: Sequence[Manoeuvre], start: FloatArray, t: FloatArray) -> FloatArray:
    """(n, 5) the command of a row of manoeuvres at the times t; before and after them it holds.

    Parameters
    ----------
    manoeuvres : in order
    start : (5,) north, east, down [m], yaw [rad], lift at the beginning
    t : (n,) s
    """
    out = np.tile(start, (len(t), 1))
    begin, state = 0.0, np.asarray(start, dtype=np.float64)
    for manoeuvre in manoeuvres:
        end = begin + manoeuvre.duration
        rows = (t >= begin) & (t <= end)
        out[rows] = manoeuvre.command(t[rows] - begin, state)
        state = np.asarray(manoeuvre.command(np.array([manoeuvre.duration]), state)[0])
        out[t > end] = state
        begin = end
    return out
