"""Gyroscope calibration by turns: integration, Jacobian, recovery, published values."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.calibration.poses.gyro import (
    calibrate_gyro,
    integrate_turns,
    read_turns,
    rotation_increments,
    running_product,
)
from sinan.experiments.calibrate import as_json, calibrate_turns
from sinan.experiments.datasets import resolve
from sinan.experiments.report.calibration_words import summary
from sinan.sensors.errors import InputError
from sinan.sensors.rotation import matrix_from_quaternion, quaternion_exp, quaternion_multiply


def turned_log(rng: np.random.Generator, poses: int = 14, noise: float = 1.0):
    """Rests of 2 s and turns of 1 s about random axes at 100 Hz: t, accel, gyro (true, with white noise)."""
    t = np.arange(300 * poses) / 100.0
    axes = rng.standard_normal((poses, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    k = np.minimum(t // 3.0, poses - 1).astype(int)
    s = np.clip(t - 3.0 * k - 2.0, 0.0, 1.0)
    speed = 1.4 * 30 * s**2 * (1 - s) ** 2
    w = speed[:, None] * axes[k]
    q = np.concatenate([[[1.0, 0.0, 0.0, 0.0]], running_product(rotation_increments(t, w))])
    f = -9.8 * matrix_from_quaternion(q)[:, 2, :]
    accel = f + noise * 0.02 * rng.standard_normal(f.shape)
    return t, accel, w + noise * 0.002 * rng.standard_normal(w.shape)


def test_runge_kutta_against_the_closed_form() -> None:
    w = np.tile([0.3, -1.2, 2.0], (50, 1))
    t = np.arange(50) / 100.0
    p = rotation_increments(t, w)
    np.testing.assert_allclose(p, quaternion_exp(np.diff(t)[:, None] * w[1:]), atol=1e-10)


def test_running_product_is_the_product() -> None:
    q = quaternion_exp(np.random.default_rng(1).normal(0, 0.3, (37, 3)))
    expected = q[0]
    for one in q[1:]:
        expected = quaternion_multiply(expected, one)
    np.testing.assert_allclose(running_product(q)[-1], expected, atol=1e-12)


def test_turn_derivative_against_central_differences() -> None:
    rng = np.random.default_rng(2)
    t, accel, gyro = turned_log(rng, 5)
    log = read_turns(t, accel, gyro, 9.8)
    D = np.stack([gyro * d for d in np.eye(3)], axis=2)  # by a scale on each axis
    h = 1e-5

    def carried(scale: np.ndarray) -> np.ndarray:
        return integrate_turns(t, log.turns, log.direction[:-1], gyro * (1 + scale)).predicted

    columns = [(carried(h * d) - carried(-h * d)) / (2 * h) for d in np.eye(3)]
    analytic = integrate_turns(t, log.turns, log.direction[:-1], gyro).derivative(D)
    np.testing.assert_allclose(analytic, np.stack(columns, axis=2), atol=2e-4 * 9.8)


def test_scale_axes_and_bias_come_back() -> None:
    rng = np.random.default_rng(3)
    t, accel, gyro = turned_log(rng, 30)
    M = np.array([[1.01, 0.008, -0.012], [0.005, 0.985, 0.01], [-0.006, 0.009, 1.02]])
    bias = np.array([0.02, -0.03, 0.01])
    result = calibrate_gyro(read_turns(t, accel, gyro @ M.T + bias, 9.8))
    error = result.T @ np.diag(result.K) - np.linalg.inv(M)
    assert np.max(np.abs(error)) < 4e-3
    np.testing.assert_allclose(result.offset, -bias, atol=5e-4)
    assert result.sse < 0.2 * result.sse_before


def test_turns_about_one_axis_leave_the_others_open() -> None:
    rng = np.random.default_rng(4)
    t = np.arange(3000) / 100.0
    k = (t // 3.0).astype(int)
    s = np.clip(t - 3.0 * k - 2.0, 0.0, 1.0)
    w = np.stack([1.1 * 30 * s**2 * (1 - s) ** 2, np.zeros_like(t), np.zeros_like(t)], axis=1)
    q = np.concatenate([[[1.0, 0.0, 0.0, 0.0]], running_product(rotation_increments(t, w))])
    f = -9.8 * matrix_from_quaternion(q)[:, 2, :]
    accel, gyro = f + 0.02 * rng.standard_normal(f.shape), w + 1e-3 * rng.standard_normal(w.shape)
    result = calibrate_gyro(read_turns(t, accel, gyro, 9.8))
    assert result.std()["K"][1] > 20 * result.std()["K"][0]


def test_degrees_are_recognised() -> None:
    t, accel, gyro = turned_log(np.random.default_rng(5), 10)
    with pytest.raises(InputError, match="looks like deg/s"):
        calibrate_gyro(read_turns(t, accel, np.rad2deg(gyro), 9.8))


@pytest.mark.parametrize(
    ("scale", "bias", "says"),
    [(1e3, 0.0, "times longer.: looks like another unit"), (1e-3, 0.0, "times shorter"), (1.0, 10.0, "at rest")],
)
def test_other_units_are_named_with_the_size_after_conversion(scale: float, bias: float, says: str) -> None:
    t, accel, gyro = turned_log(np.random.default_rng(5), 10)
    with pytest.raises(InputError, match=f"{says}.*rad/s, after the conversion of a map"):
        read_turns(t, accel, scale * gyro + bias, 9.8)


def test_residuals_of_turns_are_angles() -> None:
    t, accel, gyro = turned_log(np.random.default_rng(6))
    result = calibrate_gyro(read_turns(t, accel, gyro, 9.8))
    document = as_json("gyro", result)
    assert document["sse"] == pytest.approx(result.sse / 9.8**2)
    assert "rad^2" in summary("gyro", document)


@pytest.mark.measured
@pytest.mark.usefixtures("measured_data")
@pytest.mark.parametrize(
    ("unit", "scale", "bias"),
    [
        ("imu0", (0.041, 0.457, 0.826), (1.146, -0.401, 1.261)),
        ("imu1", (0.007, 0.26, -0.179), (-0.573, 1.089, 0.286)),
        ("imu2", (-0.058, 0.277, 0.242), (0.573, -0.344, 1.261)),
    ],
)
def test_published_values_of_three_units(unit: str, scale: tuple[float, ...], bias: tuple[float, ...]) -> None:
    """Scale within 0.35 % and bias within 0.1 deg/s of what the owners of the units published (ICINS 2020)."""
    result = calibrate_turns(resolve(f"mpu9150_imu_calib/{unit}.log"), "full", None)
    np.testing.assert_allclose(100.0 * (1.0 / result.K - 1.0), scale, atol=0.35)
    np.testing.assert_allclose(np.rad2deg(-result.offset), bias, atol=0.1)


@pytest.mark.measured
@pytest.mark.usefixtures("measured_data")
def test_factory_certificate_of_the_xsens() -> None:
    """Counts per rad/s within 0.2 % and offsets within 35 counts of the factory's."""
    recording = resolve("xsens_mti_imu_tk/xsens_acc.mat.gz")
    result = calibrate_turns(recording, "full", 9.81744)
    np.testing.assert_allclose(4770.0 / result.K, [4778.0, 4758.0, 4766.0], rtol=2e-3)
    np.testing.assert_allclose(32768.0 - 4770.0 * result.offset, [32768.0, 32466.0, 32485.0], atol=35.0)
