"""The interface of all sensor models: prediction, Jacobian by state block, noise, bias process."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from sinan.sensors.arrays import FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.noise import BiasProcess


class SensorModel(Protocol):
    """A measurement model, vectorised over the instants of a `Motion`.

    reading = predict(motion) + bias + noise; the effects of the catalogue come on top of `predict`.
    """

    @property
    def name(self) -> str:
        """The sensor: accel, gyro, mag, baro, sonar, laser, gps, base, level."""

    @property
    def size(self) -> int:
        """Number of components of one reading."""

    @property
    def R(self) -> FloatArray:
        """(size, size) covariance of the white noise of one reading."""

    @property
    def bias(self) -> BiasProcess | None:
        """The random walk of its bias; None: the sensor has no bias state."""

    def predict(self, motion: Motion) -> FloatArray:
        """(n, size) what an ideal sensor reads along the motion: no noise, no bias.

        Parameters
        ----------
        motion : (n) of the body's reference point, at the instants of the readings
        """

    def jacobian(self, motion: Motion) -> Mapping[str, FloatArray]:
        """d reading / d error state by block: position, velocity, attitude (`dtheta_b`) and the bias's own block.

        Each (n, size, block size). Blocks that are not named are zero.

        Parameters
        ----------
        motion : (n) of the body's reference point, at the instants of the readings
        """
