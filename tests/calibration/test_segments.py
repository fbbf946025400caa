"""Static poses of a full-rate log."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.calibration.poses.segments import find_poses
from sinan.sensors.errors import InputError


def hand_turned(rng: np.random.Generator, poses: int, tremor: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """3 s at rest, 1 s of turn, 100 Hz; accelerometer and gyroscope with white noise."""
    t = np.arange(400 * poses) / 100.0
    k = np.minimum(t // 4.0, poses - 1).astype(int)
    phase = np.clip((t - 4.0 * k - 3.0) / 1.0, 0.0, 1.0)
    angle = 0.9 * (k + 3 * phase**2 - 2 * phase**3)
    rate = np.gradient(angle, t)
    accel = 9.8 * np.stack([np.sin(angle), np.zeros_like(t), -np.cos(angle)], axis=1)
    gyro = np.stack([np.full_like(t, 0.02), rate - 0.01, np.full_like(t, 0.03)], axis=1)
    gyro += tremor * np.sin(2 * np.pi * 3.0 * t)[:, None]
    return t, accel + 0.03 * rng.standard_normal(accel.shape), gyro + 0.002 * rng.standard_normal(gyro.shape)


@pytest.mark.parametrize("tremor", [0.0, 0.01])
def test_every_rest_is_a_pose(tremor: float) -> None:
    poses = find_poses(*hand_turned(np.random.default_rng(1), 12, tremor))
    assert len(poses) == 12


def test_means_are_those_at_rest() -> None:
    t, accel, gyro = hand_turned(np.random.default_rng(2), 6)
    poses = find_poses(t, accel, gyro)
    angle = 0.9 * np.arange(6)
    expected = 9.8 * np.stack([np.sin(angle), np.zeros(6), -np.cos(angle)], axis=1)
    np.testing.assert_allclose(poses.mean[:, :3], expected, atol=4 * 0.03 / np.sqrt(poses.count.min()))


def test_a_log_that_never_rests_is_refused() -> None:
    t = np.arange(2000) / 100.0
    angle = 2.0 * t + 0.3 * np.sin(5 * t)
    accel = 9.8 * np.stack([np.sin(angle), np.cos(angle), 0.1 * np.sin(3 * t)], axis=1)
    with pytest.raises(InputError, match="static poses"):
        find_poses(t, accel, at_least=6)
