"""What linear problems in white noise have in common as sources: nothing is localised, wrong, out of sight or slow."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from sinan.estimator.evidence.score import Statistic
from sinan.estimator.evidence.source import Fit, LocalFinding
from sinan.estimator.evidence.term import Term
from sinan.sensors.arrays import FloatArray


class Linear:
    """A source but for its fits, its evidence and what withheld readings say."""

    noise_known = True
    alike: Sequence[frozenset[str]] = ()

    def local_findings(self, fit: Fit, intervals: bool = True) -> Sequence[LocalFinding]:
        """None."""
        return ()

    def relocated(self, fit: Fit, term: Term) -> tuple[Term, FloatArray]:
        """It is where it is."""
        return term, fit.beta[term]

    def starts(self, fit: Fit) -> Mapping[Term, FloatArray]:
        """Nothing is out of sight."""
        return {}

    def detectable(self, fit: Fit, statistics: Sequence[Statistic]) -> Sequence[Statistic]:
        """The noise is known."""
        return statistics

    def weighed(self, fit: Fit, other: Fit, log_odds: Callable[[float], float]) -> float:
        """The odds alone."""
        return log_odds(1.0)

    def residuals(self, fit: Fit) -> Sequence[Any]:
        """Nothing slow."""
        return ()

    def set_aside(self, fit: Fit) -> bool:
        """No reading is wrong."""
        return False

    def set_aside_within(self, fit: Fit, term: Term) -> bool:
        """No reading is wrong."""
        return False


def in_blocks(W: FloatArray, left: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(10, p, p) information and (10, p) score of whitened rows (n, p) and what is left of them (n,), in ten blocks."""
    parts = list(zip(np.array_split(W, 10), np.array_split(left, 10), strict=True))
    return np.stack([w.T @ w for w, _ in parts]), np.stack([w.T @ rest for w, rest in parts])
