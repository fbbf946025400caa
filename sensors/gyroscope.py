"""Gyroscope: angular rate of the body relative to inertial space, in the body. The course, section 2."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.noise import BiasProcess
from sinan.sensors.sensor_type import XYZ, SensorType


@dataclass(frozen=True)
class Gyroscope:
    """Three-axis rate gyroscope.

    w_ib_b = (1 - S) (w_meas - b_gyro) + n

    S (3, 3) is what scale and axes err by, a constant; zero where `axes_std` is. Neglects gyro.scale and
    gyro.cross_axis where S is no state, and gyro.temperature, gyro.g_sensitivity; the rate of the Earth where the
    recording does not say `earth_rotation`.

    Attributes
    ----------
    sigma : standard deviation of one reading's white noise [rad/s]
    bias_std, bias_walk : of the bias [rad/s], [rad/s/sqrt(s)]
    axes_std : 1-sigma of each element of S; zero: it is no state
    """

    sigma: float
    bias_std: float = 0.0
    bias_walk: float = 0.0
    axes_std: float = 0.0
    name: str = "gyro"
    size: int = 3

    @property
    def R(self) -> FloatArray:
        """(3, 3) noise covariance of one reading [(rad/s)^2]."""
        return np.eye(3) * self.sigma**2

    @property
    def bias(self) -> BiasProcess:
        """Random walk of the bias."""
        return BiasProcess("b_gyro", 3, self.bias_std, self.bias_walk)

    @property
    def axes(self) -> BiasProcess | None:
        """The elements of S, row by row; None: none is a state."""
        return BiasProcess.unless_zero("s_gyro", 9, self.axes_std, 0.0)

    def predict(self, motion: Motion) -> FloatArray:
        """(n, 3) angular rate in the body [rad/s]."""
        return motion.w_ib_b

    def jacobian(self, motion: Motion) -> Mapping[str, FloatArray]:
        """The bias enters directly; as a driver of the process the reading has no other state in it."""
        return {"b_gyro": np.broadcast_to(np.eye(3), (len(motion), 3, 3))}


SENSOR = SensorType(
    name="gyro",
    title="gyroscope",
    make=lambda given: Gyroscope(given.sigma, given.bias_std, given.bias_walk),
    kernel="",
    declares=("noise_density", "noise_std", "bias_walk", "bias_std", "average_time", "imu_samples"),
    components=XYZ,
    unit="rad/s",
    plausible=0.05,  # a knock or thermal shock (zero tolerance of the MPU-6000: 20 deg/s)
    in_poses=True,
    bias=XYZ,
    thermometers=("imu", "poses"),
    thermometer=True,
    spoils="attitude_rms",
    believed_bias=0.01,  # after the autopilot's calibration; data sheets allow 0.09
)
