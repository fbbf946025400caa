"""Noise that a model leaves, in units of the declared noise."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments.residual_loop.noise_left import noise_left
from experiments.residual_loop.source import StreamResidual
from sensors.arrays import FloatArray


def residual(stream: str, z: FloatArray) -> StreamResidual:
    n = len(z)
    return StreamResidual(stream, np.arange(n) * 0.1, z, z, np.zeros(n, dtype=bool), "1", {}, np.arange(n))


def coloured(rng: np.random.Generator, n: int, rho: float) -> FloatArray:
    """(n, 1) of variance 1, neighbours correlated."""
    z = rng.standard_normal((n, 1))
    for k in range(1, n):
        z[k] = rho * z[k - 1] + np.sqrt(1.0 - rho**2) * z[k]
    return z


def left(stream: str, slow: bool, *residuals: StreamResidual) -> float:
    source: Any = SimpleNamespace(noise_known=True, residuals=lambda fit: residuals)
    return noise_left(source, None, stream, slow)  # type: ignore[arg-type]


def test_an_effect_on_the_imu_shows_in_level_whose_noise_is_motion() -> None:
    rng = np.random.default_rng(3)
    mag, motion = residual("mag", rng.standard_normal((4000, 3))), residual("level", coloured(rng, 4000, 0.8))
    assert left("gyro", False, mag) < 1.1
    assert left("gyro", False, mag, motion) == pytest.approx(1.8 / 0.2, rel=0.25)  # (1 + rho) / (1 - rho)
    assert left("mag", False, mag, motion) < 1.1


def test_noise_within_what_level_allows_is_none() -> None:
    rng = np.random.default_rng(4)
    assert left("accel", False, residual("level", 0.2 * coloured(rng, 4000, 0.8))) == 1.0


def test_what_lasts_is_judged_by_the_sum_over_long_times() -> None:
    slow = residual("baro", coloured(np.random.default_rng(5), 4000, 0.6))
    assert left("baro", False, slow) < 1.2
    assert left("baro", True, slow) == pytest.approx(1.6 / 0.4, rel=0.25)
