"""Magnetometer: the Earth's field turned into the body, and the tilt-compensated heading. The course, section 3."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.noise import BiasProcess
from sinan.sensors.rotation import rotate, rotate_back, skew, tilted
from sinan.sensors.sensor_type import PER_READING, XYZ, SensorType


@dataclass(frozen=True)
class Magnetometer:
    """Three-axis magnetometer in a uniform field.

    m_meas = (1 - [t]x) C_bn m_n + b_mag + n

    t (3,) is the turn of the compass's axes against those of the IMU, a constant; zero where `axes_std` is, and then
    mag.misalignment is neglected. Neglects mag.scale, mag.cross_axis (soft iron), mag.current, mag.temperature,
    mag.declination; what t turns of the errors of attitude and field; a field that changes from place to place.

    Attributes
    ----------
    sigma : standard deviation of one reading's white noise [unit of the field]
    bias_std, bias_walk : of the bias (hard iron) [unit], [unit/sqrt(s)]
    axes_std : 1-sigma of each component of t [rad]; zero: it is no state
    """

    sigma: float
    bias_std: float = 0.0
    bias_walk: float = 0.0
    axes_std: float = 0.0
    name: str = "mag"
    size: int = 3

    @property
    def R(self) -> FloatArray:
        """(3, 3) noise covariance of one reading."""
        return np.eye(3) * self.sigma**2

    @property
    def bias(self) -> BiasProcess | None:
        """Random walk of the bias; None where both its sizes are zero."""
        return BiasProcess.unless_zero("b_mag", 3, self.bias_std, self.bias_walk)

    @property
    def axes(self) -> BiasProcess | None:
        """The turn t; None: it is no state."""
        return BiasProcess.unless_zero("s_mag", 3, self.axes_std, 0.0)

    def predict(self, motion: Motion) -> FloatArray:
        """(n, 3) field in the body."""
        return field_b(motion)

    def jacobian(self, motion: Motion) -> Mapping[str, FloatArray]:
        """d m / d dtheta_b = [C_bn m_n]x, since C_bn_true = Exp(-dtheta_b) C_bn; the bias enters directly."""
        blocks = {"attitude": skew(self.predict(motion))}
        if self.bias is not None:
            blocks["b_mag"] = np.broadcast_to(np.eye(3), (len(motion), 3, 3))
        return blocks


def field_b(motion: Motion) -> FloatArray:
    """(n, 3) field in the body: C_bn m_n, or `m_b` where the attitude is not known."""
    if motion.has("q_nb") and motion.has("m_n"):
        return rotate_back(motion.q_nb, motion.m_n)
    return motion.m_b


def tilt_compensated_heading(m_b: FloatArray, roll: FloatArray, pitch: FloatArray) -> FloatArray:
    """Magnetic heading [rad, clockwise from magnetic north] from the field in the body and the tilt.

    m_x' = m_x cos(pitch) + m_y sin(roll) sin(pitch) + m_z cos(roll) sin(pitch)
    m_y' = m_y cos(roll) - m_z sin(roll)
    heading = atan2(-m_y', m_x')

    m' is the field turned back by roll and pitch, with the rotation that the model of the filter has too.

    Parameters
    ----------
    m_b : (n, 3) field in the body, forward-right-down, any unit
    roll, pitch : (n,) rad

    Returns
    -------
    (n,) rad in (-pi, pi]; add the declination for the true heading

    Neglects every mag.* effect. Source: the course, lecture 9 (attitude from magnetometer); M. J. Caruso, "Applications
    of magnetic sensors for low cost compass systems", IEEE PLANS 2000, eq. 4.
    """
    level = rotate(tilted(roll, pitch), m_b)
    return np.asarray(np.arctan2(-level[..., 1], level[..., 0]))


SENSOR = SensorType(
    name="mag",
    title="magnetometer",
    make=lambda given: Magnetometer(given.sigma, given.bias_std, given.bias_walk),
    kernel="field",
    columns=(("mag_x", "mag_y", "mag_z"),),
    declares=(*PER_READING, "average_time"),
    components=XYZ,
    unit="1",
    plausible=0.1,  # iron brought near: a tenth of the field
    in_poses=True,
    bias=XYZ,
    colour=XYZ,
    late="aerobatics",
    thermometers=("mag", "poses", "imu"),
    spoils="heading_rms",
    quantities={
        "mag": (("mag_x", "mag_y", "mag_z"), "field"),
        "temperature": (("temperature",), "temperature"),
    },
)
