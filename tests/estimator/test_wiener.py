"""Regressors follow the signal: noise alone leaves none, motion stays."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.score import statistic_of
from estimator.wiener import signal_part
from experiments.residual_loop.open_flight import flight_source
from experiments.scenarios import load_scenario
from sensors.simulate import simulate

SIGMA = 0.003


def test_noise_alone_has_no_signal() -> None:
    noise = SIGMA * np.random.default_rng(1).standard_normal((12000, 3))
    assert np.sum(signal_part(noise, SIGMA) ** 2) < 1e-3 * np.sum(noise**2)


@pytest.mark.parametrize("frequency", [0.05, 0.7, 12.0])
def test_motion_stays(frequency: float) -> None:
    t = np.arange(12000) / 200.0
    signal = np.sin(2 * np.pi * frequency * t)[:, None]
    noise = SIGMA * np.random.default_rng(2).standard_normal(signal.shape)
    assert np.sqrt(np.mean((signal_part(signal + noise, SIGMA) - signal) ** 2)) < SIGMA


def test_a_constant_stays() -> None:
    values = 9.8 + SIGMA * np.random.default_rng(3).standard_normal((4000, 1))
    assert np.mean(signal_part(values, SIGMA)) == pytest.approx(np.mean(values), rel=1e-6)


def test_a_hover_says_nothing_about_the_scale_of_the_gyroscope() -> None:
    """Its rate is noise: taken as a regressor it had a statistic of 17 with three degrees of freedom."""
    recording, _ = simulate(load_scenario("hover"), np.random.default_rng([7, 0]))
    source = flight_source(recording)
    statistic = statistic_of(source.evidence(source.fit(())), "gyro.scale")
    assert statistic.dof == 0
