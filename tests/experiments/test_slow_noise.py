"""An offset in an interval, against slow noise of its stream and between the points of a grid."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from sinan.estimator.evidence.score import CONFUSED
from sinan.experiments.residual_loop.slow_noise import _TIME_CONSTANTS, _VARIANCES, SlowNoise
from sinan.experiments.residual_loop.sudden import jumps
from sinan.sensors.arrays import FloatArray

CELLS, READINGS = 25, 500
GRID = np.arange(CELLS) * (READINGS / CELLS)
T = np.arange(float(READINGS))
#: Best gain of an interval that a family-wise test at 1 % of some thirty effects lets pass, one degree of freedom.
PASSES = 32.0


def markov(rng: np.random.Generator, tau: float, sigma: float) -> FloatArray:
    """Stationary first-order Markov process at unit intervals."""
    x, decay = np.empty(READINGS), np.exp(-1.0 / tau)
    x[0] = sigma * rng.standard_normal()
    for k in range(1, READINGS):
        x[k] = decay * x[k - 1] + sigma * np.sqrt(1.0 - decay**2) * rng.standard_normal()
    return x


def best_gains(z: FloatArray, lead: float = -np.inf) -> tuple[float, float]:
    """Gain of the best interval of the grid, plain and beside slow noise; a constant offset is free."""
    steps = (T[:, None] >= GRID).astype(float)
    steps -= steps.mean(axis=0)
    z = z - z.mean()
    first, last = np.triu_indices(CELLS, 1)
    columns = steps[:, first] - steps[:, last]
    gain = (columns.T @ z) ** 2 / np.maximum(np.sum(columns**2, axis=0), 1e-12)
    k = int(np.argmax(gain))
    V = steps - np.pad(steps[:, 1:], ((0, 0), (0, 1)))
    noise = SlowNoise(((np.arange(CELLS) + 0.5, V),), z, 1, np.ones(READINGS, dtype=bool))
    return float(gain[k]), noise.gain_given(columns[:, k : k + 1], lead)[0]


def test_slow_noise_is_not_taken_for_an_offset() -> None:
    rng = np.random.default_rng(3)
    pairs = [best_gains(rng.standard_normal(READINGS) + markov(rng, tau, 0.7)) for tau in (10.0, 40.0) * 10]
    plain, beside = np.array(pairs).T
    assert np.mean(plain > PASSES) > 0.5
    assert np.max(beside) < PASSES


def test_an_offset_among_white_noise_keeps_its_gain() -> None:
    rng = np.random.default_rng(4)
    offset = 0.8 * ((GRID[8] <= T) & (GRID[15] > T))
    plain, beside = best_gains(rng.standard_normal(READINGS) + offset)
    assert beside > 0.9 * plain > PASSES


def test_an_offset_of_a_stream_that_drifts_is_ahead_of_the_drift() -> None:
    """Noise so weak that nothing calls for it beside the best interval; an offset among white noise stays as far ahead
    of it as it is.
    """
    rng = np.random.default_rng(7)
    weak = [rng.standard_normal(READINGS) + markov(rng, 60.0, 0.45) for _ in range(60)]
    alone = np.array([best_gains(z)[1] for z in weak])
    drifting = np.array([best_gains(z, CONFUSED)[1] for z in weak])
    named = alone > PASSES
    assert np.sum(named) >= 5
    assert np.sum(drifting > PASSES) < np.sum(named)
    offset = 1.0 * ((GRID[8] <= T) & (GRID[15] > T))
    white = [rng.standard_normal(READINGS) + offset for _ in range(20)]
    assert np.mean([best_gains(z, CONFUSED)[1] > PASSES for z in white]) > 0.9


def test_a_large_offset_among_slow_noise_is_still_seen() -> None:
    rng = np.random.default_rng(5)
    offset = 8.0 * ((GRID[8] <= T) & (GRID[15] > T))
    _, beside = best_gains(rng.standard_normal(READINGS) + markov(rng, 20.0, 0.5) + offset)
    assert beside > PASSES


def test_a_jump_that_is_forgotten_before_the_next_point_of_the_grid_is_found() -> None:
    rng = np.random.default_rng(6)
    at, memory = 207, 4.0
    late = T[:, None] - GRID
    answers = np.where(late >= 0.0, np.exp(-np.maximum(late, 0.0) / memory), 0.0).reshape(READINGS, 1, CELLS, 1)
    z = rng.standard_normal(READINGS)
    assert len(jumps(answers, z[:, None], T, GRID)) == 0
    z[at:] += 5.0 * np.exp(-(T[at:] - at) / memory)
    assert jumps(answers, z[:, None], T, GRID).tolist() == [float(at)]


@pytest.mark.parametrize("level", [0.7, 3.0])
def test_gain_is_that_of_the_likelihoods_themselves(level: float) -> None:
    """Against dense covariances, of two streams that share the noise; white noise as declared at most, or larger, which
    is then the unit of the second round.
    """
    rng = np.random.default_rng(6)
    cells, n = 6, 90
    t = np.arange(cells) + 0.5
    V = [np.kron(np.eye(cells), np.full((n // cells, 1), size)) for size in (1.0, 0.4)]
    column = (np.arange(n)[:, None] >= n // 2).astype(float)
    z = level * (rng.standard_normal(n) + 1.4 * V[0] @ rng.standard_normal(cells) + 0.7 * column[:, 0])
    noise = SlowNoise(((t, V[0]), (t, V[1])), z, 1, np.ones(n, dtype=bool))
    unit = max(float(np.max(np.diag(v.T @ v))) for v in V)
    s2 = 1.0
    for _ in range(2):
        without, beside, left = [0.0], [float((column[:, 0] @ z) ** 2 / np.sum(column**2)) / s2], [np.nan]
        for tau, variance in product(_TIME_CONSTANTS, _VARIANCES):
            K = variance / unit * np.exp(-np.abs(np.subtract.outer(t, t)) / tau)
            parts = [v @ K @ v.T for v in V]
            for covariance in (sum(parts), *parts):
                inverse = np.linalg.inv(np.eye(n) + covariance)
                plain = (z @ z - z @ inverse @ z) / s2 + np.linalg.slogdet(inverse)[1]
                offset = (column[:, 0] @ inverse @ z) / (column[:, 0] @ inverse @ column[:, 0])
                gain = offset**2 * (column[:, 0] @ inverse @ column[:, 0]) / s2
                without.append(plain)
                beside.append(plain + gain)
                left.append(float(np.mean((inverse @ (z - offset * column[:, 0])) ** 2)))
        gains = max(beside) - max(without)
        s2 = max(1.0, left[int(np.argmax(beside))])
    assert noise.gain_given(column)[0] == pytest.approx(gains, rel=1e-9)
