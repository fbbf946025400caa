"""Regressors follow the signal: noise alone leaves none, motion stays."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.estimator.evidence.score import statistic_of
from sinan.estimator.evidence.term import Term
from sinan.estimator.filter.wiener import signal_part, without_vibration
from sinan.experiments.residual_loop.open_flight import flight_source
from sinan.experiments.scenarios import load_scenario, parse_effect
from sinan.sensors.motion import Motion
from sinan.sensors.simulate import simulate

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


def test_vibration_is_no_acceleration_of_the_vehicle() -> None:
    """A late receiver of a shaken airframe: what the estimate's sigma says is what the deviance says. Along the
    vibration's acceleration, which no velocity follows, the sigma was 4 % too small here, and threefold where little
    else moves.
    """
    recording, _ = simulate(load_scenario("vibration"), np.random.default_rng(1), [parse_effect("gps.latency=0.03")])
    source, term = flight_source(recording, slow_gps=False), Term("gps.latency")
    late = source.fit((term,), {term: np.array([0.03])})
    gain = source.fit(()).deviance - late.deviance
    assert (late.beta[term][0] / late.std[term][0]) ** 2 == pytest.approx(gain, rel=0.02)
    assert late.beta[term][0] == pytest.approx(0.03, abs=3.0 * late.std[term][0])


@pytest.mark.parametrize(("frequency", "stays"), [(0.5, True), (3.0, True), (25.0, False), (80.0, False)])
def test_the_vehicle_is_slower_than_its_vibration(frequency: float, stays: bool) -> None:
    t = np.arange(4000) / 200.0
    shape = np.sin(2 * np.pi * frequency * t)[:, None] * np.array([1.0, 0.5, 0.2])
    motion = Motion(t=t, a_n=shape, w_ib_b=shape)
    slow = without_vibration(motion)
    for part in (slow.a_n, slow.w_ib_b):
        inner = slice(100, -100)
        left = part[inner] - shape[inner] * stays
        assert np.max(np.abs(left)) < 0.02
