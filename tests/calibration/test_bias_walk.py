"""A bias that wanders and that nobody declared: how large its walk is, from residuals."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.calibration.poses.evidence.bias_walk import estimated_walk, walk_covariance


def rests(rng: np.random.Generator, walk: float, sigma: float = 1.0, n: int = 30) -> tuple[float, float]:
    """White noise and walk as estimated from the mean rates at n rests, 5 s apart."""
    t = 5.0 * np.arange(n)
    bias = np.cumsum(walk * np.sqrt(5.0) * rng.standard_normal((n, 3)), axis=0)
    residual = (bias + sigma * rng.standard_normal((n, 3))).ravel()
    offset = np.tile(np.eye(3), (n, 1))
    return estimated_walk(residual, offset, offset, np.repeat(t, 3))


@pytest.mark.parametrize("walk", [0.3, 1.0, 3.0])
def test_walk_is_found_within_a_third(walk: float) -> None:
    rng = np.random.default_rng(1)
    found = np.array([rests(rng, walk) for _ in range(40)])
    assert np.median(found[:, 1]) == pytest.approx(walk, rel=0.33)


def test_white_noise_has_no_walk() -> None:
    """What is found of it adds less than the white noise over the whole time, in nine of ten."""
    rng = np.random.default_rng(2)
    found = np.array([rests(rng, 0.0, 2.0) for _ in range(40)])
    assert np.quantile(found[:, 1], 0.9) * np.sqrt(150.0) < 2.0
    assert np.median(found[:, 0]) == pytest.approx(2.0, rel=0.1)


def test_mean_over_a_window() -> None:
    """Variance of the mean of a walk over a window, against fine steps."""
    rng = np.random.default_rng(3)
    h, n = 0.01, 200
    path = np.cumsum(np.sqrt(h) * rng.standard_normal((4000, 2 * n)), axis=1)
    first, second = path[:, :n].mean(axis=1), path[:, n:].mean(axis=1)
    expected = walk_covariance(np.array([1.0, 3.0]), np.array([2.0, 2.0]))
    np.testing.assert_allclose(np.cov(first, second), expected, rtol=0.15)
