"""Which options stand: on a linear problem whose answer is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np

from estimator.score import Evidence, statistic_of
from experiments.residual_loop.options import option_of
from experiments.residual_loop.source import Fit, Part, Source
from experiments.residual_loop.term import Term
from experiments.residual_loop.trials import UNDETERMINED, best_of
from sensors.arrays import FloatArray
from sensors.effects import effect

BETA = np.array([0.02, 0.03, -0.01])
SIGMA = 1e-3


class Line:
    """Readings G beta plus white noise: one candidate, `gyro.scale`, whose sensitivities G (n, 3) are given."""

    noise_known = True

    def __init__(self, G: FloatArray) -> None:
        self.W = G / SIGMA
        self.white = (G @ BETA) / SIGMA + np.random.default_rng(1).standard_normal(len(G))

    def fit(self, terms: Sequence[Term], start: Mapping[Term, FloatArray] | None = None, part: Part = "all") -> Fit:
        """Least squares, the shortest of equal ones."""
        covariance = np.linalg.pinv(self.W.T @ self.W, hermitian=True)
        beta = covariance @ self.W.T @ self.white if terms else np.zeros(3)
        left = self.white - self.W @ beta
        std = np.sqrt(np.diag(covariance))
        return Fit(tuple(terms), dict.fromkeys(terms, beta), dict.fromkeys(terms, std), float(left @ left), part, left)

    def evidence(self, fit: Fit, own_terms_only: bool = False) -> Evidence:
        """In ten blocks."""
        parts = list(zip(np.array_split(self.W, 10), np.array_split(cast(FloatArray, fit.detail), 10), strict=True))
        information = np.stack([W.T @ W for W, _ in parts])
        score = np.stack([W.T @ left for W, left in parts])
        return Evidence(("gyro.scale",), (3,), information, score, np.full(3, 0.03))

    def effect(self, term: Term) -> Any:
        """Its declaration."""
        return effect(term.name)

    def starts(self, fit: Fit) -> Mapping[Term, FloatArray]:
        """Nothing is out of sight."""
        return {}

    def log_p_beside_noise(self, fit: Fit, terms: Sequence[Term]) -> list[float]:
        """The noise is white."""
        return [-np.inf] * len(terms)

    def residuals(self, fit: Fit) -> Sequence[Any]:
        """Nothing slow."""
        return ()


def taken(G: FloatArray) -> tuple[str | None, dict[str, str]]:
    """The name that is taken, and why another is not."""
    source = cast(Source, Line(G))
    fit, refused = source.fit(()), dict[str, str]()
    options = [option_of(statistic_of(source.evidence(fit), "gyro.scale"))]
    assert options[0].log_p < -20.0
    found = best_of(source, fit, options, np.log(1e-4), refused, most=3)
    return (None if found is None else found[1].term.name), refused


def test_an_effect_of_which_only_a_combination_is_seen_has_no_name() -> None:
    """Turns about one line through the middle of the axes: the sum of three scales, and none of them."""
    turns = np.random.default_rng(0).standard_normal((400, 1))
    assert taken(turns * np.ones(3)) == (None, {"gyro.scale": UNDETERMINED})


def test_one_component_that_is_seen_by_itself_is_enough() -> None:
    turns = np.random.default_rng(0).standard_normal((400, 2))
    assert taken(np.stack([turns[:, 0], turns[:, 1], turns[:, 1]], axis=1)) == ("gyro.scale", {})
