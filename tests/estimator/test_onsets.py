"""The best interval of an offset that lives on in a filter's state."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from sinan.estimator.evidence.intervals.doubted import doubted_among
from sinan.estimator.evidence.intervals.onsets import Rows, Step, best_onsets
from sinan.estimator.evidence.source import LocalFinding
from sinan.sensors.arrays import FloatArray

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


#: Begin and end [s], and offset [rad/s].
OFFSETS = (
    (40.0, 42.0, (0.03, -0.02, 0.01)),
    (10.0, 12.5, (0.02, 0.01, 0.0)),
    (70.0, 73.0, (0.0, 0.02, -0.01)),
    (86.0, 89.0, (0.015, 0.0, 0.01)),
)


def with_offsets(rng: np.random.Generator, number: int) -> FloatArray:
    answers = [np.kron(sensitivity(begin) - sensitivity(end), offset) for begin, end, offset in OFFSETS[:number]]
    return np.asarray(np.sum(answers, axis=0) + rng.standard_normal(3 * len(T)))


def with_bursts(rng: np.random.Generator) -> FloatArray:
    """A disturbance of the readings, other every two seconds, at most places weak and at some strong."""
    height = 3.0 / np.sqrt(rng.chisquare(1.0, 50))[:, None] * rng.standard_normal((50, 3))
    return np.asarray(np.repeat(height, len(T) // 50, axis=0).ravel() + rng.standard_normal(3 * len(T)))


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_the_strongest_of_a_few_short_offsets_is_found(number: int) -> None:
    for seed in range(3):
        one = found(with_offsets(np.random.default_rng(seed), number))
        assert one.log_p < -12.0
        assert one.term.interval is not None
        assert np.allclose(one.term.interval, OFFSETS[0][:2], atol=0.5)


def test_a_disturbance_that_comes_and_goes_is_no_short_offset() -> None:
    rng = np.random.default_rng(7)
    findings = [found(with_bursts(rng)) for _ in range(8)]
    assert min(one.statistic for one in findings) > 200.0
    assert min(one.log_p for one in findings) > np.log(1e-3)


def test_what_is_off_from_the_start_on_ends_in_a_step() -> None:
    """A bias is free, so that the readings until 40 s are no more off than those after it."""
    off = np.array([0.02, -0.01, 0.03]) / SIGMA
    white = np.kron(T < 40.0, off) + np.random.default_rng(3).standard_normal(3 * len(T))

    def offsets(steps: Sequence[Step]) -> Rows:
        wanted = np.hstack([np.kron((onset <= T)[:, None], np.eye(3)) / SIGMA for _, onset in steps])
        free = np.kron(np.ones((len(T), 1)), np.eye(3))
        return Rows(free, wanted, white, np.full(len(white), "mag"), np.repeat(T, 3))

    searched = best_onsets({"mag": T}, 0.0, END, offsets, len(white), np.log(1e-3))
    assert [one.term.name for one in searched] == ["mag.step", "mag.step"]
    for one in searched:
        assert one.term.interval == pytest.approx((40.0, END), abs=0.1)
        assert one.beta == pytest.approx([-0.02, 0.01, -0.03], abs=1e-3)


def test_where_the_bias_is_known_what_is_off_from_the_start_on_is_a_transient() -> None:
    off = np.array([0.02, -0.01, 0.03]) / SIGMA
    white = np.kron(T < 40.0, off) + np.random.default_rng(3).standard_normal(3 * len(T))

    def offsets(steps: Sequence[Step]) -> Rows:
        wanted = np.hstack([np.kron((onset <= T)[:, None], np.eye(3)) / SIGMA for _, onset in steps])
        return Rows(np.zeros((len(white), 0)), wanted, white, np.full(len(white), "mag"), np.repeat(T, 3))

    searched = best_onsets({"mag": T}, 0.0, END, offsets, len(white), np.log(1e-3))
    one = max(searched, key=lambda one: one.statistic)
    assert one.term.name == "mag.transient"
    assert one.term.interval == pytest.approx((0.0, 40.0), abs=0.1)


#: Degrees of freedom of the law of a height's readings, and the time in which the filter follows an offset of them [s].
TAIL, FOLLOWED = 4.0, 0.1


def height_rows(z: FloatArray, weight: FloatArray, steps: Sequence[Step], doubted: bool) -> Rows:
    """Of whitened readings z at weights: an offset of one sigma is followed within some readings."""
    answers = [np.where(t <= T, np.exp(-np.maximum(T - t, 0.0) / FOLLOWED), 0.0) for _, t in steps]
    root, n = np.sqrt(weight), len(T)
    law = doubted_among(weight, np.ones(n, dtype=np.int64), np.full(n, TAIL), np.full(n, -np.inf)) if doubted else None
    wanted = root[:, None] * np.stack(answers, axis=1)
    return Rows(np.zeros((n, 0)), wanted, root * z, np.full(n, "baro"), T, law)


@pytest.mark.parametrize("seed", range(3))
def test_an_offset_between_two_of_the_grid_that_the_filter_doubts_is_found(seed: int) -> None:
    """15 sigma for 3.3 s, followed within some readings: by squares, and on the grid alone, there is nothing."""
    begin, end, rng = 41.399, 44.649, np.random.default_rng(seed)
    (answer,) = height_rows(T, np.ones(len(T)), [("baro", begin)], False).wanted.T
    (back,) = height_rows(T, np.ones(len(T)), [("baro", end)], False).wanted.T
    z = 15.0 * (answer - back) + rng.standard_normal(len(T))
    z[[300, 1500]] = 25.0  # wrong readings, which are no jumps
    weight = np.where(z**2 > 1.0, (TAIL + 1.0) / (TAIL + z**2), 1.0)
    stats = {}
    for doubted in (True, False):
        searched = best_onsets(
            {"baro": T}, 0.0, END, lambda steps, d=doubted: height_rows(z, weight, steps, d), len(T), np.log(1e-3)
        )
        stats[doubted] = next(one for one in searched if one.term.name == "baro.transient")
    assert stats[True].term.interval == pytest.approx((begin, end), abs=0.1)
    assert stats[True].beta == pytest.approx([15.0], abs=1.5)
    assert stats[True].log_p < np.log(1e-6) < stats[False].log_p
