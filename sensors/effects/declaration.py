"""`Effect`: the declaration of a physical effect, used by the simulator, the calibration, the filter and the tracer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import FloatArray, zero_unless_finite
from sinan.sensors.errors import InputError
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion

#: (motion) -> (n, stream size, parameters): d reading / d beta at beta = 0, along the plain motion
Regressor = Callable[[Motion], FloatArray]
#: (start, end) -> the effect over that interval
Localised = Callable[[float, float], "Effect"]
#: (plain reading (n, size), beta, motion, model) -> (n, size): the reading with the effect in it, exactly
Exact = Callable[[FloatArray, FloatArray, Motion, SensorModel | None], FloatArray]


#: What stands in for a quantity that is not known: `m_b` = C_bn m_n, airspeed = |v - wind|, throttle for the current
_ALTERNATIVES: dict[str, tuple[tuple[str, ...], ...]] = {
    "m_b": (("q_nb", "m_n"),),
    "airspeed": (("wind", "v_n"),),
    "current": (("throttle",),),
}
#: An estimate beyond this many plausible sizes is not accepted as a lasting effect: plausible sizes are one sigma of
#: what is sold, and ten of them is another instrument. What disturbs an instrument for a time may be of any size, a
#: magnet or an echo; but not what disturbs the IMU, since at a wrong reading of another sensor some motion always fits.
IMPLAUSIBLE = 10.0
_DIFFERENCE = 1e-4  # of a plausible size: rounding and curvature both stay below 1e-7 of the slope


@dataclass(frozen=True)
class Parameter:
    """One component of beta.

    Attributes
    ----------
    name, unit : as in the effect's equation
    plausible : its standard deviation among instruments on the market, about zero
    positive : there is none below zero: a time in which a filter settles, the half angle of a cone
    """

    name: str
    unit: str
    plausible: float
    positive: bool = False


@dataclass(frozen=True)
class Effect:
    """A physical effect that is not part of the plain sensor model.

    Reading with the effect = plain reading + regressor @ beta; where that is not exact, `exact` gives the reading.
    `beta = 0` is the plain model. Several effects on one stream add up, each evaluated at the plain reading.
    docs/effects.md and `sinan effects` are made from these texts.

    Attributes
    ----------
    name : `sensor.effect`, as in the catalogue
    stream : the sensor whose reading it enters: accel, gyro, mag, baro, sonar, laser, gps, base, level, pseudorange
    summary : what the instrument does wrong, as a sentence with the sensor as its subject
    enters : how it changes the reading, as an equation in beta (`b` or the parameters' names)
    physics : why, and what is neglected
    source : author, edition, equation
    parameters : names, units and plausible sizes of beta
    needs : quantities of the motion and covariates that have to be known, by their names in `Motion`
    kinds : the kinds of recording in which it is a candidate
    regressor : (motion) -> (n, size of a reading, parameters): d reading / d beta at beta = 0
    exact : (plain reading, beta, motion, model) -> (n, size of a reading); None: linear in beta
    scenario : the shipped scenario in which it is observable
    separates : the manoeuvre that would make it observable, for messages
    interval, localised : of a time-localised effect: start and end [s]; the same effect as a function of them
    other_instants : its exact form uses the motion at instants other than that of the reading
    in_field_units : its parameters scale with the unit of the magnetic field; `plausible` is for a field of norm one
    opposite : the summary of a negative size, where that is another thing: what is late is early then
    """

    name: str
    stream: str
    summary: str
    enters: str
    physics: str
    source: str
    parameters: tuple[Parameter, ...]
    needs: tuple[str, ...]
    regressor: Regressor
    exact: Exact | None = None
    kinds: frozenset[str] = frozenset({"flight"})
    scenario: str = ""
    separates: str = ""
    interval: tuple[float, float] | None = None
    localised: Localised | None = None
    other_instants: bool = False
    in_field_units: bool = False
    opposite: str = ""

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.parameters)

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each parameter."""
        return tuple(parameter.unit for parameter in self.parameters)

    def units_in(self, field: str) -> tuple[str, ...]:
        """The same where the magnetic field has a unit of its own: its share an ampere becomes gauss an ampere.

        Parameters
        ----------
        field : unit of the recording's magnetic field, such as `gauss`
        """
        return tuple(field + unit[1:] for unit in self.units) if self.in_field_units else self.units

    def is_opposite(self, beta: FloatArray | Sequence[float]) -> bool:
        """Whether a size is told by `opposite`.

        Parameters
        ----------
        beta : (parameters,)
        """
        return bool(self.opposite) and bool(beta[0] < 0.0)

    def exists(self, beta: FloatArray | Sequence[float]) -> bool:
        """Whether there may be an effect of that size: of positive parameters there is no negative one.

        Parameters
        ----------
        beta : (parameters,)
        """
        return all(b >= 0.0 for b, parameter in zip(beta, self.parameters, strict=True) if parameter.positive)

    def check(self, beta: FloatArray | Sequence[float], where: Path | str, place: str) -> None:
        """Refuse a size of which there is no effect.

        Parameters
        ----------
        beta : (parameters,)
        where, place : of whoever gave it, as of `InputError`

        Raises
        ------
        InputError : a positive parameter is negative
        """
        if not self.exists(beta):
            least = " and ".join(f"{one.name} of at least 0 {one.unit}" for one in self.parameters if one.positive)
            raise InputError(where, ", ".join(f"{b:g}" for b in beta), least, place)

    @property
    def plausible(self) -> FloatArray:
        """(parameters,) plausible 1-sigma sizes."""
        return np.array([parameter.plausible for parameter in self.parameters])

    @property
    def is_local(self) -> bool:
        """Whether it is time-localised: its interval, or which readings it hits, has to be searched."""
        return self.localised is not None or self.name.endswith(".outliers")

    def over(self, t0: float, t1: float) -> Effect:
        """The time-localised effect over t0 <= t < t1 [s]; a step ends at infinity.

        Parameters
        ----------
        t0, t1 : s, on the clock of the recording
        """
        if self.localised is None:
            raise ValueError(f"`{self.name}` is not time-localised; expected a step or a transient")
        return self.localised(t0, t1)

    def plausible_in(self, motion: Motion) -> FloatArray:
        """(parameters,) plausible 1-sigma sizes in the recording's units: the mag's go with the norm of its field.

        Parameters
        ----------
        motion : whose magnetic field is that of the recording
        """
        if not self.in_field_units:
            return self.plausible
        known = motion.m_n if motion.has("m_n") else motion.m_b
        norm = float(np.mean(np.linalg.norm(known, axis=1))) if len(known) else 1.0
        return self.plausible * norm

    def missing(self, motion: Motion) -> tuple[str, ...]:
        """What of `needs` the motion has neither itself nor in another form.

        Parameters
        ----------
        motion : with its covariates
        """
        return tuple(name for name in self.needs if not (motion.has(name) or _otherwise_known(name, motion)))

    def rows(self, motion: Motion, size: int) -> FloatArray:
        """(n, size, parameters) the regressor for a stream of that size.

        One row holds for every beam of a scan; a GPS has three rows of position, then three of velocity, which its
        receiver may lack and an effect may leave alone.

        Parameters
        ----------
        motion : (n) at the instants of the readings, with what the effect needs
        size : components of a reading

        Raises
        ------
        InputError : the regressor has another shape
        """
        G = self.regressor(motion)
        if np.ndim(G) != 3 or (len(G), G.shape[2]) != (len(motion), self.size):
            expected = f"({len(motion)}, 1 or {size}, {self.size}): instants, components of a reading, parameters"
            raise InputError(self.name, f"a regressor of shape {np.shape(G)}", expected)
        if G.shape[1] == 1:
            return np.broadcast_to(G, (len(motion), size, self.size))
        missing = max(0, size - G.shape[1])
        return np.pad(G, ((0, 0), (0, missing), (0, 0)))[:, :size] if missing else G[:, :size]

    def slope(
        self, plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None
    ) -> FloatArray:
        """(n, size, parameters) d reading / d beta at any beta: the regressor, or differences of `exact`.

        Parameters
        ----------
        plain, beta, motion, model : as of `apply`
        """
        if self.exact is None:
            return self.rows(motion, plain.shape[1])
        return self.differences(lambda at: self.apply(plain, at, motion, model), beta)

    def differences(self, function: Callable[[FloatArray], FloatArray], beta: FloatArray) -> FloatArray:
        """(n, size, parameters) derivative by the parameters of what goes with the effect, by central differences.

        Parameters
        ----------
        function : beta -> (n, size)
        beta : (parameters,) where
        """
        columns = []
        for k, step in enumerate(_DIFFERENCE * self.plausible):
            ahead, behind = np.array(beta, dtype=np.float64), np.array(beta, dtype=np.float64)
            ahead[k] += step
            behind[k] -= step
            with np.errstate(invalid="ignore"):  # a beam above the horizon: no reading, which nothing changes
                change = function(ahead) - function(behind)
            columns.append(zero_unless_finite(change) / (2.0 * step))
        return np.stack(columns, axis=-1)

    def apply(
        self, plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None
    ) -> FloatArray:
        """The reading with the effect in it, in its exact form.

        Parameters
        ----------
        plain : (n, size) what an ideal sensor reads along `motion`
        beta : (parameters,) in the units of `units`
        motion : the true motion at the instants of the readings, with what the effect needs
        model : the sensor's model, for effects that need the reading at other instants or attitudes
        """
        beta = np.asarray(beta, dtype=np.float64)
        if self.exact is not None:
            return self.exact(plain, beta, motion, model)
        return plain + self.rows(motion, plain.shape[1]) @ beta

    def change(
        self, plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None
    ) -> FloatArray:
        """(n, size) what the effect adds to the plain reading; a beam above the horizon reads nothing and keeps it.

        Parameters
        ----------
        plain, beta, motion, model : as of `apply`
        """
        beta = np.asarray(beta, dtype=np.float64)
        if self.exact is None:
            added = self.rows(motion, plain.shape[1]) @ beta
        else:
            with np.errstate(invalid="ignore"):
                added = self.exact(plain, beta, motion, model) - plain
        there = np.isfinite(plain)
        return added if np.all(there) else np.where(there, added, 0.0)


def _otherwise_known(name: str, motion: Motion) -> bool:
    """Whether what an effect needs can be had from something else that the motion has."""
    return any(all(motion.has(part) for part in parts) for parts in _ALTERNATIVES.get(name, ()))
