"""The ten poses of an accelerometer: which is shown, whether it is still, and which are still wanted.

The course's lab has a board shown in ten poses, each the mean of 100 readings at rest, further apart than a threshold;
a radio's switch starts it and an LED tells of each pose. Here a pose counts when it is held still, nearest to one that
is still wanted; one that moves or was shown before is refused.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray

#: Readings that are averaged: the course's.
READINGS = 100
#: Standard deviation of a still reading, and how far the mean of the newest may be from that of all [m/s^2]: boards
#: on a table read 0.01 to 0.1, one in a hand 0.3 and more; 0.15 m/s^2 of gravity is 0.9 deg.
_SCATTER, _DRIFT = 0.2, 0.15
#: The same of a gyroscope [rad/s]: a hand's is 0.05 and more.
_RATE_SCATTER = 0.03
#: The newest readings, of which these are taken.
_NEWEST = 12
#: So far from each pose a direction may be [deg]: half of what lies between two of them.
_NEAR = 22.5
#: Readings without one for longer are not of one pose [s].
_GAP = 1.0
_S = np.sqrt(0.5)
#: Specific force at rest, over gravity, in the order of the course's figure.
POSES = {
    "level": (0.0, 0.0, -1.0), "upside down": (0.0, 0.0, 1.0), "on its left side": (0.0, 1.0, 0.0),
    "on its right side": (0.0, -1.0, 0.0), "nose down": (-1.0, 0.0, 0.0), "nose up": (1.0, 0.0, 0.0),
    "left side down by 45 deg": (0.0, _S, -_S), "right side down by 45 deg": (0.0, -_S, -_S),
    "nose down by 45 deg": (-_S, 0.0, -_S), "nose up by 45 deg": (_S, 0.0, -_S),
}  # fmt: skip
_NAMES, _DIRECTIONS = tuple(POSES), np.array(list(POSES.values()))


@dataclass(frozen=True)
class Pose:
    """A pose that was taken.

    Attributes
    ----------
    name : of `POSES`
    t : middle of its readings [s]
    mean : (3,) m/s^2
    """

    name: str
    t: float
    mean: FloatArray


class PoseWatch:
    """Takes the ten poses out of readings as they come.

    Parameters
    ----------
    say : is told of each pose that is taken or refused
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self.taken: dict[str, Pose] = {}
        self.state = "moving"
        self._held: list[tuple[float, FloatArray]] = []
        self._told = False  # what is shown was taken or refused already

    @property
    def wanted(self) -> list[str]:
        """Poses that are still to be shown."""
        return [name for name in _NAMES if name not in self.taken]

    @property
    def line(self) -> str:
        """How it stands."""
        held = f", {len(self._held)} of {READINGS} readings" if self.state == "still" else ""
        left = "; ".join(self.wanted)
        return f"{len(self.taken)} of {len(_NAMES)} poses, {self.state}{held}" + (f"; wanted: {left}" if left else "")

    def add(self, t: float, accel: FloatArray, gyro: FloatArray) -> Pose | None:
        """One reading, s, m/s^2 and rad/s; the pose that it completes."""
        if self._held and t - self._held[-1][0] > _GAP:
            self._held.clear()
        self._held.append((t, np.concatenate([accel, gyro])))
        why = self._moves()
        if why:
            self._moved(why)
            return None
        if len(self._held) < _NEWEST or self._told:
            return None
        self.state = "still"
        if len(self._held) < READINGS:
            return None
        return self._judge()

    def _moves(self) -> str:
        """Why the newest readings are not those of a board at rest; empty: they are."""
        newest = np.array([reading for _, reading in self._held[-_NEWEST:]])
        if len(newest) < _NEWEST:
            return ""
        scatter = newest.std(axis=0)
        accel, gyro = float(np.linalg.norm(scatter[:3])), float(np.linalg.norm(scatter[3:]))
        if accel > _SCATTER:
            return f"it reads {accel:.2f} m/s^2 to and fro, where {_SCATTER} is still"
        if gyro > _RATE_SCATTER:
            return (
                f"it turns to and fro by {np.degrees(gyro):.1f} deg/s, where {np.degrees(_RATE_SCATTER):.1f} is still"
            )
        held = np.array([reading[:3] for _, reading in self._held])
        drift = float(np.linalg.norm(newest[:, :3].mean(axis=0) - held.mean(axis=0)))
        return f"it turns: the reading has moved by {drift:.2f} m/s^2" if drift > _DRIFT else ""

    def _moved(self, why: str) -> None:
        if self.state == "still" and len(self._held) > READINGS // 2:
            self._say(f"refused: moved after {len(self._held)} of {READINGS} readings ({why}); hold it still")
        self.state, self._told = "moving", False
        del self._held[: -_NEWEST // 2]

    def _judge(self) -> Pose | None:
        """What is to be done with a pose that was held long enough."""
        self._told = True
        t = np.array([at for at, _ in self._held])
        mean = np.array([reading[:3] for _, reading in self._held]).mean(axis=0)
        self._held.clear()
        angle = np.degrees(np.arccos(np.clip(_DIRECTIONS @ mean / np.linalg.norm(mean), -1.0, 1.0)))
        name = _NAMES[int(np.argmin(angle))]
        if np.min(angle) > _NEAR:
            self.state = "between two poses"
            self._say(
                f"refused: {np.min(angle):.0f} deg from {name}, the nearest pose; wanted: {'; '.join(self.wanted)}"
            )
            return None
        if name in self.taken:
            self.state = "shown before"
            before = self.taken[name].mean
            apart = np.degrees(np.arccos(np.clip(_cosine(mean, before), -1.0, 1.0)))
            self._say(f"refused: {name} was shown before, {apart:.0f} deg from this; wanted: {'; '.join(self.wanted)}")
            return None
        pose = self.taken[name] = Pose(name, float(0.5 * (t[0] + t[-1])), mean)
        self.state = "taken, turn it"
        wanted = f"wanted: {'; '.join(self.wanted)}" if self.wanted else "all are there"
        self._say(f"taken: {name}, {len(self.taken)} of {len(_NAMES)}; {wanted}")
        return pose


def _cosine(a: FloatArray, b: FloatArray) -> float:
    return float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))
