"""A least-squares problem of readings with nuisance parameters, linearised at a point: what a recording gives.

It is made a source of the loop by `LeastSquaresSource`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from sinan.estimator.evidence.source import FieldUnit
from sinan.estimator.evidence.term import Term
from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.effects import Effect


@dataclass(frozen=True)
class Rows:
    """A least-squares problem linearised at one point: r = N d nuisance + S d beta + noise.

    Attributes
    ----------
    residual : (rows,) whitened; measurements first, then rows that state a prior
    nuisance : (rows, m)
    effects : by key of the term or name of the candidate, (rows, size)
    offset : (rows, k) derivative by a constant offset of the stream
    measured : (rows,) false for rows that state a prior
    raw : (rows,) the residual in physical units, zero for priors
    """

    residual: FloatArray
    nuisance: FloatArray
    effects: Mapping[str, FloatArray]
    offset: FloatArray
    measured: BoolArray
    raw: FloatArray


class LinearProblem(Protocol):
    """What a concrete problem gives to `LeastSquaresSource`."""

    @property
    def name(self) -> str:
        """Of the recording."""

    @property
    def where(self) -> str:
        """How messages call the recording."""

    @property
    def stream(self) -> str:
        """The sensor whose readings these are."""

    @property
    def unit(self) -> str:
        """Of the raw residual."""

    @property
    def field(self) -> FieldUnit:
        """The unit of a magnetometer's readings."""

    @property
    def t(self) -> FloatArray:
        """(rows,) time of each row [s]."""

    @property
    def instants(self) -> FloatArray:
        """(n,) of the samples, of which a row may hold many [s]."""

    @property
    def rows_are_readings(self) -> bool:
        """Whether each row is one reading by itself; turns share their poses, and a rest has three rows."""

    @property
    def noise_known(self) -> bool:
        """Whether the noise is declared; else the whitening is up to one common factor."""

    @property
    def candidates(self) -> tuple[Effect, ...]:
        """Effects with a regressor known from the start."""

    @property
    def covariates(self) -> Mapping[str, FloatArray]:
        """(rows,) each: what a residual may follow."""

    def start(self) -> FloatArray:
        """(m,) first guess of the nuisance parameters."""

    def plausible(self, entry: Effect) -> FloatArray:
        """Plausible sizes of an effect's parameters in this problem's units."""

    def rows(
        self, nuisance: FloatArray, model: Mapping[Term, FloatArray], wanted: Sequence[Effect], known: bool = False
    ) -> Rows:
        """Linearise at a point; `wanted` are those whose derivatives are needed besides the model's own.

        The derivatives are those of the residual, by which it is made least; or, with `known`, such as have nothing of
        the residual's own noise in them: where thousands of readings are tested, they must not follow it.
        """

    def probes(self, most: int) -> tuple[Effect, ...]:
        """What the errors might follow that is in no catalogue, with at most so many parameters each."""

    @property
    def faults(self) -> tuple[tuple[str, str, float, float], ...]:
        """(stream, what, start [s], end [s]) of readings that are none and are in no row: frozen, saturated."""
