"""Barometer: height from pressure, with a bias that wanders with the weather. The course, section 5."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.noise import BiasProcess
from sinan.sensors.sensor_type import SensorType


@dataclass(frozen=True)
class Barometer:
    """Barometric height, positive up.

    d = -p_z + b_baro + n

    Neglects baro.scale, baro.temperature, baro.airspeed, baro.propwash, baro.lag, baro.time_offset.

    Attributes
    ----------
    sigma : standard deviation of one reading [m]
    bias_std, bias_walk : of the bias [m], [m/sqrt(s)]
    """

    sigma: float
    bias_std: float = 0.0
    bias_walk: float = 0.0
    name: str = "baro"
    size: int = 1

    @property
    def R(self) -> FloatArray:
        """(1, 1) m^2."""
        return np.array([[self.sigma**2]])

    @property
    def bias(self) -> BiasProcess | None:
        """Random walk of the bias; None where both its sizes are zero."""
        return BiasProcess.unless_zero("b_baro", 1, self.bias_std, self.bias_walk)

    def predict(self, motion: Motion) -> FloatArray:
        """(n, 1) height of the body [m], minus its down coordinate."""
        return -motion.p_n[:, 2:3]

    def jacobian(self, motion: Motion) -> Mapping[str, FloatArray]:
        """d height / d position = (0, 0, -1); the bias enters directly."""
        blocks = {"position": np.broadcast_to(np.array([[0.0, 0.0, -1.0]]), (len(motion), 1, 3))}
        if self.bias is not None:
            blocks["b_baro"] = np.ones((len(motion), 1, 1))
        return blocks


SENSOR = SensorType(
    name="baro",
    title="barometer",
    make=lambda given: Barometer(given.sigma, given.bias_std, given.bias_walk),
    kernel="height",
    columns=(("height",), ("pressure",)),
    own=("temperature",),
    components=("height",),
    unit="m",
    plausible=3.0,  # a door or a gust
    bias=("",),
    colour=("",),
    height=lambda model, reading, roll, pitch: reading[:, 0],
    height_turn=0,
    late="climb_descent",
    thermometers=("baro",),
    thermometer=True,
    spoils="height_rms",
    quantities={
        "height": (("height",), "length"),
        "pressure": (("pressure",), "pressure"),
        "temperature": (("temperature",), "temperature"),
    },
    believed_bias=2.0,  # the air in the draught
    levels=(("colour_std", 0.2, 1.0), ("colour_time", 3.0, 1.0), ("bias_walk", 0.03, 1.0)),
)
