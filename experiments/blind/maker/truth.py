"""The sealed truth of a recording, as the columns of `truth.csv`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sinan.experiments.blind.maker.catalogue import Hidden
from sinan.experiments.blind.maker.measure import STAMP_DECIMALS, Reported
from sinan.experiments.blind.maker.outside import Outside
from sinan.experiments.blind.maker.scene import Scene
from sinan.experiments.blind.maker.turning import quaternion
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import POSITION, VELOCITY, Stream

#: Rows a second: motion of a few hertz is linear between them to a centimetre.
TRUTH_RATE = 50.0
_AXES = {3: ("x", "y", "z"), 1: ("",)}


def truth_stream(scene: Scene, reported: Mapping[str, Reported], clock: float) -> Stream:
    """Position, velocity, attitude, and the biases that the sensors really had.

    Parameters
    ----------
    scene : the motion, whose time starts at zero
    reported : streams with their biases
    clock : what the recording's clock shows at time zero [s]
    """
    t = np.arange(scene.begin, scene.end, 1.0 / TRUTH_RATE)
    body = scene.motion(t)
    columns: dict[str, FloatArray] = {}
    columns |= dict(zip(POSITION, body.p.T, strict=True))
    columns |= dict(zip(VELOCITY, body.v.T, strict=True))
    columns |= dict(zip(("qw", "qx", "qy", "qz"), quaternion(body.C).T, strict=True))
    for sensor, found in reported.items():
        if sensor == "base":
            continue
        names = ("north", "east", "down") if sensor == "gps" else _AXES[found.bias.shape[1]]
        for name, bias in zip(names, found.bias.T, strict=True):
            columns[f"bias_{sensor}" + (f"_{name}" if name else "")] = np.interp(t, found.t, bias)
    return Stream(np.round(t + clock, STAMP_DECIMALS), columns)


def hidden_on_clock(hidden: Sequence[Hidden], reported: Mapping[str, Reported], clock: float) -> tuple[Hidden, ...]:
    """Hidden effects with their intervals on the recording's clock, and the readings that they made wrong."""
    found = []
    for effect in hidden:
        if effect.interval is not None:
            effect = replace(effect, interval=(effect.interval[0] + clock, effect.interval[1] + clock))
        if effect.effect == "outliers":
            sizes = np.linalg.norm(reported[effect.stream].wrong, axis=1)
            effect = replace(effect, wrong=tuple(sizes[sizes > 0.0].tolist()))
        found.append(effect)
    return tuple(found)


def outside_on_clock(outside: Outside | None, clock: float) -> Outside | None:
    """A disturbance with its intervals on the recording's clock."""
    if outside is None:
        return None
    return replace(outside, intervals=tuple((begin + clock, end + clock) for begin, end in outside.intervals))
