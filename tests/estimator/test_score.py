"""P-values of divided evidence: exact where nothing is missing."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from sinan.estimator.evidence.score import (
    Evidence,
    log_bayes_factor,
    log_p_among,
    log_p_of_divided,
    log_p_of_estimate,
    log_p_value,
    without_prior,
)
from sinan.sensors.arrays import FloatArray

DRAWS = 4000


@pytest.mark.parametrize(("dof", "scatter_dof"), [(1, 19), (3, 57), (2, 5)])
def test_uniform_where_nothing_is_missing(dof: int, scatter_dof: int) -> None:
    """False alarm one in a thousand, with a fixed seed."""
    rng = np.random.default_rng(4)
    gain, scatter = rng.chisquare(dof, DRAWS), rng.chisquare(scatter_dof, DRAWS) / scatter_dof
    log_p = [log_p_of_divided(g, dof, s, scatter_dof) for g, s in zip(gain, scatter, strict=True)]
    assert stats.kstest(np.exp(log_p), "uniform").pvalue > 1e-3


def test_the_tail_is_that_of_chi_square_times_a_share() -> None:
    """However strong: at most the scatter's chance to lie below one is gained."""
    for gain in (30.0, 3e2, 3e4):
        gained = log_p_value(gain, 3, np.inf, 1.2) - log_p_of_divided(gain, 3, 1.2, 57)
        assert 0.0 < gained < 0.7


def test_without_scatter_it_is_chi_square() -> None:
    assert log_p_of_divided(7.0, 2, 1.0, 0) == log_p_value(7.0, 2)


@pytest.mark.parametrize("readings", [12, 40])
def test_an_estimate_with_estimated_noise_is_judged_by_f(readings: int) -> None:
    """Against the slope's two-sided t of SciPy's regression."""
    x, y = np.random.default_rng(readings).standard_normal((2, readings))
    fit = stats.linregress(x, y)
    noise_dof = readings - 2
    sigma2 = float(np.sum((y - fit.intercept - fit.slope * x) ** 2)) / noise_dof
    L = np.array([[[float(np.sum((x - x.mean()) ** 2)) / sigma2]]])
    evidence = Evidence(("a",), (1,), L, np.zeros((1, 1)), np.ones(1), readings=readings, noise_dof=noise_dof)
    log_p = log_p_of_estimate(evidence, float(L[0, 0, 0] * fit.slope**2), 1)
    assert np.exp(log_p) == pytest.approx(fit.pvalue, rel=1e-6)


def _places(rng: np.random.Generator, nu: float, places: int = 25) -> FloatArray:
    """Gains a degree of freedom, three of them, at places whose variances follow a scaled inverse chi-square law."""
    variance = nu / rng.chisquare(nu, places) if np.isfinite(nu) else np.ones(places)
    return np.asarray(5.0 * variance * rng.chisquare(3, places) / 3.0)


@pytest.mark.parametrize("nu", [1.0, 2.0, 4.0, np.inf])
def test_a_place_like_the_others_stands_out_seldom(nu: float) -> None:
    """At 1 %; with nu known from 24 places alone, up to five times as often."""
    rng = np.random.default_rng(5)
    gains = [_places(rng, nu) for _ in range(300)]
    assert np.mean([log_p_among(g[0], g[1:], 3) < np.log(0.01) for g in gains]) < 0.05
    assert np.mean([log_p_value(3.0 * g[0], 3) < np.log(0.01) for g in gains]) > 0.2


def test_a_place_unlike_the_others_stands_out_where_they_are_alike() -> None:
    rng = np.random.default_rng(6)
    log_p = [log_p_among(500.0, _places(rng, np.inf), 3) for _ in range(200)]
    assert np.quantile(log_p, 0.95) < -10.0


@pytest.mark.parametrize("z", [0.1, 0.5, 2.0, 6.0])
def test_bayes_factor_against_the_integral(z: float) -> None:
    """Student's t of the size times the likelihood, by quadrature; lambda = 40 and up."""
    L, plausible = 40.0 / z**2 + 40.0, 0.05
    evidence = Evidence(("a",), (1,), np.array([[[L / plausible**2]]]), np.zeros((1, 1)), np.array([plausible]))
    x = np.linspace(z - 10.0 / np.sqrt(L), z + 10.0 / np.sqrt(L), 20001)
    density = np.exp(-0.5 * L * (x - z) ** 2) * stats.t.pdf(x, 3)
    integral = np.log(np.trapezoid(density, x)) + 0.5 * L * z**2
    assert log_bayes_factor(evidence, "a", np.array([z * plausible]), L * z**2) == pytest.approx(integral, abs=0.15)


@pytest.mark.parametrize("size", [3, 6, 9])
def test_bayes_factor_of_many_parameters(size: int) -> None:
    """Laplace's integral where the data are sharp: Student's t at the estimate times the width of the likelihood."""
    rng = np.random.default_rng(size)
    beta, L = rng.standard_normal(size), 1e6 * np.eye(size)
    evidence = Evidence(("a",), (size,), L[None], np.zeros((1, size)), np.ones(size))
    density = stats.multivariate_t(np.zeros(size), np.eye(size), df=3).logpdf(beta)
    width = 0.5 * size * np.log(2.0 * np.pi / 1e6)
    assert log_bayes_factor(evidence, "a", beta, 100.0) == pytest.approx(50.0 + density + width, abs=1e-3)


def test_what_the_data_do_not_see_neither_helps_nor_harms() -> None:
    """A component without information, wherever the fit has put it, beside one that is seen."""
    L = np.array([[[100.0, 0.0], [0.0, 0.0]]])
    evidence = Evidence(("a",), (2,), L, np.zeros((1, 2)), np.ones(2))
    odds = [log_bayes_factor(evidence, "a", np.array([1.0, wild]), 100.0) for wild in (0.0, 1e3)]
    assert odds[0] == pytest.approx(odds[1])


@pytest.mark.parametrize("truth", [(5.0, 30.0), (0.0, 40.0), (40.0, 0.0), (5.0, -30.0)])
@pytest.mark.parametrize("correlation", [0.0, 0.55, 0.9])
def test_without_the_prior_on_all_terms_each_is_what_least_squares_have(
    truth: tuple[float, float], correlation: float
) -> None:
    """Two terms that go together, both held: what holds the other is no evidence for the one."""
    L = np.array([[1.0, correlation], [correlation, 1.0]]) / (25.0 * (1.0 - correlation**2))
    beta = np.linalg.solve(L + np.eye(2) / 4.0, L @ truth)
    evidence = Evidence(("a", "b"), (1, 1), L[None], np.zeros((1, 2)), np.ones(2), prior_sigma=2.0)
    assert without_prior(evidence, beta) == pytest.approx(np.array(truth), abs=1e-9)
