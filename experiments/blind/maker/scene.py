"""What surrounds the instruments: field, ground, temperatures, current, throttle, vibration, as functions of time."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from sinan.experiments.blind.maker.body import Body, Motion
from sinan.experiments.blind.maker.curves import Curve
from sinan.sensors.arrays import FloatArray

#: Throttle at which a multirotor of usual thrust reserve hovers.
HOVER_THROTTLE = 0.45
#: Momentum theory: power, and at constant voltage current, goes with thrust^(3/2).
POWER_EXPONENT = 1.5


class Shaking(Protocol):
    """A vibration."""

    def variance(self, t: FloatArray) -> FloatArray:
        """(n, 3) P (m/s^2)^2."""


class Surroundings(Protocol):
    """What the effects need of a scene: drawn, or as a log has it."""

    @property
    def motion(self) -> Motion:
        """What moves."""

    @property
    def field_n(self) -> FloatArray:
        """(3,) NED, in the magnetometer's unit."""

    @property
    def ground_down(self) -> float:
        """Down coordinate of the ground [m]."""

    @property
    def vibration(self) -> Shaking | None:
        """Of the airframe."""

    def current(self, body: Body) -> FloatArray:
        """(n,) supply current [A]."""

    def throttle(self, body: Body) -> FloatArray:
        """(n, motors) 0 to 1."""


@dataclass(frozen=True)
class WarmUp:
    """Temperature ambient + rise (1 - exp(-(t + before) / tau)) + a slow swing [degC]."""

    ambient: float
    rise: float
    before: float
    tau: float
    swing: Curve

    def __call__(self, t: FloatArray) -> FloatArray:
        warming = self.rise * (1.0 - np.exp(-(t + self.before) / self.tau))
        return np.asarray(self.ambient + warming + self.swing.derivatives(t, 0)[0])


@dataclass(frozen=True)
class Vibration:
    """A tone on each axis whose size follows `level`; its variance is level^2 / 2 times the axis' share squared.

    Attributes
    ----------
    level : amplitude [m/s^2]
    share : (3,) of each axis
    omega : (3,) rad/s
    drift : slow swing of the phase, so that the tone is not locked to the samples [rad]
    """

    level: Curve
    share: FloatArray
    omega: FloatArray
    drift: Curve

    def amplitude(self, t: FloatArray) -> FloatArray:
        """(n, 3) m/s^2."""
        return np.outer(self.level.derivatives(t, 0)[0], self.share)

    def variance(self, t: FloatArray) -> FloatArray:
        """(n, 3) P (m/s^2)^2."""
        return 0.5 * self.amplitude(t) ** 2

    def signal(self, t: FloatArray) -> FloatArray:
        """(n, 3) m/s^2."""
        phase = np.outer(t, self.omega) + self.drift.derivatives(t, 0)[0][:, None]
        return self.amplitude(t) * np.sin(phase)


@dataclass(frozen=True)
class Scene:
    """A motion and its surroundings.

    Attributes
    ----------
    motion : what moves
    begin, end : of the recording [s]
    gravity : m/s^2
    field_n : (3,) NED, in the magnetometer's unit
    ground_down : down coordinate of the ground [m]
    temperature_imu, temperature_baro : degC
    idle, load : current without thrust and its share that goes with thrust [A]
    payload : current of what else is on board [A]
    vibration : of the airframe, or None
    """

    motion: Motion
    begin: float
    end: float
    gravity: float
    field_n: FloatArray
    ground_down: float
    temperature_imu: WarmUp
    temperature_baro: WarmUp
    idle: float = 0.0
    load: float = 0.0
    payload: Curve = field(default_factory=Curve)
    vibration: Vibration | None = None

    def current(self, body: Body) -> FloatArray:
        """(n,) supply current [A]."""
        rotors = self.load * np.maximum(body.thrust / self.gravity, 0.0) ** POWER_EXPONENT
        return np.asarray(self.idle + rotors + self.payload.derivatives(body.t, 0)[0])

    def throttle(self, body: Body) -> FloatArray:
        """(n, 4) 0 to 1: thrust goes with its square, and turning about an axis takes more of some rotors."""
        mean = HOVER_THROTTLE * np.sqrt(np.maximum(body.thrust / self.gravity, 0.0))
        mix = np.array([[-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0], [-1.0, -1.0, -1.0]])
        return np.clip(mean[:, None] + 2e-3 * body.dw @ mix.T, 0.0, 1.0)
