"""Allan deviation and its fit against noise of known density."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.calibration.levels.allan import AllanFit, fit_allan, white_density
from sinan.sensors.errors import InputError
from sinan.sensors.noise import BiasProcess, random_walk, sample_std

#: Scatter of N and of w over 200 seeds, in stated sigmas, as `fit_allan` says of what it neglects.
SCATTER_N, SCATTER_W = 1.4, 2.7
RATE, DENSITY, WALK = 100.0, 0.01, 0.004


def fitted(seed: int) -> AllanFit:
    """Of 200,000 samples of white noise and a walk."""
    rng = np.random.default_rng(seed)
    t = np.arange(200_000) / RATE
    values = sample_std(DENSITY, RATE) * rng.standard_normal(len(t))
    return fit_allan(values + random_walk(t, BiasProcess("b", 1, 0.0, WALK), rng)[:, 0], RATE)


def test_white_noise_and_walk_come_back() -> None:
    """White noise of 200,000 samples is known to 0.2 %; the walk's estimate rests on the longest times, 3 sigma."""
    fit = fitted(1)
    assert fit.noise_density == pytest.approx(DENSITY, rel=0.01)
    assert abs(fit.bias_walk - WALK) < 3.0 * SCATTER_W * fit.std[2]


def test_stated_sigmas_are_too_small_by_what_is_said() -> None:
    """A standard deviation of 30 is known to 13 %: three of that."""
    fits = [fitted(seed) for seed in range(30)]
    for k, scatter in ((0, SCATTER_N), (2, SCATTER_W)):
        stated = np.sqrt(np.mean([fit.std[k] ** 2 for fit in fits]))
        found = np.std([fit.coefficients[k] for fit in fits], ddof=1)
        assert found / stated == pytest.approx(scatter, rel=0.4)


def test_deviation_of_white_noise_is_density_over_root_tau() -> None:
    rng = np.random.default_rng(2)
    fit = fit_allan(sample_std(0.02, 50.0) * rng.standard_normal(100_000), 50.0)
    short = fit.tau < 10.0
    np.testing.assert_allclose(fit.deviation[short], 0.02 / np.sqrt(fit.tau[short]), rtol=0.06)


def test_white_density_is_deaf_to_drift() -> None:
    rng = np.random.default_rng(3)
    values = sample_std(0.02, 50.0) * rng.standard_normal(50_000) + np.linspace(0.0, 5.0, 50_000)
    assert white_density(values, 50.0) == pytest.approx(0.02, rel=0.02)


def test_too_short_a_log_is_named() -> None:
    with pytest.raises(InputError, match="10 rows"):
        fit_allan(np.zeros(10), 100.0)
