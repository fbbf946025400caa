"""What the loop asks of a source of information and score, and the records that cross that border.

A source is a recording with a plain model: poses and a norm, turns and a gyroscope, a flight and a filter. The loop
knows none of them; it sees fits, evidence and residuals.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np

from sinan.estimator.evidence.budget import Budget
from sinan.estimator.evidence.score import Evidence, Statistic
from sinan.estimator.evidence.term import Model, Term
from sinan.estimator.evidence.weighing import in_weight
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.effects import Effect
from sinan.sensors.effects.declaration import IMPLAUSIBLE as IMPLAUSIBLE
from sinan.sensors.window import second_words

Part = Literal["all", "fitting"]


#: Readings that a fit must leave beyond its parameters: of three the sigma is known to 1 / sqrt(2 * 3), 40 %.
LEAST_SPARE = 3
#: Share of its gain that an effect's own information predicts where the innovations go with it. A cone wider than any
#: tilt has its gain and no derivative. A choice: half and twice change nothing of a late GPS (`bounds_of_work brief`).
LINEAR = 0.1
#: A field whose norm is as near to 1 as this is in units of itself: two decimals of its parts make 0.005 sqrt(3) =
#: 0.009.
UNIT_NORM = 0.01


@dataclass(frozen=True)
class FieldUnit:
    """In what the parameters of an effect on a magnetometer are said, where they go with the unit of the field.

    Attributes
    ----------
    name : of the log's own unit; empty: nobody says it, and they are said as they are fitted
    size : of what they are fitted in, in that unit
    by_throttle : the current is not known, and mean throttle (0 to 1) stands for it
    """

    name: str = ""
    size: float = 1.0
    by_throttle: bool = False

    def of(self, entry: Effect) -> tuple[float, tuple[str, ...]]:
        """What a fitted parameter is multiplied by, and the units of all, of an effect."""
        in_unit = bool(self.name) and entry.in_field_units
        units = entry.units_in(self.name) if in_unit else entry.units
        if self.by_throttle:
            units = tuple(unit.replace("/A", "/full throttle") for unit in units)
        return self.size if in_unit else 1.0, units


NO_UNIT = FieldUnit()


@dataclass(frozen=True)
class Fit:
    """A model with some effects in it, fitted to a part of the data in the effects' exact form.

    Attributes
    ----------
    terms : the effects, in order of discovery
    beta, std : of each term
    deviance : -2 log likelihood, up to a constant that is the same for all fits of one source and part between two
        `set_aside`
    part : the data that were used
    detail : what the source needs to go on from here; nobody else looks at it
    """

    terms: tuple[Term, ...]
    beta: Model
    std: Mapping[Term, FloatArray]
    deviance: float
    part: Part
    detail: object

    @property
    def in_mean(self) -> tuple[Term, ...]:
        """The terms that change the mean reading, in order."""
        return tuple(term for term in self.terms if term.in_mean)

    @property
    def keys(self) -> list[str]:
        """The names by which the evidence calls them."""
        return [term.key for term in self.in_mean]

    def keys_given(self, term: Term) -> list[str]:
        """The same without one of the terms."""
        return [other.key for other in self.in_mean if other != term]

    def is_that_of(self, other: Fit) -> bool:
        """Whether both are one and the same fit of one part, with whatever labels."""
        return self.detail is other.detail and self.part == other.part


@dataclass(frozen=True)
class LocalFinding:
    """The best interval of a time-localised family, or the wrong readings of a stream.

    Attributes
    ----------
    term : with its interval
    statistic, dof : of that interval
    log_p : logarithm of the p-value, corrected for the search over intervals and for the colour of the residual
    beta : (size,) first-order estimate
    searched : logarithm of the number of intervals among which it is the best, which is in `log_p`
    noise_dof : degrees of freedom of the noise by which it is judged; None: those of the fit's evidence
    """

    term: Term
    statistic: float
    dof: int
    log_p: float
    beta: FloatArray
    searched: float = 0.0
    noise_dof: float | None = None


@dataclass(frozen=True)
class StreamResidual:
    """Residuals of one stream, one row a measurement.

    Attributes
    ----------
    t : (n,) s
    residual : (n, size) in `unit`
    whitened : (n, size) divided by the root of its covariance under the model: N(0, 1) where the model is right
    tells : (n, size) which components are readings at all (`StreamJournal.tells`); the others are zero
    held_out : (n,) whether the row was kept from the fitting part
    unit : of `residual`
    covariates : (n,) each, what the residual may follow
    row : (n,) number of the reading in its recording, the same in every fit of it
    zero : what `t` shows where words and figures count from (`sensors.window.told_from`) [s]
    variance : (n, size) that the model predicts of each residual; None: the same of all
    weight : (n,) of doubtful readings; None: of none
    """

    stream: str
    t: FloatArray
    residual: FloatArray
    whitened: FloatArray
    tells: BoolArray
    held_out: BoolArray
    unit: str
    covariates: Mapping[str, FloatArray]
    row: IntArray
    zero: float = 0.0
    variance: FloatArray | None = None
    weight: FloatArray | None = None

    @property
    def counted(self) -> bool:
        """Whether the "time" of the readings is their number: a log without time stamps."""
        return bool(np.array_equal(self.t, np.arange(len(self.t))))

    def when(self, start: float, end: float) -> str:
        """An interval in words: its end is past the last reading in it."""
        if self.counted:
            return f"in readings {int(np.ceil(start))} to {int(np.ceil(end)) - 1}"
        return f"from {second_words(start, self.zero)} s to {second_words(end, self.zero)} s"

    @property
    def rms(self) -> float:
        """Root of the mean squared residual."""
        return float(np.sqrt(np.mean(self.residual**2, where=self.tells)))

    @property
    def dof(self) -> IntArray:
        """(n,) components of each row that tell something."""
        return np.asarray(np.sum(self.tells, axis=1))

    @property
    def nis_per_dof(self) -> float:
        """Mean squared whitened residual."""
        return float(np.mean(self.whitened**2, where=self.tells))

    @property
    def centred(self) -> FloatArray:
        """(n, size) whitened residual less the mean of its column; zero where nothing is told."""
        mean = np.sum(self.whitened, axis=0) / np.maximum(np.sum(self.tells, axis=0), 1)
        return np.where(self.tells, self.whitened - mean, 0.0)

    @property
    def weighed(self) -> StreamResidual:
        """The same with each residual in its weight (`in_weight`), whose RMS is what people read; position and velocity
        of a fix each by itself.
        """
        if self.variance is None:
            return self
        parts = [slice(k, k + 3) for k in range(0, self.residual.shape[1], 3)]
        weighed = [in_weight(self.residual[:, p], self.variance[:, p], self.tells[:, p], self.weight) for p in parts]
        return replace(self, residual=np.concatenate(weighed, axis=1), variance=None, weight=None)

    def as_sure_as(self, other: StreamResidual) -> StreamResidual:
        """The same with what another model predicts of the readings that both have."""
        if self.variance is None or other.variance is None:
            return self
        _, mine, theirs = np.intersect1d(self.row, other.row, return_indices=True)
        variance = self.variance.copy()
        variance[mine] = other.variance[theirs]
        return replace(self, variance=variance)

    def rows(self, keep: BoolArray) -> StreamResidual:
        """The rows of a mask."""
        covariates = {name: value[keep] for name, value in self.covariates.items()}
        return StreamResidual(
            self.stream,
            self.t[keep],
            self.residual[keep],
            self.whitened[keep],
            self.tells[keep],
            self.held_out[keep],
            self.unit,
            covariates,
            self.row[keep],
            self.zero,
            None if self.variance is None else self.variance[keep],
            None if self.weight is None else self.weight[keep],
        )


@dataclass(frozen=True)
class Signature:
    """What an effect predicts for the residuals of a stream, and those residuals: a figure.

    Attributes
    ----------
    stream : of the effect, or where it shows most if its own has no residual
    t : (n,) s
    predicted, residual : (n,) in `unit`
    """

    stream: str
    t: FloatArray
    predicted: FloatArray
    residual: FloatArray
    unit: str


class Source(Protocol):
    """A recording with a plain model, as the loop sees it."""

    @property
    def name(self) -> str:
        """Of the recording."""

    @property
    def candidates(self) -> tuple[Effect, ...]:
        """The effects whose regressor is known from the start: neither localised nor declared already."""

    @property
    def alike(self) -> Sequence[frozenset[str]]:
        """Sets of names of which no log with these instruments tells which it is: what they change is one quantity."""

    @property
    def families(self) -> int:
        """Number of hypotheses that share the family-wise error: candidates and time-localised families."""

    @property
    def noise_known(self) -> bool:
        """Whether the scale of the noise is a given of the test: of flights always, with noise declared or found
        beforehand; of calibrations where it is declared, else it is estimated with the fit.
        """

    @property
    def field(self) -> FieldUnit:
        """The unit of a magnetometer's readings."""

    def fit(self, terms: Sequence[Term], start: Mapping[Term, FloatArray] | None = None, part: Part = "all") -> Fit:
        """Fit the model with these effects, from `start`, in their exact form."""

    def alone(self, fit: Fit, term: Term, evidence: Evidence) -> FloatArray:
        """(size,) what the readings alone have for a term of the fit, where a prior has held all of them to zero.

        Parameters
        ----------
        evidence : of the fit's own terms
        """

    def evidence(self, fit: Fit, own_terms_only: bool = False) -> Evidence:
        """Information and score, about the fit, of the fit's own terms (by their keys) and of all candidates."""

    def detectable(self, fit: Fit, statistics: Sequence[Statistic]) -> Sequence[Statistic]:
        """The statistics of effects that are not in the fit, with what is detectable of them where sizes of the noise,
        found from the same readings, take a part of it up.
        """

    def starts(self, fit: Fit) -> Mapping[Term, FloatArray]:
        """First estimates of candidates to which the score at zero is blind, where they are likelier than the fit."""

    def local_findings(self, fit: Fit, intervals: bool = True) -> Sequence[LocalFinding]:
        """The best interval of each time-localised family, where they are wanted, and the wrong readings, about the
        fit.
        """

    def relocated(self, fit: Fit, term: Term) -> tuple[Term, FloatArray]:
        """A term of the fit where it may be likelier, and its first estimate there: one that is localised with the
        interval that suits the fit best, near its own; a lateness at another size; else the same.
        """

    def set_aside(self, fit: Fit) -> bool:
        """Take out readings that are wrong about this fit and were not seen before, for good; whether there are any."""

    def set_aside_within(self, fit: Fit, term: Term) -> bool:
        """Take out the readings in the interval of a term, for good, if they are so few that they are wrong readings
        and no disturbance; whether they are.
        """

    def suspects(self, fit: Fit) -> Sequence[tuple[Term, Statistic]]:
        """What the errors might follow that is in no catalogue, and the evidence for each about the fit."""

    def faults(self) -> Sequence[tuple[str, str, float, float]]:
        """(stream, what, start [s], end [s]) of stretches in which a sensor has not measured: frozen, saturated."""

    def residuals(self, fit: Fit) -> Sequence[StreamResidual]:
        """What the model leaves on all data, everything in it fitted on the fit's part."""

    @property
    def is_predicting(self) -> bool:
        """Whether an effect is proved by what a fit predicts of withheld readings, each part of the log by what the
        others say; else by residuals of a part that was not fitted: the noise is declared, or nothing can err for long.
        """

    def predicts(self, fit: Fit, without: Fit, surely: bool = True) -> bool:
        """Whether a fit predicts withheld readings better than another, where effects are proved by that; or else
        whether it does so at all, though it may be by chance.
        """

    def weighed(self, fit: Fit, other: Fit, log_odds: Callable[[float], float]) -> float:
        """Logarithm of the odds for a fit over another, by those that the readings give one step ahead, where noise is
        so many times as large as in the model, and by what the fits predict of withheld readings.
        """

    def bears_out(self, fit: Fit, without: Fit, log_odds: Callable[[float], float], needed: float) -> bool:
        """Whether withheld readings speak for an effect, where effects are proved by that, and for one that lasts by
        positive evidence of their own; and whether they and its odds, by how many times as large as in the model noise
        is, together exceed what is needed.
        """

    @property
    def assumes_motion(self) -> bool:
        """Whether bounds of a motion stand for what nothing measures."""

    def gain_assuming_less(self, fit: Fit, without: Fit) -> float:
        """Growth of 2 log L by what a fit has and another has not, where less is assumed of the motion; infinite where
        nothing is assumed of it.
        """

    def held_out(self, fit: Fit) -> Sequence[StreamResidual]:
        """What is held out, of each stream that has any: withheld readings, where effects are proved by them, else the
        residuals of the part that was not fitted.
        """

    def budget(self, plain: Fit, final: Fit) -> Sequence[Budget]:
        """Where the error of the plain model goes, by stream; empty where nothing tells noise from colour."""

    def signature(self, before: Fit, term: Term, beta: FloatArray) -> Signature | None:
        """What an effect predicts for the residuals of a model without it; None where it does not change the mean."""


def held_out(residuals: Sequence[StreamResidual]) -> list[StreamResidual]:
    """The held-out rows of each stream that has any."""
    return [r.rows(r.held_out) for r in residuals if np.any(r.held_out)]


def field_unit(norm: float, known: str = "") -> str:
    """Unit of a magnetometer's residuals: the log's own where it is known, else parts of the field where its norm is 1,
    else whatever it is declared in.
    """
    return known or ("1" if abs(norm - 1.0) < UNIT_NORM else "field")


def log_p_needed(source: Source, alpha: float) -> float:
    """Logarithm of the p-value at which one of a source's hypotheses passes at family-wise error alpha."""
    return float(np.log(alpha / max(source.families, 1)))
