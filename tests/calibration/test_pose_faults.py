"""Poses that are no measurement: at the end of the range, or with an axis that stands still."""

from __future__ import annotations

import numpy as np

from sinan.calibration.poses.evidence.faults import at_an_end, poses_that_measured
from sinan.sensors.arrays import FloatArray

SIGMA = 0.01


def readings(seed: int, n: int = 40) -> FloatArray:
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((n, 3))
    return 9.8 * u / np.linalg.norm(u, axis=1, keepdims=True) * [1.02, 0.98, 1.0] + SIGMA * rng.standard_normal((n, 3))


def kept(reading: FloatArray) -> tuple[FloatArray, tuple[tuple[str, str, float, float], ...]]:
    n = len(reading)
    keep, faults = poses_that_measured("accel", np.arange(float(n)), reading, 9.8, np.full(n, SIGMA), "poses")
    return keep, faults


def test_clipped_axis_is_left_out() -> None:
    r = readings(1)
    clipped = np.abs(r[:, 1]) > 8.0
    r[:, 1] = np.clip(r[:, 1], -8.0, 8.0)
    keep, faults = kept(r)
    assert np.array_equal(~keep, clipped)
    assert {what for _, what, _, _ in faults} == {"saturated"}


def test_axis_that_stands_still_is_left_out() -> None:
    r = readings(2)
    r[10:22, 0] = r[10, 0]
    keep, faults = kept(r)
    assert list(np.flatnonzero(~keep)) == list(range(11, 22))
    assert faults == (("accel", "frozen", 10.0, 21.0),)


def test_clean_poses_all_measured() -> None:
    assert all(np.all(kept(readings(seed))[0]) for seed in range(50))


def test_coarse_counts_are_no_limit() -> None:
    """A converter whose counts are as large as the noise repeats readings everywhere."""
    assert not any(np.any(at_an_end(np.round(readings(seed, 400) * 4.0) / 4.0)) for seed in range(50))
