"""What may be added to a model: candidates, intervals and wrong readings with their evidence, before any refit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from sinan.estimator.evidence.score import (
    Evidence,
    Statistic,
    gain_of_ratio,
    log_p_of_held,
    log_p_value,
    statistic_of,
)
from sinan.estimator.evidence.source import Fit, LocalFinding, Source
from sinan.estimator.evidence.term import Term
from sinan.sensors.arrays import FloatArray


@dataclass(frozen=True)
class Option:
    """A candidate at one step of the selection: evidence on the first pass, before any refit.

    Attributes
    ----------
    term : the effect
    statistic, dof : chi-square and its degrees of freedom
    log_p : corrected for colour and search; `log_p_raw` without the scatter
    search, search_raw : what the search over intervals adds to the logarithm of the p-value, with and without colour
    beta : first-order estimate
    log_p_held : `log_p_raw` of what is left of the evidence where the effect is held to sizes that occur; intervals,
        which may have any, are not
    """

    term: Term
    statistic: float
    dof: int
    log_p: float
    log_p_raw: float
    search: float
    search_raw: float
    beta: FloatArray
    log_p_held: float


class Offered:
    """The options about one fit: the candidates, the intervals and the wrong readings.

    Attributes
    ----------
    evidence : about the fit
    statistics : of every candidate that is not in the fit
    options : those that may be added
    local : the best interval of each time-localised family
    """

    def __init__(self, source: Source, fit: Fit, intervals: bool) -> None:
        self.evidence = source.evidence(fit)
        names = {term.name for term in fit.terms}
        others = [entry.name for entry in source.candidates if entry.name not in names]
        self.statistics = tuple(statistic_of(self.evidence, name, fit.keys) for name in others)
        same = alike_to(source, names)
        self.options = [option_of(s, self.evidence, fit) for s in self.statistics if s.name not in same]
        self.local: Sequence[LocalFinding] = source.local_findings(fit, intervals)
        self.options += [_local_option(found, self.evidence.noise_dof) for found in self.local]

    def drop(self, term: Term) -> None:
        """Offer a term no longer."""
        self.options = [option for option in self.options if option.term != term]

    def open_to(self, full: bool) -> list[Option]:
        """All of them, or where intervals enough have been found those that last."""
        return [option for option in self.options if option.term.interval is None] if full else self.options


def alike_to(source: Source, names: Set[str]) -> Set[str]:
    """Names that no log with these instruments tells from some of `names`, which are not among them."""
    return {name for alike in source.alike if alike & names for name in alike} - names


def _local_option(found: LocalFinding, noise_dof: float) -> Option:
    noise_dof = noise_dof if found.noise_dof is None else found.noise_dof
    plain = log_p_value(gain_of_ratio(found.statistic, noise_dof), found.dof, noise_dof)
    raw = min(plain + found.searched, found.log_p)
    return Option(
        found.term, found.statistic, found.dof, found.log_p, raw, found.log_p - plain, found.searched, found.beta,
        raw,
    )  # fmt: skip


def option_of(s: Statistic, evidence: Evidence, fit: Fit) -> Option:
    """A candidate, of its statistic about a fit."""
    held = log_p_of_held(evidence, s, fit.keys)
    return Option(Term(s.name), s.statistic, s.dof, s.log_p_corrected, s.log_p, 0.0, 0.0, s.beta, held)


def blind_spots(source: Source, fit: Fit, options: Sequence[Option], refused: Mapping[str, str]) -> list[Option]:
    """Options that the score does not see, from where they are likelier than the fit: tried with any shortlist.

    What is the best of several starts pays for the search.
    """
    starts = source.starts(fit)
    return [
        replace(o, beta=starts[o.term], dof=len(o.beta), search_raw=float(np.log(3 ** len(o.beta))))
        for o in options
        if o.term in starts and o.term.key not in refused
    ]
