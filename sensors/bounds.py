"""Bounds of a motion that no position shows: the body stays near a place, and its speed is bounded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.noise import BiasProcess

#: Sensors that are none: what a motion is taken to be where no position is measured.
ASSUMED = ("level", "place", "speed", "zero_rate")
#: Readings of the bounds a second: a swing of the arm lasts about as long as one of them.
RATE = 2.0
#: Sigma of what is not bounded: higher than what flies without GPS [m].
FREE = 1e4


@dataclass(frozen=True)
class _Bound:
    """Three components that are near zero, to `sigma` each."""

    sigma: float
    size: int = 3

    @property
    def R(self) -> FloatArray:
        """(3, 3) sigma^2, in the unit of the components squared."""
        return np.eye(3) * self.sigma**2

    @property
    def bias(self) -> BiasProcess | None:
        """None: the place is the origin, and on average the body does not move."""
        return None

    def wider(self, factor: float) -> Self:
        """The same bound with a sigma so many times as large."""
        return replace(self, sigma=factor * self.sigma)


@dataclass(frozen=True)
class Place(_Bound):
    """The body is near one place, the origin: a pseudo-reading 0 = p_n + n.

    What moves within a metre shows its tilt: an error d of the tilt moves the integrated body by g d t^2 / 2. It is a
    sensor like any other, named, journalled, in the report; on only where no position aids the filter.

    Neglects how the excursions of one second go on in the next: its noise is white.

    Attributes
    ----------
    sigma : standard deviation of each coordinate about the place [m]
    sigma_down : of the third, where a sensor measures the height and nothing else need be said of it; 0: `sigma`
    """

    name: str = "place"
    sigma_down: float = 0.0

    @property
    def R(self) -> FloatArray:
        """(3, 3) squares of the sigmas [m^2]."""
        return np.diag(np.square([self.sigma, self.sigma, self.sigma_down or self.sigma]))

    def predict(self, motion: Motion) -> FloatArray:
        """(n, 3) position, NED [m]."""
        return motion.p_n

    def jacobian(self, motion: Motion) -> Mapping[str, FloatArray]:
        """Identity on the position."""
        return {"position": np.broadcast_to(np.eye(3), (len(motion), 3, 3))}


@dataclass(frozen=True)
class Speed(_Bound):
    """The velocity is bounded: a pseudo-reading 0 = v_n + n; see `Place`.

    Attributes
    ----------
    sigma : standard deviation of each component of the velocity [m/s]
    """

    name: str = "speed"

    def predict(self, motion: Motion) -> FloatArray:
        """(n, 3) velocity, NED [m/s]."""
        return motion.v_n

    def jacobian(self, motion: Motion) -> Mapping[str, FloatArray]:
        """Identity on the velocity."""
        return {"velocity": np.broadcast_to(np.eye(3), (len(motion), 3, 3))}


@dataclass(frozen=True)
class Bounds:
    """Both bounds: the likelier one is the narrower, and a wide one says nothing.

    Attributes
    ----------
    place, speed : their standard deviations [m], [m/s]
    height : whether the height is bounded too: a body that is near a place may climb as far as its barometer shows
    """

    place: float
    speed: float
    height: bool = True

    @property
    def sensors(self) -> Mapping[str, Place | Speed]:
        """As pseudo-sensors by name."""
        return {"place": Place(self.place, sigma_down=0.0 if self.height else FREE), "speed": Speed(self.speed)}
