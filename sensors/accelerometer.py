"""Accelerometer: specific force in the body, f_b = C_bn (a_n - g_n). The course, section 1."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.noise import BiasProcess
from sinan.sensors.sensor_type import XYZ, SensorType


@dataclass(frozen=True)
class Accelerometer:
    """Three-axis accelerometer; at rest and level it reads (0, 0, -g).

    f_meas = f_b + b_accel + n

    Neglects accel.scale, accel.cross_axis, accel.scale_nonlinearity, accel.temperature, accel.lever_arm,
    accel.vibration, accel.misalignment.

    Attributes
    ----------
    sigma : standard deviation of one reading's white noise [m/s^2]
    bias_std, bias_walk : of the bias [m/s^2], [m/s^2/sqrt(s)]
    """

    sigma: float
    bias_std: float = 0.0
    bias_walk: float = 0.0
    name: str = "accel"
    size: int = 3

    @property
    def R(self) -> FloatArray:
        """(3, 3) noise covariance of one reading [(m/s^2)^2]."""
        return np.eye(3) * self.sigma**2

    @property
    def bias(self) -> BiasProcess:
        """Random walk of the bias."""
        return BiasProcess("b_accel", 3, self.bias_std, self.bias_walk)

    def predict(self, motion: Motion) -> FloatArray:
        """(n, 3) specific force in the body [m/s^2]."""
        return motion.f_b

    def jacobian(self, motion: Motion) -> Mapping[str, FloatArray]:
        """The bias enters directly; as a driver of the process the reading has no other state in it."""
        return {"b_accel": np.broadcast_to(np.eye(3), (len(motion), 3, 3))}


SENSOR = SensorType(
    name="accel",
    title="accelerometer",
    make=lambda given: Accelerometer(given.sigma, given.bias_std, given.bias_walk),
    kernel="",
    declares=("noise_density", "noise_std", "bias_walk", "bias_std", "average_time", "imu_samples"),
    components=XYZ,
    unit="m/s^2",
    plausible=0.5,  # a knock or thermal shock of a MEMS sensor (zero tolerance of the MPU-6000: 50 mg)
    in_poses=True,
    bias=XYZ,
    thermometers=("imu", "poses"),
    thermometer=True,
    spoils="attitude_rms",
    believed_bias=0.3,  # ICM-20602 and the like after the autopilot's calibration; its data sheet allows 0.6
)
