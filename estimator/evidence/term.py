"""One effect in a model, and the declarations behind the terms of a model."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.effects import Effect, effect, effects_for
from sinan.sensors.errors import InputError
from sinan.sensors.motion import Motion


@dataclass(frozen=True)
class Term:
    """One effect in a model: its name; where it is time-localised its interval [s]; its satellite where it has one; a
    probe, which the catalogue does not know, brings its own declaration.
    """

    name: str
    interval: tuple[float, float] | None = None
    satellite: str | None = None
    probe: Effect | None = field(default=None, compare=False, repr=False)

    @property
    def key(self) -> str:
        """Name by which the evidence calls the term."""
        if self.interval is not None:
            return f"{self.name}@{self.interval[0]:.9g}:{self.interval[1]:.9g}"
        return f"{self.name}@{self.satellite}" if self.satellite else self.name

    @property
    def effect(self) -> Effect:
        """Its declaration, over its interval where it has one."""
        entry = self.probe or effect(self.name)
        return entry.over(*self.interval) if self.interval is not None and entry.localised is not None else entry

    @property
    def in_mean(self) -> bool:
        """Whether the effect changes the mean reading; outliers do not: they are left out of the fit instead."""
        return not self.name.endswith(".outliers")

    def covers(self, t: FloatArray) -> BoolArray:
        """(n,) whether each instant [s] is in the interval; all are where there is none."""
        if self.interval is None:
            return np.ones(len(t), dtype=bool)
        return np.asarray((t >= self.interval[0]) & (t < self.interval[1]))


#: Parameters of effects by the terms that the loop calls them by; `Terms` of the filter has them by declaration.
Model = Mapping[Term, FloatArray]


def declared_model(effects: Mapping[str, Sequence[float]]) -> dict[Term, FloatArray]:
    """The effects that a recording declares, as a model."""
    return {Term(name): np.asarray(beta, dtype=np.float64) for name, beta in effects.items()}


def effects_in_mean(*models: Model) -> list[tuple[Effect, FloatArray]]:
    """Declaration and beta of everything in the models that changes the mean reading."""
    return [(term.effect, beta) for model in models for term, beta in model.items() if term.in_mean]


def without_probes(
    reading: FloatArray, model: Model, motion_of: Callable[[FloatArray], Motion]
) -> tuple[FloatArray, Model]:
    """Readings (n, 3) less what the probes of a model add to them, and the model without these.

    Parameters
    ----------
    motion_of : the motion that goes with readings; a probe is an offset that does not depend on the true one
    """
    for term, beta in model.items():
        if term.probe is not None:
            reading = reading - term.probe.regressor(motion_of(reading)) @ beta
    return reading, {term: beta for term, beta in model.items() if term.probe is None}


def effects_added(model: Model, plain: FloatArray, motion: Motion) -> FloatArray:
    """(n, size) what the effects of a model add to the plain reading."""
    added = np.zeros_like(plain)
    for entry, beta in effects_in_mean(model):
        added += entry.change(plain, beta, motion)
    return added


def derivatives_wanted(model: Model, wanted: Iterable[Effect]) -> list[tuple[str, Effect, FloatArray]]:
    """Key, declaration and point of linearisation: the model's terms at their beta, then those wanted at zero."""
    entries = [(term.key, term.effect, beta) for term, beta in model.items() if term.in_mean]
    named = {key for key, _, _ in entries}
    return entries + [(entry.name, entry, np.zeros(entry.size)) for entry in wanted if entry.name not in named]


def require_known(declared: Model, motion: Motion, where: str) -> None:
    """Raise if a declared effect needs what the recording does not have: it could not be modelled.

    Raises
    ------
    InputError : names the effect and what it needs
    """
    for term in declared:
        missing = term.effect.missing(motion)
        if missing:
            found = f"{term.name} declared, but no {', '.join(missing)}"
            raise InputError(where, found, "what a declared effect needs")


def varies(values: FloatArray) -> bool:
    """Whether a covariate does more than stand still, to rounding."""
    return bool(np.ptp(values) > 1e-9 * (1.0 + np.max(np.abs(values))))


def covariates_vary(entry: Effect, motion: Motion) -> bool:
    """Whether all covariates that an effect needs vary: one that does not makes the effect a bias."""
    return all(varies(motion.covariates[name]) for name in entry.needs if name in motion.covariates)


def pose_candidates(sensor: str, motion: Motion, declared: Model) -> tuple[Effect, ...]:
    """Effects of a sensor in poses that the recording's covariates allow and that it does not declare already.

    A covariate that does not vary makes its effect a bias: no candidate then.
    """
    return tuple(
        entry
        for entry in effects_for("poses", (sensor,))
        if not entry.missing(motion) and Term(entry.name) not in declared and covariates_vary(entry, motion)
    )
