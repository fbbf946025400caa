"""Densities and random walks: variances that are worked out beside the code."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from sinan.sensors.noise import BiasProcess, colour, random_walk, sample_std

FALSE_ALARM = 1e-3


def test_a_sample_of_a_hundred_hertz_scatters_ten_times_the_density() -> None:
    assert sample_std(0.02, 100.0) == pytest.approx(0.2)


def test_the_mean_of_samples_has_the_variance_of_the_density_over_the_time() -> None:
    """N^2 / T for a mean over T, whatever the rate: what a density is."""
    rng, density = np.random.default_rng(1), 0.3
    for rate in (10.0, 1000.0):
        means = np.mean(sample_std(density, rate) * rng.standard_normal((2000, int(2.0 * rate))), axis=1)
        low, high = chi2.ppf([FALSE_ALARM / 2, 1.0 - FALSE_ALARM / 2], len(means))
        assert low < np.sum(means**2) / (density**2 / 2.0) < high


def test_a_walk_has_the_covariance_of_a_walk() -> None:
    """Cov(b(s), b(t)) = std^2 + walk^2 min(s, t), at uneven instants; the components are independent."""
    t = np.array([0.0, 0.5, 0.7, 3.0])
    process = BiasProcess("b_gyro", 3, 0.8, 0.6)
    rng = np.random.default_rng(2)
    drawn = np.stack([random_walk(t, process, rng) for _ in range(20_000)])
    assert drawn.shape == (20_000, 4, 3)
    expected = 0.64 + 0.36 * np.minimum(t[:, None], t)
    for k in range(3):
        found = drawn[:, :, k].T @ drawn[:, :, k] / len(drawn)
        np.testing.assert_allclose(found, expected, atol=4.0 * np.max(expected) * np.sqrt(2.0 / len(drawn)))
    across = np.mean(drawn[:, :, 0] * drawn[:, :, 1], axis=0)
    assert np.all(np.abs(across) < 4.0 * np.max(expected) / np.sqrt(len(drawn)))


def test_the_walk_of_a_colour_keeps_its_size() -> None:
    """2 std^2 / tau: 0.8 for 8 s is driven by 0.8 sqrt(2 / 8) = 0.4."""
    process = colour("b_gps", 3, 0.8, 8.0)
    assert (process.std, process.walk, process.tau, process.rate) == pytest.approx((0.8, 0.4, 8.0, 0.125))
    assert BiasProcess("b_gps", 3, 0.8, 0.4).rate == 0.0


@pytest.mark.parametrize("std", [0.8, 0.0])
def test_a_colour_has_the_covariance_of_its_equation(std: float) -> None:
    """Of db/dt = -b / tau + w: Cov(b(s), b(t)) = exp(-|t - s| / tau) P(min), P(t) = std^2 e + walk^2 tau / 2 (1 - e)
    with e = exp(-2 t / tau); from 0.8, driven by 0.4 for 8 s, it is 0.64 exp(-|t - s| / 8)."""
    t = np.array([0.0, 0.5, 3.0, 13.0])
    rng = np.random.default_rng(3)
    drawn = np.stack([random_walk(t, BiasProcess("b_gps", 3, std, 0.4, 8.0), rng) for _ in range(20_000)])
    gone = np.exp(-2.0 * np.minimum(t[:, None], t) / 8.0)
    expected = np.exp(-np.abs(t[:, None] - t) / 8.0) * (std**2 * gone + 0.64 * (1.0 - gone))
    for k in range(3):
        found = drawn[:, :, k].T @ drawn[:, :, k] / len(drawn)
        np.testing.assert_allclose(found, expected, atol=4.0 * np.max(expected) * np.sqrt(2.0 / len(drawn)))
    across = np.mean(drawn[:, :, 0] * drawn[:, :, 1], axis=0)
    assert np.all(np.abs(across) < 4.0 * np.max(expected) / np.sqrt(len(drawn)))
