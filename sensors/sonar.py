"""Sonar: slant range along body down, and when its echo fails. The course, section 4."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.atmosphere import speed_of_sound
from sinan.sensors.motion import Motion
from sinan.sensors.noise import BiasProcess
from sinan.sensors.ranging import slant_range, slant_range_jacobian, tilt_compensated_height
from sinan.sensors.rotation import cos_tilt
from sinan.sensors.sensor_type import SensorType


@dataclass(frozen=True)
class Sonar:
    """Ultrasonic range finder that looks along body down over flat ground.

    d = -p_z / (cos(pitch) cos(roll)) + b_sonar + n

    Neglects sonar.sound_speed, sonar.mount_offset, sonar.boresight, sonar.lever_arm,
    sonar.beam_cone, sonar.terrain_slope.

    Attributes
    ----------
    sigma : standard deviation of one reading [m]
    bias_std, bias_walk : of the optional bias [m], [m/sqrt(s)]; both zero: no bias state
    minimum, maximum : ranges between which an echo comes back [m]
    beam_angle : largest tilt at which the ground answers [rad]
    """

    sigma: float
    bias_std: float = 0.0
    bias_walk: float = 0.0
    minimum: float = 0.0
    maximum: float = np.inf
    beam_angle: float = np.pi / 2
    name: str = "sonar"
    size: int = 1

    @property
    def R(self) -> FloatArray:
        """(1, 1) m^2."""
        return np.array([[self.sigma**2]])

    @property
    def bias(self) -> BiasProcess | None:
        """Random walk of the bias; None where both its sizes are zero."""
        return BiasProcess.unless_zero("b_sonar", 1, self.bias_std, self.bias_walk)

    def predict(self, motion: Motion) -> FloatArray:
        """(n, 1) slant range [m]."""
        return slant_range(motion)[:, None]

    def jacobian(self, motion: Motion) -> Mapping[str, FloatArray]:
        """Blocks position and attitude (`sensors.ranging.slant_range_jacobian`), and the bias's own."""
        blocks = slant_range_jacobian(motion)
        if self.bias is not None:
            blocks["b_sonar"] = np.ones((len(motion), 1, 1))
        return blocks

    def echo(self, motion: Motion, softness: FloatArray | float = 0.0, threshold: float = 1.0) -> BoolArray:
        """(n,) whether an echo comes back.

        It fails out of range, beyond the beam angle (the echo is mirrored away), and from a soft target that absorbs
        it.

        Parameters
        ----------
        motion : where the sonar is
        softness : (n,) or one value, share of the sound that the target swallows, 0 to 1
        threshold : range in units of `maximum` at which a fully reflecting target is just heard; a target of softness s
            is heard to sqrt(1 - s) of it (the echo's energy falls with the square of the range)

        Source: the course, section 4, figure 7.13.
        """
        tilt_cosine = cos_tilt(motion.q_nb)
        d = slant_range(motion)
        heard = d <= self.maximum * threshold * np.sqrt(np.clip(1.0 - np.asarray(softness), 0.0, 1.0))
        return np.asarray((d >= self.minimum) & heard & (tilt_cosine >= np.cos(self.beam_angle)))


def range_from_time_of_flight(time: FloatArray, temperature: FloatArray | float) -> FloatArray:
    """Range [m] from the time between pulse and echo [s] at air temperature [degC]: d = c(T) dt / 2. The course,
    section 4.

    Neglects wind along the beam and humidity.
    """
    return np.asarray(0.5 * speed_of_sound(np.asarray(temperature, dtype=np.float64)) * np.asarray(time))


SENSOR = SensorType(
    name="sonar",
    title="sonar",
    make=lambda given: Sonar(
        given.sigma, given.bias_std, given.bias_walk, given.minimum, given.maximum, given.beam_angle
    ),
    kernel="range",
    columns=(("range",),),
    components=("range",),
    unit="m",
    plausible=1.0,  # an obstacle under the beam
    bias=("",),
    bias_optional=True,
    colour=("",),
    height=lambda model, reading, roll, pitch: tilt_compensated_height(reading[:, 0], roll, pitch),
    height_turn=2,
    heard=Sonar.echo,
    late="low_pass",
    thermometers=("sonar", "air"),
    spoils="height_rms",
    quantities={
        "range": (("range",), "length"),
        "time_of_flight": (("time_of_flight",), "time"),
        "temperature": (("temperature",), "temperature"),
    },
    levels=(("colour_std", 0.05, 1.0), ("colour_time", 1.0, 1.0)),
)
