"""What a probe predicts of readings that were left out of its fit."""

from __future__ import annotations

import numpy as np

from sinan.experiments.residual_loop.left_out import gains_left_out, log_p_left_out
from sinan.sensors.arrays import FloatArray, IntArray

BLOCKS = 25
LEVEL = 0.01


def problem(rng: np.random.Generator, n: int, size: float) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    given, added = rng.standard_normal((n, 4)), rng.standard_normal((n, 6))
    residual = rng.standard_normal(n) + size * added[:, 0] + given @ [1.0, 2.0, -1.0, 0.5]
    return residual, given, added, np.arange(n) * BLOCKS // n


def test_noise_is_predicted_by_nothing() -> None:
    """Fewer than one in a hundred, as the gains' own price of parameters makes the test cautious."""
    rng = np.random.default_rng(3)
    for known in (True, False):
        p = [log_p_left_out(*problem(rng, 100, 0.0), known) for _ in range(200)]
        assert np.mean(np.array(p) < np.log(LEVEL)) <= LEVEL


def test_what_is_there_is_predicted() -> None:
    rng = np.random.default_rng(4)
    for known in (True, False):
        p = [log_p_left_out(*problem(rng, 200, 0.8), known) for _ in range(20)]
        assert max(p) < np.log(LEVEL)


def test_what_is_in_one_stretch_alone_is_not_predicted_elsewhere() -> None:
    rng = np.random.default_rng(5)
    residual, given, added, fold = problem(rng, 200, 0.0)
    residual[80:88] += 8.0 * added[80:88, 0]
    assert log_p_left_out(residual, given, added, fold, True) > np.log(LEVEL)


def test_gains_are_those_of_the_predictive_density() -> None:
    """Against the normal density of the left-out readings, written out: mean J b and covariance I + J P J'."""
    rng = np.random.default_rng(6)
    residual, given, added, fold = problem(rng, 60, 0.5)
    out = fold == 3
    both = np.hstack([given, added])
    noise = max(float(np.sum((residual - both @ np.linalg.lstsq(both, residual)[0]) ** 2)) / 50.0, 1.0)

    def deviance(J: FloatArray) -> float:
        P = np.linalg.inv(J[~out].T @ J[~out])
        e = residual[out] - J[out] @ (P @ (J[~out].T @ residual[~out]))
        C = np.eye(int(out.sum())) + J[out] @ P @ J[out].T
        return float(e @ np.linalg.solve(C, e)) / noise + float(np.linalg.slogdet(C)[1])

    found = gains_left_out(residual, given, added, fold, True)[3]
    np.testing.assert_allclose(found, deviance(given) - deviance(both), atol=1e-5)
