"""The noise of ranges by likelihood: against contrasts, against differences, and on logs that it was not fitted on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.stats import multivariate_normal

from sinan.estimator.evidence.score import BLOCKS
from sinan.estimator.positioning.location import Location, locate
from sinan.estimator.positioning.noise_fit import fit, fitted, likelihood, problem_of
from sinan.estimator.positioning.pseudoranges import Columns
from sinan.experiments.benchmarks import range_noise as benchmark
from sinan.sensors.arrays import FloatArray
from sinan.sensors.range_noise import RangeNoise
from tests.estimator import gnss_simulation as simulation

EXACT = (
    "pseudorange.satellite_clock",
    "pseudorange.earth_rotation",
    "pseudorange.relativity",
    "pseudorange.group_delay",
)
TRUE = RangeNoise({"G": 1.2, "E": 0.3, "J": 0.5, "C": 0.9, "R": 1.4}, 0.3, 0.2, 0.05, 0.2)


def simulated(epochs: int, interval: float = 30.0) -> Location:
    ranges = simulation.simulated("GE", epochs=epochs, interval=interval)
    return locate(ranges, EXACT, mask=np.deg2rad(10.0), exclude=False, start=simulation.RECEIVER)


def noisy(location: Location, law: RangeNoise, seed: int) -> Location:
    """The same with an error of the law in every row, and nothing in common."""
    ranges = location.ranges
    v = law.variance(ranges.system, location.elevation, ranges.strength, ranges.accuracy, np.zeros(len(ranges)))
    added = np.sqrt(v) * np.random.default_rng(seed).standard_normal(len(ranges))
    return locate(replace(ranges, value=ranges.value + added), EXACT, mask=np.deg2rad(10.0), exclude=False)


def test_the_likelihood_is_that_of_contrasts_which_no_position_and_clock_changes() -> None:
    """One epoch: density of N' y with N' A = 0, for two laws; the volume of N cancels in their difference."""
    location = noisy(simulated(1), TRUE, 4)
    problem = problem_of(location, location.fixes.used)
    fault = np.where(problem.number == 2.0, 5.0, 0.0)
    found, expected = [], []
    for law, column in ((TRUE, None), (RangeNoise(), fault)):
        found.append(likelihood(problem, law.sizes, column)[0])
        U = problem.field[0] * law.field
        U = U if column is None else np.column_stack([U, column[0]])
        V = np.diag(problem.basis[0] @ law.sizes[:8] ** 2 + problem.floor[0]) + U @ U.T
        N = null_space(problem.A[0].T)
        expected.append(multivariate_normal(np.zeros(N.shape[1]), N.T @ V @ N).logpdf(N.T @ problem.y[0]))
    assert problem.repeats == 1.0
    assert found[0] - found[1] == pytest.approx(expected[0] - expected[1], rel=1e-6)


def test_the_derivative_is_that_of_differences() -> None:
    location = noisy(simulated(5), TRUE, 5)
    problem = problem_of(location, location.fixes.used)
    x, step = np.log(RangeNoise().sizes), 1e-5

    def at(log_sizes: FloatArray) -> float:
        return likelihood(problem, np.exp(log_sizes), np.where(problem.number == 1.0, 3.0, 0.0))[0]

    slope = likelihood(problem, np.exp(x), np.where(problem.number == 1.0, 3.0, 0.0))[1]
    numeric = [(at(x + step * e) - at(x - step * e)) / (2.0 * step) for e in np.eye(9)]
    np.testing.assert_allclose(slope, numeric, atol=1e-6)


def test_the_sizes_that_were_put_in_come_out_and_the_rest_stays_at_its_prior() -> None:
    """Forty logs of one epoch with errors of their own; QZSS, BeiDou and GLONASS are not in them."""
    clean = simulated(1)
    problems = []
    for seed in range(40):
        location = noisy(clean, TRUE, seed)
        problems.append(problem_of(location, location.fixes.used))
    law, _ = fit(problems, RangeNoise(), 1.0)
    assert law.system["G"] == pytest.approx(TRUE.system["G"], rel=0.15)
    assert law.system["E"] < 0.6
    assert [law.system[s] for s in "JCR"] == pytest.approx([RangeNoise().system[s] for s in "JCR"], rel=1e-3)


def test_an_epoch_of_four_satellites_leaves_the_prior() -> None:
    location = simulated(3)
    gps = location.ranges.rows(location.ranges.system == "G")
    gps = gps.rows(np.isin(gps.satellite, gps.satellite[gps.epoch == 0][:4]))
    assert fitted(locate(gps, EXACT, exclude=False), TRUE) == TRUE


@pytest.mark.measured
def test_logs_that_took_no_part_are_weighed_right_and_fixed_better(measured_data: Path) -> None:
    """By the other sites alone: NIS within a factor of 2.7 of one, 0.7 on average; it was 0.03 to 0.2."""
    logs = benchmark.read(measured_data / "gnss")
    judged = benchmark.judge(logs)
    fixed, others, own, late = np.log(np.array([one.nis for one in judged])).T
    assert np.max(np.abs(others)) < np.log(2.7)
    assert abs(np.mean(others)) < 0.4 < 2.0 < -np.mean(fixed)
    assert np.max(np.abs(own)) < np.log(2.4)
    assert np.max(np.abs(late)) < np.log(2.4)
    rms = np.array([one.rms for one in judged if one.rms[0] is not None])
    assert (rms[:, 1] < rms[:, 0]).all()
    assert np.sqrt(np.mean(rms[:, 2] ** 2)) < 0.92 * np.sqrt(np.mean(rms[:, 0] ** 2))
    default, found = RangeNoise().sizes, benchmark.typical(logs).sizes
    np.testing.assert_allclose(default, found, rtol=0.1)


def test_how_long_an_error_lasts_is_as_likely_as_the_dense_covariance_says() -> None:
    """Differences between two times, against the normal law of all rows at once."""
    rng, blocks, rows = np.random.default_rng(4), np.repeat(np.arange(BLOCKS), 3), 3 * BLOCKS
    variance = np.array([0.5, 2.0])
    columns = Columns(rng.standard_normal((rows, 2)), np.zeros((rows, 0)), rng.standard_normal(rows), blocks)

    def dense(f: float) -> float:
        fading = f ** np.abs(blocks[:, None] - blocks[None, :])
        S = np.eye(rows) + (columns.state * variance) @ columns.state.T * fading
        return float(multivariate_normal(np.zeros(rows), S).logpdf(columns.residual))

    found = [benchmark._log_likelihood(columns, variance, f) for f in (0.4, 0.9)]
    assert found[1] - found[0] == pytest.approx(dense(0.9) - dense(0.4), abs=1e-9)
