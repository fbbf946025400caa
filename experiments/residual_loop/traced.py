"""A recording traced: every part of it that has a plain model of its own, and the verdict on all of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from sinan.estimator.evidence.source import Source
from sinan.experiments.residual_loop.judged import Judged, judged
from sinan.experiments.residual_loop.trace import Trace
from sinan.experiments.residual_loop.verdict import Named, Verdict, joint


@dataclass(frozen=True)
class Part:
    """A plain model and what was found about it: a flight, or one sensor of poses.

    Attributes
    ----------
    sensor : of poses; empty for a flight
    """

    source: Source
    trace: Trace
    sensor: str = ""


@dataclass(frozen=True)
class Traced:
    """Parts whose candidates are one family: each has its share of the family-wise error.

    Attributes
    ----------
    alpha : family-wise error of all
    parts : one or more
    left_out : sensors that could not be traced, and why
    """

    alpha: float
    parts: tuple[Part, ...]
    left_out: tuple[tuple[str, str], ...] = ()

    @classmethod
    def alone(cls, source: Source, trace: Trace) -> Traced:
        """One part."""
        return cls(trace.alpha, (Part(source, trace),))

    @property
    def name(self) -> str:
        """Of the recording."""
        return self.parts[0].trace.recording

    @property
    def families(self) -> int:
        """Hypotheses that share the family-wise error."""
        return sum(part.source.families for part in self.parts)

    @cached_property
    def verdict(self) -> Verdict:
        """On all parts."""
        verdicts = [part.trace.verdict for part in self.parts]
        return verdicts[0] if len(verdicts) == 1 else joint(verdicts)

    def part_of(self, effect: Named) -> Part:
        """The part in which an effect was found."""
        return next(part for part in self.parts if any(one is effect for one in part.trace.verdict.effects))

    @property
    def judged(self) -> list[Judged]:
        """Every candidate that was not found and that the data could show, the strongest first."""
        return sorted((one for part in self.parts for one in judged(part.trace.selection)), key=lambda one: one.log_p)
