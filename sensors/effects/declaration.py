"""What an effect is: one declaration that the simulator, the calibration, the filter and the tracer all use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sensors.arrays import FloatArray
from sensors.model import SensorModel
from sensors.motion import Motion

#: (motion) -> (n, stream size, parameters): d reading / d beta at beta = 0, along the plain motion
Regressor = Callable[[Motion], FloatArray]
#: (plain reading (n, size), beta, motion, model) -> (n, size): the reading with the effect in it, exactly
Exact = Callable[[FloatArray, FloatArray, Motion, SensorModel | None], FloatArray]


@dataclass(frozen=True)
class Parameter:
    """One component of beta: its name, its unit, and its plausible 1-sigma size in instruments that are sold."""

    name: str
    unit: str
    plausible: float


@dataclass(frozen=True)
class Effect:
    """A physical effect that a plain sensor model may lack.

    Reading with the effect = plain reading + regressor @ beta; where that is not exact, `exact` gives the reading.
    `beta = 0` is the plain model. Effects on one stream add, each taken of the plain reading.

    Attributes
    ----------
    name : `sensor.effect`, as in the catalogue
    stream : the sensor whose reading it enters: accel, gyro, mag, baro, sonar, laser, gps, base, level, pseudorange
    summary : what the instrument does wrong, as a sentence with the sensor as its subject
    physics : why, and what is neglected; the docs page is made of it
    source : author, edition, equation
    parameters : names, units and plausible sizes of beta
    needs : what has to be known of the motion or the covariates, by their names in `Motion`
    kinds : the kinds of recording in which it is a candidate
    regressor, exact : see above
    scenario : the scenario that shows it
    separates : the manoeuvre that would make it visible, for messages
    """

    name: str
    stream: str
    summary: str
    physics: str
    source: str
    parameters: tuple[Parameter, ...]
    needs: tuple[str, ...]
    regressor: Regressor
    exact: Exact | None = None
    kinds: frozenset[str] = frozenset({"flight"})
    scenario: str = ""
    separates: str = ""

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.parameters)

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each parameter."""
        return tuple(parameter.unit for parameter in self.parameters)

    @property
    def plausible(self) -> FloatArray:
        """(parameters,) plausible 1-sigma sizes."""
        return np.array([parameter.plausible for parameter in self.parameters])

    def missing(self, motion: Motion) -> tuple[str, ...]:
        """What of `needs` the motion does not have."""
        return tuple(name for name in self.needs if not motion.has(name))

    def apply(
        self, plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None
    ) -> FloatArray:
        """The reading with the effect in it, in its exact form.

        Parameters
        ----------
        plain : (n, size) what the perfect sensor reads along `motion`
        beta : (parameters,)
        motion : the true motion at the instants of the readings
        model : the sensor's model, for effects that need the reading at other instants or attitudes
        """
        beta = np.asarray(beta, dtype=np.float64)
        if self.exact is not None:
            return self.exact(plain, beta, motion, model)
        return plain + self.regressor(motion) @ beta
