"""The six faces of a magnetometer: on each, a full turn about the vertical; how much of it is there.

The course's lab lays a board on six faces and turns it round on each. Here a face is known by the accelerometer, and
the turn on it by the direction of the field about the vertical, in eight sectors.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sinan.calibration.poses.triad import ellipsoid_start
from sinan.sensors.arrays import FloatArray

#: Specific force at rest, over gravity, of each face.
FACES = {
    "level": (0.0, 0.0, -1.0), "upside down": (0.0, 0.0, 1.0), "on its left side": (0.0, 1.0, 0.0),
    "on its right side": (0.0, -1.0, 0.0), "nose down": (-1.0, 0.0, 0.0), "nose up": (1.0, 0.0, 0.0),
}  # fmt: skip
SECTORS = 8
_NAMES, _UP = tuple(FACES), np.array(list(FACES.values()))
#: How far from a face the vertical may be [deg].
_NEAR = 30.0
#: The centre of the field is known by a sphere where its readings spread over so much of their diameter on every axis;
#: until then it is taken between the least and the greatest.
_ROUND = 0.7
#: Readings of one sector beyond these say nothing new.
_ENOUGH = 400


class FaceWatch:
    """Which part of the sphere was shown, of readings as they come.

    Parameters
    ----------
    say : is told of each face that is done
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._faces: list[int] = []
        self._readings: list[FloatArray] = []
        self._done: set[str] = set()
        self.seen = np.zeros((len(_NAMES), SECTORS), dtype=bool)
        self.state = "no reading yet"

    @property
    def wanted(self) -> list[str]:
        """Faces that are still to be turned, with what is missing of each."""
        rest = [(name, int(np.sum(~row))) for name, row in zip(_NAMES, self.seen, strict=True)]
        return [name if n == SECTORS else f"{name} ({n} of {SECTORS} headings)" for name, n in rest if n]

    @property
    def line(self) -> str:
        """How it stands."""
        share = f"{np.sum(self.seen)} of {self.seen.size} directions, {self.state}"
        return share + (f"; wanted, turned round: {'; '.join(self.wanted)}" if self.wanted else "")

    @property
    def drawing(self) -> list[str]:
        """A line a face, a mark a heading: # was shown, . is wanted."""
        marks = ["".join(".#"[int(one)] for one in row) for row in self.seen]
        return [f"{name:18} {row}" for name, row in zip(_NAMES, marks, strict=True)]

    def add(self, accel: FloatArray, mag: FloatArray) -> None:
        """One reading of the field, any unit, with the specific force at the same time [m/s^2]."""
        size = float(np.linalg.norm(accel))
        cosine = _UP @ accel / size if size > 0.0 else np.zeros(len(_NAMES))
        face = int(np.argmax(cosine))
        if cosine[face] < np.cos(np.radians(_NEAR)):
            self.state = "between two faces"
            return
        self.state = _NAMES[face]
        self._faces.append(face)
        self._readings.append(np.asarray(mag, dtype=np.float64))

    def update(self) -> None:
        """Count anew, as the centre of the field becomes better known."""
        if len(self._readings) < SECTORS:
            return
        if len(self._readings) > _ENOUGH * self.seen.size:
            self._faces, self._readings = self._faces[::2], self._readings[::2]
        readings, faces = np.array(self._readings), np.array(self._faces)
        r = readings - _centre(readings)
        seen = np.zeros_like(self.seen)
        for face, up in enumerate(_UP):
            mine = r[faces == face]
            if len(mine):
                first, second = np.roll(up, 1), np.roll(up, 2)
                angle = np.arctan2(mine @ second, mine @ first)
                seen[face, np.unique((np.floor((angle + np.pi) / (2.0 * np.pi) * SECTORS)).astype(int) % SECTORS)] = (
                    True
                )
        self.seen = seen
        for name, row in zip(_NAMES, seen, strict=True):
            if np.all(row) and name not in self._done:
                self._done.add(name)
                self._say(f"turned round: {name}; {'wanted: ' + '; '.join(self.wanted) if self.wanted else 'all done'}")


def _centre(readings: FloatArray) -> FloatArray:
    """(3,) of the sphere on which readings lie."""
    low, high = readings.min(axis=0), readings.max(axis=0)
    width = high - low
    if np.min(width) < _ROUND * np.max(width):
        return np.asarray(0.5 * (low + high))
    _, offset = ellipsoid_start(readings, float(0.5 * np.max(width)))
    return -offset
