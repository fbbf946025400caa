"""Norm calibration: the course's numbers, what cannot be determined, the Cramer-Rao bound."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from sinan.calibration.poses.triad import calibrate_norm, norm_jacobian, norm_residual, require_possible
from sinan.experiments.datasets import resolve
from sinan.experiments.residual_loop.open_source import triad_readings
from sinan.sensors.errors import InputError

PRINTED_DIGIT = 0.5e-4  # the course prints four decimals


def directions(rng: np.random.Generator, n: int) -> np.ndarray:
    u = rng.standard_normal((n, 3))
    return u / np.linalg.norm(u, axis=1, keepdims=True)


def course(name: str, gravity: float | None = None):
    readings = triad_readings(
        resolve(f"rfly_course/{name}"), "mag" if "Mag" in name or "_m_" in name else "accel", gravity
    )
    return readings, calibrate_norm(
        readings.sensor, readings.reading, readings.norm, normalised_by=readings.normalised_by
    )


@pytest.mark.measured
@pytest.mark.usefixtures("measured_data")
class TestCourse:
    def test_accelerometer_to_the_printed_digits(self) -> None:
        _, result = course("AccRaw.mat", 9.8)
        np.testing.assert_allclose(result.K, [0.9912, 0.9974, 0.9947], atol=PRINTED_DIGIT)
        np.testing.assert_allclose(result.offset, [0.0168, 0.2691, 0.1253], atol=PRINTED_DIGIT)

    def test_with_unit_gravity_the_optimum_scales_and_the_offset_stays(self) -> None:
        _, nine = course("AccRaw.mat", 9.8)
        _, one = course("AccRaw.mat", 1.0)
        np.testing.assert_allclose(one.K, nine.K / 9.8, rtol=1e-8)
        np.testing.assert_allclose(one.offset, nine.offset, atol=1e-8)

    def test_the_printed_offset_at_unit_gravity_is_no_minimum(self) -> None:
        """The course's solver stopped early: its own printed numbers leave a larger sum of squares."""
        readings, one = course("AccRaw.mat", 1.0)
        printed = np.array([0.1012, 0.1017, 0.1014, 0.0123, 0.2771, 0.1456])
        at_printed_offset = min(
            np.sum(norm_residual(np.concatenate([one.K * k, printed[3:]]), readings.reading, 1.0) ** 2)
            for k in np.linspace(0.98, 1.02, 401)
        )
        assert at_printed_offset > 1.2 * one.fit.sse

    def test_pitch_does_not_depend_on_gravity(self) -> None:
        turned = resolve("rfly_course/accdata.mat").streams["poses"].array(("accel_x", "accel_y", "accel_z"))
        _, nine = course("AccRaw.mat", 9.8)
        _, one = course("AccRaw.mat", 1.0)
        pitch = [np.arctan2(f[:, 0], -f[:, 2]) for f in (nine.apply(turned), one.apply(turned))]
        np.testing.assert_allclose(pitch[0], pitch[1], atol=1e-7)

    def test_magnetometer_to_the_printed_digits(self) -> None:
        _, result = course("MagRaw.mat")
        np.testing.assert_allclose(result.K, [0.9853, 1.0202, 1.0004], atol=PRINTED_DIGIT)
        np.testing.assert_allclose(result.offset[:2], [-0.1448, -0.0334], atol=PRINTED_DIGIT)
        assert result.fit.sse == pytest.approx(0.47, abs=0.005)

    def test_the_data_decide_the_sign_of_the_vertical_offset(self) -> None:
        """The course prints b_z = -0.0898; with that sign the cost is twelve times the minimum."""
        readings, result = course("MagRaw.mat")
        assert result.offset[2] == pytest.approx(0.0898, abs=PRINTED_DIGIT)
        printed = np.array([0.9853, 1.0202, 1.0004, -0.1448, -0.0334, -0.0898])
        assert np.sum(norm_residual(printed, readings.reading, 1.0) ** 2) > 5.0 * result.fit.sse

    def test_raw_log_gives_the_ten_poses(self) -> None:
        _, from_log = course("e_acc1_A.bin", 9.8)
        _, from_mat = course("AccRaw.mat", 9.8)
        np.testing.assert_allclose(from_log.K, from_mat.K, atol=PRINTED_DIGIT)
        np.testing.assert_allclose(from_log.offset, from_mat.offset, atol=10 * PRINTED_DIGIT)

    def test_raw_log_gives_the_magnetometer(self) -> None:
        _, from_log = course("e3_m_A.bin")
        _, from_mat = course("MagRaw.mat")
        np.testing.assert_allclose(from_log.K, from_mat.K, atol=1e-6)
        np.testing.assert_allclose(from_log.offset, from_mat.offset, atol=1e-6)


def test_jacobian_against_central_differences() -> None:
    rng = np.random.default_rng(1)
    readings = directions(rng, 20) * 9.8
    x = np.concatenate([rng.uniform(0.9, 1.1, 3), rng.normal(0, 0.2, 3), rng.normal(0, 0.05, 3), rng.normal(0, 0.1, 3)])
    h = 1e-6
    columns = [
        (norm_residual(x + h * d, readings, 9.8) - norm_residual(x - h * d, readings, 9.8)) / (2 * h)
        for d in np.eye(12)
    ]
    np.testing.assert_allclose(norm_jacobian(x, readings), np.transpose(columns), atol=1e-7)


def test_rotation_is_found_undetermined_and_not_returned() -> None:
    rng = np.random.default_rng(2)
    readings = directions(rng, 60) + 0.1 + 1e-3 * rng.standard_normal((60, 3))
    result = calibrate_norm("mag", readings, 1.0, "full")
    assert len(result.undetermined) == 3
    assert all("rotation about" in sentence for sentence in result.undetermined)
    assert np.isnan(result.T[~np.eye(3, dtype=bool)]).all()
    np.testing.assert_allclose(result.fit.singular_values[9:], 0.0, atol=1e-12)


def test_triangular_axes_are_found() -> None:
    rng = np.random.default_rng(3)
    M = np.array([[1.02, 0.03, -0.02], [0.0, 0.98, 0.015], [0.0, 0.0, 1.01]])
    readings = directions(rng, 400) @ M.T + [0.1, -0.2, 0.3] + 1e-4 * rng.standard_normal((400, 3))
    result = calibrate_norm("mag", readings, 1.0, "triangular")
    np.testing.assert_allclose(result.T @ np.diag(result.K), np.linalg.inv(M), atol=1e-4)
    assert not result.undetermined


def test_offset_many_times_the_field_is_no_hindrance() -> None:
    rng = np.random.default_rng(4)
    readings = 700.0 * directions(rng, 500) * [1.0, 0.8, 1.5] + [6000.0, -900.0, 3500.0] + rng.standard_normal((500, 3))
    result = calibrate_norm("mag", readings / 7000.0, 1.0)
    np.testing.assert_allclose(result.K, 10.0 / np.array([1.0, 0.8, 1.5]), rtol=1e-3)


def test_poses_in_one_plane_leave_directions_open() -> None:
    angle = np.linspace(0.0, 2 * np.pi, 40, endpoint=False)
    readings = np.stack([np.cos(angle), np.sin(angle), np.full(40, 0.1)], axis=1)
    result = calibrate_norm("mag", readings, 1.0)
    assert any("z" in sentence for sentence in result.undetermined)


@pytest.mark.parametrize("axes", ["none", "triangular"])
def test_cramer_rao_bound_is_reached(axes: str) -> None:
    """Over 200 runs the mean squared error over the bound is 1 within 1 dB, and each parameter in its interval."""
    rng = np.random.default_rng(5)
    runs, sigma, u = 200, 0.02, 9.8 * directions(rng, 30)
    K, b = np.array([1.02, 0.97, 1.01]), np.array([0.1, -0.2, 0.15])
    T = np.eye(3)
    if axes == "triangular":
        T[np.triu_indices(3, 1)] = [0.01, -0.02, 0.015]
    truth = np.concatenate([K, b, T[np.triu_indices(3, 1)]])[: 6 if axes == "none" else 9]
    clean = u @ np.linalg.inv(T @ np.diag(K)).T - b
    errors = []
    for _ in range(runs):
        readings = clean + sigma * rng.standard_normal(clean.shape)
        errors.append(calibrate_norm("accel", readings, 9.8, axes).fit.x - truth)
    J = norm_jacobian(truth, clean)
    spread = sigma * np.linalg.norm((u / 9.8) @ T @ np.diag(K), axis=1)  # of one residual, by propagation of the noise
    weighted = J / spread[:, None]
    bound = np.diag(np.linalg.inv(weighted.T @ weighted))
    ratio = np.mean(np.square(errors), axis=0) / bound
    assert abs(10 * np.log10(ratio.mean())) < 1.0
    family = 0.01 / len(truth)
    low, high = stats.chi2.ppf([family / 2, 1 - family / 2], runs) / runs
    assert np.all((low < ratio) & (ratio < high)), ratio


@pytest.mark.parametrize(
    ("readings", "found"),
    [
        (np.eye(3), "3 readings"),
        (np.tile([0.0, 0.0, -9.8], (20, 1)), "point the same way"),
    ],
)
def test_bad_input_is_named(readings: np.ndarray, found: str) -> None:
    with pytest.raises(InputError, match=found):
        calibrate_norm("accel", readings, 9.8)


def test_nan_is_named_with_its_row() -> None:
    readings = directions(np.random.default_rng(6), 20)
    readings[7, 1] = np.nan
    with pytest.raises(ValueError, match=r"index \(7, 1\)"):
        calibrate_norm("accel", readings, 1.0)


def test_spread_of_the_path(tmp_path: Path) -> None:
    """Readings that differ by less than a degree are no calibration."""
    rng = np.random.default_rng(7)
    readings = np.array([0.0, 0.0, -9.8]) + 0.02 * rng.standard_normal((50, 3))
    with pytest.raises(InputError, match="turn the sensor"):
        calibrate_norm("accel", readings, 9.8, where=str(tmp_path))


@pytest.mark.measured
@pytest.mark.usefixtures("measured_data")
def test_readings_in_a_narrow_cone_are_refused_and_not_fitted_from_infinity() -> None:
    """The autopilot turned about its pitch axis alone: the free minimum lies seventy times gravity away."""
    with pytest.raises(InputError, match="all round the sphere"):
        course("accdata.mat", 9.8)


def test_response_against_differences() -> None:
    """Calibrated readings follow their own reading and, through the fit, all others."""
    rng = np.random.default_rng(41)
    u = rng.standard_normal((12, 3))
    r = 9.8 * u / np.linalg.norm(u, axis=1, keepdims=True) * [1.02, 0.98, 1.01] + [0.1, -0.2, 0.3]
    response = calibrate_norm("accel", r, 9.8, "triangular").response(r)
    h = 1e-5
    for k in (0, 16, 35):
        step = h * np.eye(36)[k].reshape(12, 3)
        up, down = (calibrate_norm("accel", x, 9.8, "triangular").apply(x) for x in (r + step, r - step))
        np.testing.assert_allclose(response[:, k], ((up - down) / (2 * h)).ravel(), atol=1e-4)


def fitted(readings: np.ndarray) -> None:
    require_possible(calibrate_norm("accel", readings, 9.81), 9.81, "log")


@pytest.mark.parametrize("unit", [1.0, 9.81], ids=["m/s^2", "g"])
def test_a_poor_accelerometer_at_rest_is_calibrated(unit: float) -> None:
    """Scales off by 15 %, offsets of 0.2 g, 2 % of noise: worse than any that is sold; the unit is another matter."""
    rng = np.random.default_rng(3)
    true = 9.81 * directions(rng, 60)
    readings = true * [1.15, 0.9, 1.0] + [2.0, -1.0, 0.5] + 0.2 * rng.standard_normal(true.shape)
    fitted(readings / unit)


def test_what_cannot_be_an_accelerometer_at_rest_is_refused() -> None:
    rng = np.random.default_rng(4)
    true = 9.81 * directions(rng, 60)
    with pytest.raises(InputError, match=r"scales .* differ by more than half: no accelerometer that rests"):
        fitted(true * [1.0, 2.4, 2.4])
    with pytest.raises(InputError, match=r"offsets -0.8, .* of gravity: no accelerometer that rests"):
        fitted(true + np.array([7.85, 0.0, 0.0]))
    with pytest.raises(InputError, match="of gravity off after the fit"):
        fitted(true * rng.uniform(0.6, 1.4, (60, 1)))
