"""Allan deviation and its fit against noise of known density."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.calibration.levels.allan import fit_allan, white_density
from sinan.sensors.errors import InputError
from sinan.sensors.noise import BiasProcess, random_walk, sample_std


def test_white_noise_and_walk_come_back() -> None:
    """White noise of 200,000 samples is known to 0.3 %; the walk's estimate rests on the longest times, 3 sigma."""
    rng = np.random.default_rng(1)
    rate, density, walk = 100.0, 0.01, 0.004
    t = np.arange(200_000) / rate
    values = sample_std(density, rate) * rng.standard_normal(len(t))
    values += random_walk(t, BiasProcess("b", 1, 0.0, walk), rng)[:, 0]
    fit = fit_allan(values, rate)
    assert fit.noise_density == pytest.approx(density, rel=0.01)
    assert abs(fit.bias_walk - walk) < 3.0 * fit.std[2] + 0.1 * walk


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
