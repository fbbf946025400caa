"""Laser range finder: one beam along body down, or a scan in the body's right-down plane. The course, section 6."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.noise import BiasProcess
from sinan.sensors.ranging import height_from_beams, scan_beams, slant_range, slant_range_jacobian
from sinan.sensors.rotation import rotate
from sinan.sensors.sensor_type import PER_READING, SensorType


@dataclass(frozen=True)
class Laser:
    """Laser ranges to flat ground; beam i points along (0, sin a_i, cos a_i) in the body.

    range_i = (ground_down - down) / (C_nb beam_i)_down + b_laser + n

    Neglects laser.scale, laser.mount_offset, laser.boresight, laser.lever_arm, laser.terrain_slope.

    Attributes
    ----------
    sigma : standard deviation of one range [m]
    bias_std, bias_walk : of the optional bias, common to all beams [m], [m/sqrt(s)]; both zero: no bias state
    angles : (beams,) rad; one zero: a single beam along body down
    minimum, maximum : ranges between which an echo comes back [m]
    """

    sigma: float
    bias_std: float = 0.0
    bias_walk: float = 0.0
    angles: FloatArray = field(default_factory=lambda: np.zeros(1))
    name: str = "laser"
    minimum: float = 0.0
    maximum: float = np.inf

    @property
    def size(self) -> int:
        """Number of beams."""
        return len(self.angles)

    @property
    def beams_b(self) -> FloatArray:
        """(beams, 3) unit vectors in the body."""
        return scan_beams(self.angles)

    @property
    def R(self) -> FloatArray:
        """(beams, beams) m^2."""
        return np.eye(self.size) * self.sigma**2

    @property
    def bias(self) -> BiasProcess | None:
        """Random walk of the bias; None where both its sizes are zero."""
        return BiasProcess.unless_zero("b_laser", 1, self.bias_std, self.bias_walk)

    def predict(self, motion: Motion) -> FloatArray:
        """(n, beams) slant ranges [m]; infinite for a beam above the horizon."""
        return np.stack([slant_range(motion, beam) for beam in self.beams_b], axis=-1)

    def jacobian(self, motion: Motion) -> Mapping[str, FloatArray]:
        """Blocks position and attitude, beam by beam, and the bias's own."""
        parts = [slant_range_jacobian(motion, beam) for beam in self.beams_b]
        blocks = {name: np.concatenate([part[name] for part in parts], axis=1) for name in ("position", "attitude")}
        if self.bias is not None:
            blocks["b_laser"] = np.ones((len(motion), self.size, 1))
        return blocks

    def echo(self, motion: Motion, softness: float = 0.0) -> BoolArray:
        """(n,) whether all beams come back: none above the horizon or out of range.

        Parameters
        ----------
        motion : (n) where the laser is
        softness : of the ground for sound, which is nothing to light
        """
        ranges = self.predict(motion)
        return np.asarray(np.all((ranges >= self.minimum) & (ranges <= self.maximum) & np.isfinite(ranges), axis=1))


def scan_height(ranges: FloatArray, angles: FloatArray, roll: FloatArray, pitch: FloatArray) -> FloatArray:
    """Height above flat ground [m] from a scan, exactly: least squares over the beams.

    `height_from_beams` of beams at angles a in the right-down plane, which go down by cos(pitch) cos(roll - a_i) over
    one metre.

    Parameters
    ----------
    ranges : (n, beams) m
    angles : (beams,) rad
    roll, pitch : (n,) rad
    """
    return height_from_beams(ranges, scan_beams(angles), roll, pitch)


def scan_range_of_the_course(ranges: FloatArray, angles: FloatArray) -> FloatArray:
    """The course's d_laser = mean(range_i cos(a_i)), its stand-in for the slant range -p_z / (cos(pitch) cos(roll)).

    Exact without roll in the scan's plane. With roll each term is range_i cos a_i = d cos(roll) cos(a_i) / cos(roll -
    a_i) = d / (1 + tan(roll) tan(a_i)): for a symmetric scan the odd terms cancel and what is left is
    d (1 + tan(roll)^2 mean(tan(a_i)^2) + ...), too long by 1.4 % at 20 deg of roll and a +-30 deg scan.
    `course_scan_error` gives it in full; `scan_height` has no such error. Source: the course, section 6.
    """
    return np.asarray(np.mean(ranges * np.cos(angles), axis=1))


def course_scan_error(angles: FloatArray, roll: FloatArray) -> FloatArray:
    """(n,) relative error of the course's mean: mean(1 / (1 + tan(roll) tan(a_i))) - 1, independent of pitch."""
    return np.asarray(np.mean(1.0 / (1.0 + np.tan(np.asarray(roll))[:, None] * np.tan(angles)), axis=1) - 1.0)


def ground_points(motion: Motion, ranges: FloatArray, angles: FloatArray) -> FloatArray:
    """(n, beams, 3) where the beams meet the ground, NED [m]: p_n + range_i C_nb beam_i (the course's point cloud)."""
    return motion.p_n[:, None, :] + ranges[..., None] * rotate(motion.q_nb[:, None, :], scan_beams(angles))


def slant_from_height(motion: Motion) -> FloatArray:
    """(n,) height / (cos(pitch) cos(roll)) [m], what the course's scan mean stands for: the range along body down."""
    return slant_range(motion)


SENSOR = SensorType(
    name="laser",
    title="laser",
    make=lambda given: Laser(
        given.sigma, given.bias_std, given.bias_walk, given.angles, minimum=given.minimum, maximum=given.maximum
    ),
    kernel="range",
    columns=(("range",), ("range_0",)),
    numbered="range_",
    declares=(*PER_READING, "angles"),
    components=("range",),
    unit="m",
    plausible=1.0,  # an obstacle under the beam
    bias=("",),
    bias_optional=True,
    colour=("",),
    height=lambda model, reading, roll, pitch: scan_height(reading, model.angles, roll, pitch),
    height_turn=1,
    heard=Laser.echo,
    late="climb_descent",
    thermometers=("laser",),
    spoils="height_rms",
    quantities={"range": (("range",), "length")},
    levels=(("colour_std", 0.05, 1.0), ("colour_time", 1.0, 1.0)),
)
