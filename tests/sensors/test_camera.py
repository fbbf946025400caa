"""The camera against OpenCV's numbers (tests/golden/camera_opencv.py), the course's matrices, and differences."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sinan.sensors.arrays import FloatArray
from sinan.sensors.camera import LOOKS_AHEAD, M2, Camera, Intrinsics
from sinan.sensors.lenses import LENSES, bend, straighten
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import matrix_from_quaternion, quaternion_from_rpy, rotation_exp

GOLDEN = json.loads((Path(__file__).parents[1] / "golden" / "camera_opencv.json").read_text())
NANOPIXEL = 1e-9
COMPLEX_STEP = 1e-30


def intrinsics(lens: str) -> Intrinsics:
    """Those of the table."""
    return Intrinsics(np.array(GOLDEN["f"]), np.array(GOLDEN["centre"]), lens, np.array(GOLDEN[lens]["k"]))


def points_c(lens: str) -> FloatArray:
    """The table's points in the camera."""
    table = GOLDEN[lens]
    return np.array(table["points"]) @ np.array(table.get("rotation", np.eye(3))).T + table.get("translation", 0.0)


@pytest.mark.parametrize("lens", LENSES)
def test_pixels_are_those_of_opencv(lens: str) -> None:
    np.testing.assert_allclose(intrinsics(lens).pixels(points_c(lens)), GOLDEN[lens]["pixels"], atol=NANOPIXEL)


def test_slopes_are_those_of_opencv() -> None:
    """A point in the camera moves with the translation; OpenCV's order is f, centre, k too."""
    by_P, by_values = intrinsics("brown").slopes(points_c("brown"))
    np.testing.assert_allclose(by_P, GOLDEN["brown"]["by_translation"], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(by_values, GOLDEN["brown"]["by_values"], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("lens", LENSES)
def test_slopes_are_those_of_a_complex_step(lens: str) -> None:
    """Im plane(x + i h) / h: no difference is taken, so no digit is lost."""
    model, k, P = LENSES[lens], np.array(GOLDEN[lens]["k"]), points_c(lens)
    P = np.vstack([P, [[1e-3, -2e-3, 2.0], [1e-7, 1e-7, 1.0]]])  # beside the axis
    by_P, by_k = model.slopes(P, k)
    for axis in range(3):
        stepped = model.plane(P + 1j * COMPLEX_STEP * np.eye(3)[axis], k)
        np.testing.assert_allclose(by_P[..., axis], np.imag(stepped) / COMPLEX_STEP, rtol=1e-11, atol=1e-12)
    for j in range(len(k)):
        stepped = model.plane(P.astype(complex), k + 1j * COMPLEX_STEP * np.eye(len(k))[j])
        np.testing.assert_allclose(by_k[..., j], np.imag(stepped) / COMPLEX_STEP, rtol=1e-11, atol=1e-14)


@pytest.mark.parametrize("lens", LENSES)
def test_on_the_axis_a_lens_is_a_pinhole(lens: str) -> None:
    """x = X / (Z (1 + xi)) to first order: the slope there is 1 / Z, of the omnidirectional one 1 / (Z (1 + xi))."""
    k = np.array(GOLDEN[lens]["k"])
    by_P, by_k = LENSES[lens].slopes(np.array([[0.0, 0.0, 2.5]]), k)
    per_metre = 1.0 / (2.5 * (1.0 + (k[0] if lens == "omnidirectional" else 0.0)))
    np.testing.assert_allclose(by_P[0], per_metre * np.eye(2, 3), atol=1e-15)
    np.testing.assert_allclose(by_k[0], 0.0, atol=1e-15)
    np.testing.assert_array_equal(LENSES[lens].ray(np.zeros((1, 2)), k), [[0.0, 0.0, 1.0]])


@pytest.mark.parametrize("lens", LENSES)
def test_a_ray_goes_back_to_its_point(lens: str) -> None:
    P = points_c(lens)
    rays = intrinsics(lens).rays(np.array(GOLDEN[lens]["pixels"]))
    np.testing.assert_allclose(rays, P / np.linalg.norm(P, axis=1)[:, None], atol=1e-9)


@pytest.mark.parametrize(
    ("lens", "k"), [("fisheye", [0.0, 0.0]), ("omnidirectional", [1.0]), ("omnidirectional", [1.6])]
)
def test_wide_lenses_see_beside_the_camera(lens: str, k: list[float]) -> None:
    """An equidistant fisheye puts 100 deg at theta; Mei's sphere at sin / (cos + xi): by the definition of each."""
    angle, round_axis = np.deg2rad(100.0), np.deg2rad(30.0)
    away = np.array([np.cos(round_axis), np.sin(round_axis)])
    ray = np.array([[*(np.sin(angle) * away), np.cos(angle)]])
    camera = Intrinsics(np.array([200.0, 200.0]), np.array([320.0, 240.0]), lens, np.array(k))
    radius = angle if lens == "fisheye" else np.sin(angle) / (np.cos(angle) + k[0])
    uv = camera.pixels(0.3 * ray)
    np.testing.assert_allclose(uv[0], np.array([320.0, 240.0]) + 200.0 * radius * away)
    np.testing.assert_allclose(camera.rays(uv), ray, atol=1e-12)


@pytest.mark.parametrize(
    ("lens", "k", "P"),
    [
        ("brown", [], [0.1, 0.2, -1.0]),
        ("brown", [], [0.1, 0.2, 0.0]),
        ("fisheye", [], [0.0, 0.0, -1.0]),
        ("omnidirectional", [0.5], [0.1, 0.0, -1.0]),
        ("omnidirectional", [2.0], [0.1, 0.0, -1.0]),  # hidden: another point further ahead has the same pixel
    ],
)
def test_what_a_lens_does_not_see_is_not_a_number(lens: str, k: list[float], P: list[float]) -> None:
    camera = Intrinsics(np.array([200.0, 200.0]), np.array([320.0, 240.0]), lens, np.array(k))
    assert np.all(np.isnan(camera.pixels(np.array([P]))))
    assert np.all(np.isnan(camera.slopes(np.array([P]))[0]))


def test_a_place_that_no_direction_reaches_is_not_a_number() -> None:
    """r (1 - r^2 / 3) is largest at r = 1, with 2/3: nothing is seen at 0.7, and what is beyond 1 is folded over."""
    k = np.array([-1.0 / 3.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(
        straighten(np.array([[0.5, 0.0]]), k)[0], [np.roots([-1.0 / 3.0, 0.0, 1.0, -0.5])[2], 0.0]
    )
    assert np.all(np.isnan(straighten(np.array([[r, 0.0] for r in np.linspace(0.67, 2.0, 40)]), k)))
    assert np.all(
        np.isnan(Intrinsics(np.ones(2), np.zeros(2), "fisheye", np.array([-0.2])).rays(np.array([[2.0, 0.0]])))
    )
    assert np.all(np.isnan(Intrinsics(np.ones(2), np.zeros(2), "fisheye").rays(np.array([[3.2, 0.0]]))))


def test_a_fisheye_that_folds_and_one_that_is_steep() -> None:
    """theta (1 - theta^2 / 5) is largest at 1.29, with 0.861; theta (1 + 4 theta^2) is 5 at 1."""
    folded = Intrinsics(np.ones(2), np.zeros(2), "fisheye", np.array([-0.2]))
    assert np.all(np.isnan(folded.rays(np.array([[r, 0.0] for r in np.linspace(0.87, 3.0, 40)]))))
    steep = Intrinsics(np.ones(2), np.zeros(2), "fisheye", np.array([4.0]))
    np.testing.assert_allclose(steep.rays(np.array([[5.0, 0.0]])), [[np.sin(1.0), 0.0, np.cos(1.0)]], atol=1e-12)


def test_folding_counts_in_every_direction() -> None:
    """The same radius on the diagonal, where both plane coordinates share it."""
    k, diagonal = np.array([-1.0 / 3.0, 0.0, 0.0, 0.0]), np.array([[1.0, 1.0]]) / np.sqrt(2.0)
    np.testing.assert_allclose(straighten(0.66 * diagonal, k), np.roots([-1.0 / 3.0, 0.0, 1.0, -0.66])[2] * diagonal)
    assert np.all(np.isnan(straighten(0.67 * diagonal, k)))


def test_what_has_not_settled_is_not_a_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sinan.sensors.lenses._ROUNDS", 1)
    assert np.all(np.isnan(straighten(np.array([[0.5, 0.0], [-0.5, 0.0]]), np.array([-0.2, 0.0, 0.0, 0.0]))))
    for off in (0.5, -0.5):
        camera = Intrinsics(np.ones(2), np.zeros(2), "fisheye", np.array([np.sign(off) * 0.2]))
        assert np.all(np.isnan(camera.rays(np.array([[abs(off), 0.0]]))))


@pytest.mark.parametrize("angle", [1e-9, 1e-4, 5e-3, 6.3e-3, 0.4, 1.5, 1.7, 3.1])
def test_an_equidistant_fisheye_shows_the_angle(angle: float) -> None:
    """Also where arctan is its series: theta itself, to rounding."""
    seen = LENSES["fisheye"].plane(np.array([[3.0 * np.sin(angle), 0.0, 3.0 * np.cos(angle)]]), np.zeros(4))
    np.testing.assert_allclose(seen[0, 0], angle, rtol=3e-15 if angle < 3.0 else 1e-13)


def test_barrel_draws_in_and_p1_lifts() -> None:
    """Signs by Brown's figure: k1 < 0 draws the corner in; p1 alone moves (0, y) by 3 p1 y^2 along y."""
    assert np.all(bend(np.array([[0.5, 0.5]]), np.array([-0.1, 0.0, 0.0, 0.0])) < 0.5)
    np.testing.assert_allclose(bend(np.array([[0.0, 0.5]]), np.array([0.0, 0.0, 0.01, 0.0])), [[0.0, 0.5 + 0.0075]])


def test_undistorted_pixels_lie_on_straight_lines() -> None:
    camera = intrinsics("brown")
    line = np.array([[-1.0, 0.4, 2.0]]) + np.linspace(0.0, 1.0, 9)[:, None] * np.array([[1.8, 0.3, 0.4]])
    seen, straight = camera.pixels(line), camera.undistorted(camera.pixels(line))
    bent = [np.linalg.svd(uv - uv.mean(axis=0))[1][1] for uv in (seen, straight)]
    assert bent[0] > 1.0
    assert bent[1] < 1e-7
    pinhole = Intrinsics(camera.f, camera.centre).pixels(line)
    np.testing.assert_allclose(straight, pinhole, atol=1e-7)


def test_the_course_in_one_product() -> None:
    """s (u, v, 1) = M1 M2 (P_e, 1): a lens of 8 mm, pixels of 10 and 12.5 um, 2 m ahead and 0.5 m to the right."""
    camera = Intrinsics.from_millimetres(8.0, 0.010, 0.0125, 320.0, 240.0)
    R, T = rotation_exp(np.array([0.1, -0.4, 0.7])), np.array([0.2, -0.1, 0.3])
    P_c = np.array([0.5, -0.25, 2.0])
    P_e = R.T @ (P_c - T)
    s_uv = camera.M1 @ M2(R, T) @ np.append(P_e, 1.0)
    np.testing.assert_allclose(s_uv / s_uv[2], [320.0 + 800.0 * 0.25, 240.0 - 640.0 * 0.125, 1.0])
    np.testing.assert_allclose(camera.pixels(P_c[None])[0], (s_uv / s_uv[2])[:2])
    assert s_uv[2] == pytest.approx(2.0)


def flight() -> Motion:
    """A body that flies at 10 m and leans a little, with points ahead of it."""
    rng = np.random.default_rng(3)
    return Motion(
        t=np.arange(6.0),
        p_n=rng.normal(0.0, 2.0, (6, 3)) + np.array([0.0, 0.0, -10.0]),
        q_nb=quaternion_from_rpy(rng.normal(0.0, 0.2, (6, 3))),
        covariates={"point_n": rng.normal(0.0, 3.0, (6, 3)) + np.array([20.0, 0.0, -8.0])},
    )


def test_north_is_ahead_east_to_the_right_and_down_below() -> None:
    """Level, nose to the north, the camera 0.3 m ahead: (10, 1, 2) m away is 9.7 deep, 1 right, 2 down."""
    at = Motion(np.zeros(1), p_n=np.array([[5.0, 6.0, -7.0]]), q_nb=np.array([[1.0, 0.0, 0.0, 0.0]]))
    at = at.with_covariates(point_n=np.array([[15.0, 7.0, -5.0]]))
    camera = Camera(1.0, Intrinsics(np.array([485.0, 970.0]), np.array([320.0, 240.0])), l_b=np.array([0.3, 0.0, 0.0]))
    np.testing.assert_allclose(camera.predict(at), [[320.0 + 485.0 / 9.7, 240.0 + 970.0 * 2.0 / 9.7]])


def test_the_body_carries_the_camera_as_the_course_says() -> None:
    """R = C_cb C_bn, T = -R p_n - C_cb l_b put into M1 M2, for a camera that sits askew."""
    at, C_bc = flight(), LOOKS_AHEAD @ rotation_exp(np.array([0.1, 0.2, -0.3]))
    camera = Camera(1.0, intrinsics("brown"), C_bc, np.array([0.3, -0.1, 0.2]))
    pinhole = replace(camera, intrinsics=Intrinsics(camera.intrinsics.f, camera.intrinsics.centre))
    for k in range(len(at)):
        R = C_bc.T @ matrix_from_quaternion(at.q_nb[k]).T
        P = M2(R, -R @ at.p_n[k] - C_bc.T @ camera.l_b) @ np.append(at.covariates["point_n"][k], 1.0)
        s_uv = pinhole.intrinsics.M1 @ P
        np.testing.assert_allclose(pinhole.predict(at)[k], s_uv[:2] / s_uv[2])
        np.testing.assert_allclose(camera.predict(at)[k], camera.intrinsics.pixels(P[None, :3])[0])


def test_values_go_in_and_out() -> None:
    camera = intrinsics("omnidirectional")
    again = camera.with_values(camera.values)
    assert again.lens == camera.lens
    np.testing.assert_array_equal(again.values, camera.values)
    assert camera.names == ("f_x", "f_y", "u0", "v0", "xi", "k1", "k2", "p1", "p2")
    np.testing.assert_array_equal(camera.values[:4], [*GOLDEN["f"], *GOLDEN["centre"]])


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"lens": "mirror"}, "`lens` is 'mirror'"),
        ({"f": np.ones(3)}, r"`f` has shape \(3,\)"),
        ({"centre": np.array([1.0, np.nan])}, "`centre` is not finite"),
        ({"k": np.ones(6)}, "a brown lens has at most k1, k2, p1, p2, k3"),
        ({"k": np.ones((1, 2))}, "`k` has shape"),
    ],
)
def test_wrong_intrinsics_raise(wrong: dict[str, object], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        Intrinsics(**{"f": np.ones(2), "centre": np.zeros(2), **wrong})  # type: ignore[arg-type]


@pytest.mark.parametrize("lens", LENSES)
def test_opencv_itself_agrees(lens: str) -> None:
    """Its own functions where it is here, at other values than the table's."""
    cv2 = pytest.importorskip("cv2")
    rng = np.random.default_rng(8)
    f, centre = rng.uniform(300.0, 900.0, 2), rng.uniform(200.0, 500.0, 2)
    k = rng.normal(0.0, 0.02, len(LENSES[lens].coefficients))
    P = np.column_stack([rng.uniform(-1.0, 1.0, (50, 2)), rng.uniform(1.0, 3.0, 50)])
    K = np.array([[f[0], 0.0, centre[0]], [0.0, f[1], centre[1]], [0.0, 0.0, 1.0]])
    zero, camera = np.zeros(3), Intrinsics(f, centre, lens, k)
    if lens == "brown":
        expected = cv2.projectPoints(P[:, None], zero, zero, K, k)[0]
    elif lens == "fisheye":
        expected = cv2.fisheye.projectPoints(P[:, None], zero, zero, K, k)[0]
    elif hasattr(cv2, "omnidir"):
        expected = cv2.omnidir.projectPoints(P[:, None], zero, zero, K, float(k[0]), k[1:])[0]
    else:
        pytest.skip("this OpenCV has no omnidir")
    np.testing.assert_allclose(camera.pixels(P), expected[:, 0], atol=NANOPIXEL)
