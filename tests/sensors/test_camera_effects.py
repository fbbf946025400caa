"""The effects of a camera against OpenCV's and the course's formulas, written out for a point and a place."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from sinan.sensors.arrays import FloatArray
from sinan.sensors.camera import LOOKS_AHEAD, Camera, Intrinsics
from sinan.sensors.effects import CATALOGUE, effect, effects_for
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import matrix_from_quaternion, quaternion_exp, rotation_exp

CENTRE, F, K = np.array([320.0, 242.0]), np.array([500.0, 505.0]), np.array([-0.1, 0.02, 1e-3, -2e-3, 0.0])
L_B = np.array([0.2, -0.05, 0.1])
C_BC = LOOKS_AHEAD @ rotation_exp(np.array([0.02, -0.05, 0.03]))
CAMERA = Camera(0.5, Intrinsics(F, CENTRE, "brown", K), C_BC, L_B)
NAMES = [name for name in CATALOGUE if name.startswith("camera.")]
RATE = 1000.0


def path(t: FloatArray) -> Motion:
    """A body that moves and turns smoothly."""
    phase = np.multiply.outer(t, np.array([1.1, 0.7, 0.9]))
    p_n, v_n = np.sin(phase) * 2.0 - [0.0, 0.0, 5.0], 2.0 * np.array([1.1, 0.7, 0.9]) * np.cos(phase)
    axis = np.array([0.48, 0.6, 0.64])
    q_nb = quaternion_exp((0.3 * np.sin(2.0 * t))[:, None] * axis)
    return Motion(t, p_n, v_n, q_nb=q_nb, w_ib_b=(0.6 * np.cos(2.0 * t))[:, None] * axis)


def flight() -> Motion:
    t = np.arange(0.0, 2.0, 1.0 / RATE)
    points = np.random.default_rng(5).normal([12.0, 0.0, -4.0], 2.0, (len(t), 3))
    return path(t).with_covariates(point_n=points, camera=CAMERA.covariate(len(t)))


def pixels(P_c: FloatArray, f: FloatArray = F, centre: FloatArray = CENTRE, k: FloatArray = K) -> FloatArray:
    """OpenCV's documentation of `projectPoints`, term by term."""
    x, y = P_c[:, 0] / P_c[:, 2], P_c[:, 1] / P_c[:, 2]
    k1, k2, p1, p2, _ = k
    r2 = x**2 + y**2
    x_d = x * (1 + k1 * r2 + k2 * r2**2) + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    y_d = y * (1 + k1 * r2 + k2 * r2**2) + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    return np.column_stack([f[0] * x_d + centre[0], f[1] * y_d + centre[1]])


def seen(motion: Motion, C_bc: FloatArray = C_BC, l_b: FloatArray = L_B) -> FloatArray:
    """The points in the camera, one by one."""
    rows = zip(motion.q_nb, motion.p_n, motion.covariates["point_n"], strict=True)
    return np.array([C_bc.T @ (matrix_from_quaternion(q).T @ (point - p) - l_b) for q, p, point in rows])


BETA = {
    "camera.focal": np.array([0.02, -0.015]),
    "camera.principal_point": np.array([4.0, -7.0]),
    "camera.distortion": np.array([0.15, -0.1, 2e-3, 1e-3]),
    "camera.misalignment": np.array([0.03, -0.02, 0.05]),
    "camera.lever_arm": np.array([0.1, -0.2, 0.05]),
    "camera.time_offset": np.array([0.02]),
}
FORMULAS: dict[str, Callable[[Motion, FloatArray], FloatArray]] = {
    "camera.focal": lambda m, b: pixels(seen(m), F * (1.0 + b)),
    "camera.principal_point": lambda m, b: pixels(seen(m), centre=CENTRE + b),
    "camera.distortion": lambda m, b: pixels(seen(m), k=K + np.append(b, 0.0)),
    "camera.misalignment": lambda m, b: pixels(seen(m, rotation_exp(b) @ C_BC)),
    "camera.lever_arm": lambda m, b: pixels(seen(m, l_b=L_B + b)),
    "camera.time_offset": lambda m, b: pixels(seen(path(m.t - b[0]).with_covariates(**m.covariates))),
}


@pytest.mark.parametrize("name", NAMES)
def test_an_effect_is_its_formula(name: str) -> None:
    at = flight().rows(slice(100, None, 50))
    plain = CAMERA.predict(flight())[100::50]
    np.testing.assert_allclose(plain, pixels(seen(at)), atol=1e-9)
    whole = flight()
    got = effect(name).apply(CAMERA.predict(whole), BETA[name], whole, CAMERA)[100::50]
    np.testing.assert_allclose(got, FORMULAS[name](at, BETA[name]), atol=2e-4 if "time" in name else 1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_the_regressor_is_the_slope_of_the_formula(name: str) -> None:
    at, entry = flight().rows(slice(100, None, 50)), effect(name)
    G = entry.rows(at, 2)
    for j in range(entry.size):
        h = 1e-5 * np.eye(entry.size)[j]
        slope = (FORMULAS[name](at, h) - FORMULAS[name](at, -h)) / 2e-5
        np.testing.assert_allclose(G[:, :, j], slope, rtol=1e-5, atol=1e-4)


def test_nothing_is_no_change() -> None:
    at = flight()
    for name in NAMES:
        np.testing.assert_allclose(
            effect(name).change(CAMERA.predict(at), np.zeros(effect(name).size), at), 0.0, atol=1e-6
        )


@pytest.mark.parametrize("lens", ["brown", "fisheye", "omnidirectional"])
def test_a_camera_travels_with_the_motion(lens: str) -> None:
    camera = Camera(0.5, Intrinsics(F, CENTRE, lens, np.array([0.3, -0.1])), C_BC, L_B)
    at = flight().with_covariates(camera=camera.covariate(2000))
    again = Camera.of(at)
    assert again.intrinsics.lens == lens
    np.testing.assert_array_equal(again.intrinsics.values, camera.intrinsics.values)
    np.testing.assert_allclose(again.C_bc, C_BC, atol=1e-15)
    np.testing.assert_array_equal(again.l_b, L_B)


def test_distortion_of_a_point_behind_is_no_number() -> None:
    behind = flight().with_covariates(point_n=np.tile([-50.0, 0.0, 0.0], (2000, 1)))
    assert np.all(np.isnan(effect("camera.distortion").rows(behind, 2)))


def test_a_point_near_the_camera_is_seen() -> None:
    """0.4 m ahead of a level camera, 0.08 m to the right: x = 0.2, and k1 moves it by f x r^2."""
    here = Motion(np.zeros(1), np.zeros((1, 3)), q_nb=np.array([[1.0, 0.0, 0.0, 0.0]]))
    camera = Camera(1.0, Intrinsics(F, CENTRE))
    here = here.with_covariates(point_n=np.array([[0.4, 0.08, 0.0]]), camera=camera.covariate(1))
    np.testing.assert_allclose(effect("camera.distortion").rows(here, 2)[0, :, 0], [F[0] * 0.2 * 0.04, 0.0], atol=1e-12)


def test_they_are_candidates_where_there_is_a_camera() -> None:
    assert {e.name for e in effects_for("flight", ("camera",))} == set(NAMES)
    assert all(effect(name).missing(flight()) == () for name in NAMES)
    assert "point_n" in effect("camera.focal").missing(path(np.arange(3.0)))
