"""The pseudo-sensor `level`: the course's assumption that the accelerometer shows gravity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.noise import BiasProcess
from sinan.sensors.rotation import rotate_back, skew


@dataclass(frozen=True)
class Level:
    """Mean acceleration over a short window is zero within a stated sigma, so the mean specific force is -C_bn g_n.

    f_mean = -C_bn g_n + b_accel + n

    The white noise stands for the acceleration itself and is far larger than the accelerometer's. It is a sensor like
    any other: named, journalled, in the report; on only where no position aiding sees the tilt.

    Neglects motion.rotor_drag, motion.wind and every true acceleration longer than the window.

    Attributes
    ----------
    sigma : standard deviation of the mean acceleration per axis [m/s^2]
    window : length of the mean [s]
    """

    sigma: float
    window: float = 0.1
    name: str = "level"
    size: int = 3

    @property
    def R(self) -> FloatArray:
        """(3, 3) (m/s^2)^2."""
        return np.eye(3) * self.sigma**2

    @property
    def bias(self) -> BiasProcess | None:
        """None: its bias is that of the accelerometer, which is a state of its own."""
        return None

    def predict(self, motion: Motion) -> FloatArray:
        """(n, 3) -C_bn g_n [m/s^2]."""
        return -rotate_back(motion.q_nb, np.broadcast_to(motion.g_n, (len(motion), 3)))

    def jacobian(self, motion: Motion) -> Mapping[str, FloatArray]:
        """d f / d dtheta_b = [-C_bn g_n]x, and the accelerometer's bias."""
        return {
            "attitude": skew(self.predict(motion)),
            "b_accel": np.broadcast_to(np.eye(3), (len(motion), 3, 3)),
        }
