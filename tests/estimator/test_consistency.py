"""The filter's covariance tells the truth on flights whose noise is as declared."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.estimator.evidence.consistency import autocorrelation, chi_square, coverage, cross_correlation, nees
from sinan.estimator.filter.flight_model import flight_model
from sinan.estimator.filter.run_filter import run_filter
from sinan.estimator.filter.smoother import estimated_motion, smooth
from sinan.sensors.arrays import FloatArray
from tests.estimator.analytic_flight import fly

RUNS = 30
FALSE_ALARM = 0.001  # of each statistical test below; seeds are fixed


@pytest.fixture(scope="module")
def flights() -> list[tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]]:
    """Error, covariance, NIS and dof by reading, smoothed error over sigma, of independent flights."""
    results = []
    for seed in range(RUNS):
        recording, truth = fly(1000 + seed, duration=20.0)
        model = flight_model(recording)
        journal = run_filter(recording, model, engine="numba")
        states = smooth(journal, sigmas=True)
        rows = np.searchsorted(states.t, states.t_sigma)
        ratio = model.layout.difference(truth[rows], states.x[rows])[5] / states.sigma[5]
        error = model.layout.difference(truth[-1:], journal.x_end[None])[0]
        results.append((error, journal.P_end, journal.nis, journal.dof, ratio))
    return results


def test_nees_of_all_states(flights) -> None:
    total = sum(nees(error, P) for error, P, *_ in flights)
    statistic = chi_square(total, 22 * RUNS, 1.0 - FALSE_ALARM)
    assert statistic.consistent, statistic


def test_nis_of_all_readings(flights) -> None:
    total, dof = sum(float(f[2].sum()) for f in flights), sum(int(f[3].sum()) for f in flights)
    statistic = chi_square(total, dof, 1.0 - FALSE_ALARM)
    assert statistic.consistent, statistic


def test_smoothed_errors_are_as_large_as_their_sigma(flights) -> None:
    """Attitude and velocity at one instant of every flight; other states vary too little to count twice."""
    ratios = np.stack([f[4] for f in flights])
    statistic = chi_square(float(np.sum(ratios[:, 3:9] ** 2)), 6 * RUNS, 1.0 - 1e-6)  # components are correlated
    assert statistic.consistent, statistic


def test_smoother_does_not_depend_on_its_stretches() -> None:
    recording, _ = fly(1, duration=6.0)
    journal = run_filter(recording, flight_model(recording), engine="numba")
    assert np.max(np.abs(smooth(journal, part=100).x - smooth(journal, part=1200).x)) < 1e-9


def test_smoothed_end_is_the_filtered_end() -> None:
    recording, _ = fly(2, duration=3.0)
    journal = run_filter(recording, flight_model(recording), engine="numba")
    assert np.max(np.abs(smooth(journal).x[-1] - journal.x_end)) < 1e-9


def test_smoothed_motion_is_nearer_to_the_truth() -> None:
    recording, truth = fly(4, duration=20.0)
    journal = run_filter(recording, flight_model(recording), engine="numba")
    middle = slice(1000, 3000)
    errors = [
        np.std(m.v_n[middle] - truth[middle, 3:6])
        for m in (estimated_motion(journal), estimated_motion(journal, smoothed=False))
    ]
    assert errors[0] < errors[1]


def test_white_noise_passes_and_colour_fails() -> None:
    e = np.random.default_rng(1).standard_normal(4000)
    coloured = e[1:] + 0.3 * e[:-1]
    assert autocorrelation(e).p_value > FALSE_ALARM
    assert autocorrelation(coloured).p_value < 1e-6


def test_a_covariate_in_the_innovations_is_seen() -> None:
    rng = np.random.default_rng(2)
    current, e = rng.normal(size=3000), rng.normal(size=3000)
    assert cross_correlation(e + 0.2 * current, current)[1] < 1e-6
    assert cross_correlation(e, current)[1] > FALSE_ALARM


def test_coverage_of_gaussian_errors() -> None:
    e = np.random.default_rng(3).standard_normal((100000, 2))
    found = coverage(e, np.ones_like(e))
    assert abs(found["1"] - 0.6827) < 0.005
    assert abs(found["3"] - 0.9973) < 0.001
