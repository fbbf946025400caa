"""Things that stand still or are turned slowly: what a calibration by norms is made from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.experiments.blind.maker.body import Body
from sinan.experiments.blind.maker.curves import Curve, Sine
from sinan.experiments.blind.maker.turning import exp_rotation, random_rotation
from sinan.sensors.arrays import FloatArray


def at_rest(t: FloatArray, C: FloatArray, gravity: float) -> Body:
    """A body that does not accelerate: f = -C^T g_n, with attitudes (n, 3, 3)."""
    zero = np.zeros((len(t), 3))
    f = -np.einsum("nji,j->ni", C, np.array([0.0, 0.0, gravity]))
    return Body(t, zero, zero, zero, C, f, zero, zero, zero, np.zeros(len(t)))


@dataclass(frozen=True)
class Poses:
    """One attitude a row, row k at time k `spacing`; call it with instants.

    Attributes
    ----------
    C : (m, 3, 3)
    spacing : s between rows; 1 where the row number is the time
    gravity : m/s^2
    """

    C: FloatArray
    spacing: float
    gravity: float

    def __call__(self, t: FloatArray) -> Body:
        row = np.clip(np.rint(t / self.spacing).astype(int), 0, len(self.C) - 1)
        return at_rest(t, self.C[row], self.gravity)


@dataclass(frozen=True)
class Tumbling:
    """Slow turns about all axes, C = Exp(yaw z) Exp(pitch y) Exp(roll x); its rates are not given to any instrument."""

    rpy: tuple[Curve, Curve, Curve]
    gravity: float

    def __call__(self, t: FloatArray) -> Body:
        roll, pitch, yaw = (curve.derivatives(t, 0)[0][:, None] for curve in self.rpy)
        C = exp_rotation(yaw * [0.0, 0.0, 1.0]) @ exp_rotation(pitch * [0.0, 1.0, 0.0])
        return at_rest(t, C @ exp_rotation(roll * [1.0, 0.0, 0.0]), self.gravity)


def draw_poses(rng: np.random.Generator, count: int, spacing: float, gravity: float) -> Poses:
    """Random attitudes; every second set begins with the six faces of a box."""
    C = np.stack([random_rotation(rng) for _ in range(count)])
    if rng.uniform() < 0.5:
        faces = [[0, 0, 0], [np.pi, 0, 0], [0.5 * np.pi, 0, 0], [-0.5 * np.pi, 0, 0],
                 [0, 0.5 * np.pi, 0], [0, -0.5 * np.pi, 0]]  # fmt: skip
        C[:6] = exp_rotation(np.asarray(faces, dtype=np.float64) + rng.normal(0.0, 0.03, (6, 3)))
    return Poses(C, spacing, gravity)


def draw_tumbling(rng: np.random.Generator, length: float, gravity: float) -> Tumbling:
    """Several times round on every axis within `length` seconds."""

    def course(reach: float) -> Curve:
        swings = [
            Sine(float(reach * a), 2.0 * np.pi * float(rng.uniform(1.0, 9.0)) / length, float(rng.uniform(0.0, 6.28)))
            for a in rng.uniform(0.4, 1.0, size=3)
        ]
        return Curve(float(rng.uniform(-np.pi, np.pi)), swings)

    return Tumbling((course(2.0), course(1.0), course(2.5)), gravity)
