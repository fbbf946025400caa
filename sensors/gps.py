"""GPS receiver: position and velocity in NED with a position bias that wanders. The course, section 7."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.noise import BiasProcess
from sinan.sensors.sensor_type import NED, PER_READING, SensorType


@dataclass(frozen=True)
class Gps:
    """GPS position, and velocity where the receiver gives it.

    p_gps = p_n + lead v_n + b_gps + n_p,  v_gps = v_n + n_v

    A receiver that derives its velocity from more of the past than its position reports one that is older: the stamp,
    less the lateness, is the instant of the velocity, and the position is of `lead` later.

    Neglects gps.lever_arm, gps.latency, a lead^2 / 2 of the position.

    Attributes
    ----------
    sigma : standard deviation of a position coordinate [m]
    sigma_velocity : of a velocity component [m/s]; None: the receiver gives no velocity
    bias_std, bias_walk : of the position bias [m], [m/sqrt(s)]
    lead : how much later than its velocity the position of a fix is [s]; without velocity zero
    """

    sigma: float
    sigma_velocity: float | None = None
    bias_std: float = 0.0
    bias_walk: float = 0.0
    lead: float = 0.0
    name: str = "gps"

    @property
    def size(self) -> int:
        """3, or 6 with velocity."""
        return 3 if self.sigma_velocity is None else 6

    @property
    def R(self) -> FloatArray:
        """(size, size) m^2 and (m/s)^2."""
        variances = [self.sigma**2] * 3
        if self.sigma_velocity is not None:
            variances += [self.sigma_velocity**2] * 3
        return np.diag(variances)

    @property
    def bias(self) -> BiasProcess | None:
        """Random walk of the position bias; None where both its sizes are zero."""
        return BiasProcess.unless_zero("b_gps", 3, self.bias_std, self.bias_walk)

    def with_lead(self, added: FloatArray) -> FloatArray:
        """(n, size, ...) what adds to a fix, the position's `lead` later.

        Parameters
        ----------
        added : (n, size, ...) to position and velocity of one instant
        """
        if self.size == 3 or self.lead == 0.0:
            return added
        found = np.array(added)
        found[:, :3] += self.lead * found[:, 3:]
        return found

    def predict(self, motion: Motion) -> FloatArray:
        """(n, size) position and velocity, NED."""
        if self.sigma_velocity is None:
            return motion.p_n
        return np.concatenate([motion.p_n + self.lead * motion.v_n, motion.v_n], axis=1)

    def jacobian(self, motion: Motion) -> Mapping[str, FloatArray]:
        """Identity blocks: position on position, velocity on velocity, bias on position; velocity on position `lead`
        of it.
        """
        n = len(motion)
        position = np.zeros((self.size, 3))
        position[:3] = np.eye(3)
        blocks = {"position": np.broadcast_to(position, (n, self.size, 3))}
        if self.bias is not None:
            blocks["b_gps"] = np.broadcast_to(position, (n, self.size, 3))
        if self.sigma_velocity is not None:
            velocity = np.zeros((self.size, 3))
            velocity[:3], velocity[3:] = self.lead * np.eye(3), np.eye(3)
            blocks["velocity"] = np.broadcast_to(velocity, (n, self.size, 3))
        return blocks


@dataclass(frozen=True)
class BaseReceiver:
    """A reference receiver at a known place: its error is the GPS bias that the rover shares (position-domain DGPS).

    p_base - base_position = b_gps + n

    Neglects what the two receivers do not share: the difference of their atmospheres, multipath.

    Attributes
    ----------
    sigma : standard deviation of a coordinate [m]
    """

    sigma: float
    name: str = "base"
    size: int = 3

    @property
    def R(self) -> FloatArray:
        """(3, 3) m^2."""
        return np.eye(3) * self.sigma**2

    @property
    def bias(self) -> BiasProcess | None:
        """None: what it observes is the bias of the GPS."""
        return None

    def predict(self, motion: Motion) -> FloatArray:
        """(n, 3) zero: the base does not move, its position is taken off."""
        return np.zeros((len(motion), 3))

    def jacobian(self, motion: Motion) -> Mapping[str, FloatArray]:
        """Identity on the GPS bias."""
        return {"b_gps": np.broadcast_to(np.eye(3), (len(motion), 3, 3))}


_FIX = (NED, ("latitude", "longitude", "height"))
_OWN = (*_FIX[1], "vel_north", "vel_east", "vel_down")


SENSOR = SensorType(
    name="gps",
    title="GPS",
    make=lambda given: Gps(given.sigma, given.sigma_velocity, given.bias_std, given.bias_walk),
    kernel="position",
    columns=_FIX,
    own=_OWN,
    declares=(*PER_READING, "velocity_noise_std"),
    components=NED,
    unit="m",
    plausible=10.0,  # a multipath jump
    bias=NED,
    colour=NED,
    velocity=True,
    turn=0,
    spoils="position_rms",
    believed_bias=2.0,  # the atmosphere and the orbits
)

BASE = SensorType(
    name="base",
    title="base receiver",
    make=lambda given: BaseReceiver(given.sigma),
    kernel="zero",
    columns=_FIX,
    own=_OWN,
    declares=(*PER_READING, "velocity_noise_std", "base_position"),
    components=NED,
    unit="m",
    plausible=10.0,
    bias_block="b_gps",
    turn=1,
)
