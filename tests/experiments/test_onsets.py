"""The best interval of an offset that lives on in a filter's state."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from experiments.residual_loop.onsets import Rows, Step, best_onsets
from experiments.residual_loop.source import LocalFinding
from sensors.arrays import FloatArray

END = 100.0
T = np.arange(0.0, END, 0.05)
#: Of the readings [rad], and the rate at which what they tell of an angle is forgotten [1/s].
SIGMA, FORGOTTEN = 0.01, 0.5


def sensitivity(onset: float) -> FloatArray:
    """Of the whitened readings of one angle to a gyroscope that is off by 1 rad/s from an instant on."""
    return np.where(onset <= T, 1.0 - np.exp(-FORGOTTEN * np.maximum(T - onset, 0.0)), 0.0) / FORGOTTEN / SIGMA


def rows_of(white: FloatArray, steps: Sequence[Step]) -> Rows:
    """Three angles, one after the other at each stamp."""
    wanted = np.hstack([np.kron(sensitivity(t)[:, None], np.eye(3)) for _, t in steps])
    return Rows(np.zeros((len(white), 0)), wanted, white, np.full(len(white), "mag"), np.repeat(T, 3))


def found(white: FloatArray) -> LocalFinding:
    """The best offset for a while."""
    searched = best_onsets({"gyro": T}, 0.0, END, lambda steps: rows_of(white, steps), len(white), np.log(1e-3))
    return next(one for one in searched if one.term.name == "gyro.transient")


def with_offset(rng: np.random.Generator) -> FloatArray:
    offset = np.array([0.03, -0.02, 0.01])
    return np.asarray(np.kron(sensitivity(40.0) - sensitivity(42.0), offset) + rng.standard_normal(3 * len(T)))


def with_bursts(rng: np.random.Generator) -> FloatArray:
    """A disturbance of the readings, other every two seconds, at most places weak and at some strong."""
    height = 3.0 / np.sqrt(rng.chisquare(1.0, 50))[:, None] * rng.standard_normal((50, 3))
    return np.asarray(np.repeat(height, len(T) // 50, axis=0).ravel() + rng.standard_normal(3 * len(T)))


def test_a_short_offset_among_white_innovations_is_found() -> None:
    for seed in range(3):
        one = found(with_offset(np.random.default_rng(seed)))
        assert one.log_p < -50.0
        assert np.allclose(one.term.interval, (40.0, 42.0), atol=0.5)


def test_a_disturbance_that_comes_and_goes_is_no_short_offset() -> None:
    rng = np.random.default_rng(7)
    findings = [found(with_bursts(rng)) for _ in range(8)]
    assert min(one.statistic for one in findings) > 200.0
    assert min(one.log_p for one in findings) > np.log(1e-3)
