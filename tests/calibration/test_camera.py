"""Camera calibration against OpenCV's result on its own pictures, and against simulated cameras with a known truth."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

import sinan.calibration.cameras.camera as calibration
from sinan.calibration.cameras.camera import (
    FORMS,
    CameraFit,
    Form,
    Pose,
    compare,
    fit,
    fit_without_misfits,
    focal_start,
    form,
    homography,
    resection,
)
from sinan.calibration.cameras.views import Board, View, Views, read_corners, views_of, write_corners
from sinan.sensors.arrays import FloatArray
from sinan.sensors.camera import Intrinsics
from sinan.sensors.errors import InputError

ROOT = Path(__file__).parents[2]
LEFT = ROOT / "experiments" / "camera" / "opencv_left.csv"
GOLDEN = json.loads((ROOT / "tests" / "golden" / "camera_left.json").read_text())
PICTURES = ROOT / "tests" / "golden" / "opencv_left"
MILLIPIXEL = 1e-3
FALSE_ALARM = 1e-3
SIZE = (640, 480)
BOARD = Board(8, 6, 0.03)
TRUTH = {
    "k1 k2 p1 p2": Intrinsics(
        np.array([520.0, 526.0]), np.array([331.0, 236.0]), "brown", np.array([-0.25, 0.07, 1e-3, -8e-4])
    ),
    "fisheye": Intrinsics(
        np.array([240.0, 242.0]), np.array([322.0, 238.0]), "fisheye", np.array([0.05, -0.02, 4e-3, -1e-3])
    ),
    "unified": Intrinsics(np.array([420.0, 424.0]), np.array([325.0, 243.0]), "omnidirectional", np.array([1.1])),
}
#: Distance at which the board fills the picture [m]
NEAR = {"k1 k2 p1 p2": 0.28, "fisheye": 0.09, "unified": 0.09}


def left() -> Views:
    return read_corners(LEFT)


def simulated(camera: Intrinsics, number: int, seed: int, sigma: float, near: float = 0.28) -> list[View]:
    """Views of the board, turned by up to about 35 deg; only the corners that fall into the picture are there."""
    rng = np.random.default_rng(seed)
    views: list[View] = []
    while len(views) < number:
        X = BOARD.points
        middle = X.mean(axis=0)
        place = np.array([*rng.uniform(-0.12, 0.12, 2), rng.uniform(near, 2.0 * near)])
        pose = Pose(rng.normal(0.0, 0.3, 3), np.zeros(3))
        P = (X - middle) @ pose.R.T + place
        uv = camera.pixels(P)
        inside = np.all((uv > 0.0) & (uv < np.array(SIZE)), axis=1)  # before the noise, which would be cut one-sidedly
        uv += sigma * rng.standard_normal((len(X), 2))
        if np.sum(inside) >= 20:
            views.append(View(f"{len(views):02d}", X[inside], uv[inside]))
    return views


def test_the_result_is_opencvs() -> None:
    """The same minimum of the same corners: values, standard deviations and errors of `calibrateCameraExtended`."""
    found, opencv = fit(left().views, form("k1 k2 p1 p2 k3"), SIZE), GOLDEN["opencv"]
    assert found.form.names == ("f_x", "f_y", "u0", "v0", "k1", "k2", "p1", "p2", "k3")
    assert found.rms == pytest.approx(opencv["rms"], rel=1e-6)
    np.testing.assert_allclose(found.parameters[:4], opencv["values"][:4], atol=MILLIPIXEL)
    assert np.all(np.abs(found.parameters - opencv["values"]) < 1e-3 * np.array(opencv["std"]))
    np.testing.assert_allclose(found.std, opencv["std"], rtol=1e-4)
    np.testing.assert_allclose(found.rms_of_view, opencv["rms_of_view"], atol=1e-4)
    assert found.undetermined == ()


def test_the_published_camera_lies_within_its_error() -> None:
    """`left_intrinsics.yml` of OpenCV, from corners of an older detector, with f_x = f_y."""
    square = replace(form("k1 k2 p1 p2 k3"), square=True)
    found, published = fit(left().views, square, SIZE), GOLDEN["published"]
    assert found.form.names[:2] == ("f", "u0")
    off = (found.parameters - published["values"][1:]) / found.std
    assert np.all(np.abs(off) < 3.0)
    errors = np.array(published["rms_of_view"])
    usual = np.arange(13) != 1  # its second picture: 1.18 there
    np.testing.assert_allclose(found.rms_of_view[usual], errors[usual], atol=0.1)


def test_the_picture_that_does_not_fit_is_set_aside_by_name() -> None:
    found, aside = fit_without_misfits(left().views, form("k1 k2 p1 p2"), SIZE)
    assert [name for name, _ in aside] == ["left02.jpg"]
    assert aside[0][1] > 0.9
    assert found.rms < 0.25
    assert "left02.jpg" not in {view.name for view in found.views}


def test_no_picture_is_set_aside_of_good_ones() -> None:
    """40 sets of eight views with white noise."""
    for seed in range(40):
        views = simulated(TRUTH["k1 k2 p1 p2"], 8, seed, 0.2)
        found = fit(views, form("k1 k2 p1 p2"), SIZE, TRUTH["k1 k2 p1 p2"])
        assert calibration.that_do_not_fit(found) == ()


def test_a_moved_board_is_set_aside() -> None:
    """A picture whose board was bent: its first row is 4 pixels off."""
    views = simulated(TRUTH["k1 k2 p1 p2"], 8, 3, 0.2)
    views[4].pixels[:8] += 4.0
    _, aside = fit_without_misfits(views, form("k1 k2 p1 p2"), SIZE)
    assert [name for name, _ in aside] == ["04"]


@cache
def errors(lens: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(runs, parameters) estimate minus truth, by its sigma and whitened by its covariance; (runs,) noise."""
    truth, entry = TRUTH[lens], form(lens)
    expected = (truth.values @ entry.spread) / np.sum(entry.spread, axis=0)
    found = [fit(simulated(truth, 8, 100 + seed, 0.3, NEAR[lens]), entry, SIZE) for seed in range(20)]
    off = [one.parameters - expected for one in found]
    white = [np.linalg.solve(np.linalg.cholesky(one.covariance), d) for one, d in zip(found, off, strict=True)]
    scaled = [d / one.std for one, d in zip(found, off, strict=True)]
    return np.array(scaled), np.array(white), np.array([one.sigma for one in found])


@pytest.mark.parametrize("lens", TRUTH)
def test_errors_are_as_large_as_the_covariance_says(lens: str) -> None:
    """20 simulated calibrations of each lens: chi-square of each parameter and of all; the noise put in."""
    scaled, white, sigma = errors(lens)
    each = chi2.ppf([FALSE_ALARM / 20, 1.0 - FALSE_ALARM / 20], len(scaled))
    every = chi2.ppf([FALSE_ALARM / 2, 1.0 - FALSE_ALARM / 2], white.size)
    assert np.all((each[0] < np.sum(scaled**2, axis=0)) & (np.sum(scaled**2, axis=0) < each[1]))
    assert every[0] < np.sum(white**2) < every[1]
    assert np.mean(sigma) == pytest.approx(0.3, abs=0.01)


def test_coefficients_that_are_not_free_stay_zero() -> None:
    found = fit(simulated(TRUTH["k1 k2 p1 p2"], 6, 0, 0.1), form("k1"), SIZE)
    np.testing.assert_array_equal(found.intrinsics.k[1:], 0.0)
    assert found.intrinsics.k[0] < -0.1


@pytest.mark.parametrize(
    ("k", "expected"),
    [([], "pinhole"), ([-0.2], "k1"), ([-0.25, 0.12], "k1 k2"), ([-0.25, 0.12, 4e-3, -3e-3], "k1 k2 p1 p2")],
)
def test_held_out_pictures_call_for_the_lens_that_was_there(k: list[float], expected: str) -> None:
    truth = Intrinsics(np.array([420.0, 424.0]), np.array([325.0, 243.0]), "brown", np.array(k))
    chosen, told = compare(simulated(truth, 10, 5, 0.15), FORMS[:5], SIZE)
    assert chosen.name == expected
    by_name = {one.form.name: one for one in told}
    assert by_name[expected].rms == pytest.approx(0.15 * np.sqrt(2.0), rel=0.1)
    if expected != "pinhole":
        assert by_name["pinhole"].rms > 1.2 * by_name[expected].rms
    assert by_name[expected].behind[0] <= by_name[expected].behind[1]


def test_a_fisheye_is_called_a_fisheye() -> None:
    views = simulated(TRUTH["fisheye"], 12, 6, 0.15, NEAR["fisheye"])
    chosen, told = compare(views, [form("k1 k2 p1 p2"), form("fisheye")], SIZE)
    assert chosen.name == "fisheye"
    assert min(one.rms for one in told) == pytest.approx(0.15 * np.sqrt(2.0), rel=0.1)


def test_oblique_views_are_needed_for_the_focal_length() -> None:
    """Pictures straight ahead: a longer lens from further away shows the same, and that is said."""
    camera = Intrinsics(np.array([500.0, 500.0]), np.array([320.0, 240.0]))
    views = []
    for k, depth in enumerate((0.4, 0.5, 0.6)):
        X = BOARD.points
        views.append(View(str(k), X, camera.pixels(X - X.mean(axis=0) + np.array([0.01 * k, 0.0, depth]))))
    assert np.all(np.isnan(focal_start(views, np.array([320.0, 240.0]))))
    found = fit(views, form("pinhole"), SIZE, camera)
    assert any("f_x" in sentence for sentence in found.undetermined)
    assert np.isinf(found.std[0])


def test_the_start_is_zhangs_closed_form() -> None:
    """Exact without noise and distortion, with the principal point in the middle of the picture."""
    camera = Intrinsics(np.array([480.0, 510.0]), 0.5 * (np.array(SIZE) - 1.0))
    views = simulated(camera, 4, 1, 0.0)
    np.testing.assert_allclose(focal_start(views, camera.centre), camera.f, rtol=1e-9)
    view = views[0]
    H = homography(view.points[:, :2], view.pixels)
    s_uv = np.column_stack([view.points[:, :2], np.ones(len(view))]) @ H.T
    np.testing.assert_allclose(s_uv[:, :2] / s_uv[:, 2:], view.pixels, atol=1e-9)


def test_a_pose_is_found_again() -> None:
    camera = TRUTH["k1 k2 p1 p2"]
    pose = Pose(np.array([0.2, -0.3, 2.0]), np.array([0.05, -0.02, 0.4]))
    view = View("one", BOARD.points, camera.pixels(pose.points(BOARD.points)))
    found, residual = resection(view, camera)
    np.testing.assert_allclose(found.R, pose.R, atol=1e-9)
    np.testing.assert_allclose(found.T, pose.T, atol=1e-9)
    np.testing.assert_allclose(residual, 0.0, atol=1e-7)


def test_slopes_of_a_pose_are_those_of_differences() -> None:
    pose, X, h = Pose(np.array([0.4, -1.2, 0.7]), np.array([0.1, 0.2, 0.9])), BOARD.points[:5], 1e-6
    for j in range(6):
        step = h * np.eye(6)[j]
        ahead, behind = (Pose(pose.r + sign * step[:3], pose.T + sign * step[3:]).points(X) for sign in (1.0, -1.0))
        np.testing.assert_allclose(pose.slopes(X)[..., j], (ahead - behind) / (2.0 * h), atol=1e-9)


@pytest.mark.parametrize(
    ("views", "says"),
    [
        ([], "no view"),
        ([View("a", BOARD.points + np.array([0.0, 0.0, 0.1]), np.zeros((48, 2)))], "a: corners with z other than 0"),
        ([View("a", BOARD.points[:8], np.zeros((8, 2)))], "a: corners on one line"),
        ([View("a", BOARD.points[[0, 1, 9, 10]], np.zeros((4, 2)))], "8 coordinates of corners for 10 unknowns"),
    ],
)
def test_what_cannot_be_calibrated_raises(views: list[View], says: str) -> None:
    with pytest.raises(InputError, match=says):
        fit(views, form("pinhole"), SIZE)


def test_an_unknown_form_raises() -> None:
    with pytest.raises(InputError, match="form of the lens: mirror; expected pinhole, k1"):
        form("mirror")


def test_a_table_goes_out_and_in(tmp_path: Path) -> None:
    write_corners(tmp_path / "corners.csv", left().views[:2], SIZE)
    again = read_corners(tmp_path / "corners.csv")
    assert again.size == SIZE
    assert [view.name for view in again.views] == ["left01.jpg", "left02.jpg"]
    np.testing.assert_array_equal(again.views[1].pixels, left().views[1].pixels)
    np.testing.assert_array_equal(again.views[1].points, left().views[1].points)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "columns none; expected also image, x, y, u, v"),
        ("image,x,y,u\n", "expected also v"),
        ("image,x,y,u,v\na,0,0,1,two\n", "corner 1: a,0,0,1,two; expected an image and numbers"),
        ("image,x,y,u,v\na,0,0,1\n", "corner 1: a,0,0,1; expected an image and numbers"),
        ("image,x,y,u,v\na,0,0,1,nan\n", "expected finite numbers"),
        ("image,x,y,u,v\na,0,0,1,1\n", "1 images; expected an image with 6 corners or more"),
        ("# size = 640xtall\nimage,x,y,u,v\n", "size: 640xtall; expected width x height"),
    ],
)
def test_a_damaged_table_says_where(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "corners.csv").write_text(text)
    with pytest.raises(InputError, match=says):
        read_corners(tmp_path / "corners.csv")


def test_a_folder_needs_a_board_and_pictures(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="pictures and no board"):
        views_of(tmp_path, None)
    with pytest.raises(InputError, match="no picture"):
        views_of(tmp_path, BOARD)
    with pytest.raises(InputError, match="no such file or folder"):
        views_of(tmp_path / "nowhere", BOARD)


def drawn(camera: Intrinsics, pose: Pose, shade: object, fine: int = 4) -> FloatArray:
    """A picture (height, width) of the plane z = 0 of the target: `shade(x, y)` averaged over each pixel."""
    width, height = SIZE
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    rays = camera.rays(np.column_stack([u.ravel(), v.ravel()])).reshape(height, width, 3)
    down, across = np.gradient(rays, axis=(0, 1))
    steps = (np.arange(fine) + 0.5) / fine - 0.5
    rays = (
        rays[:, None, :, None]
        + steps[:, None, None, None] * down[:, None, :, None]
        + steps[:, None] * across[:, None, :, None]
    )
    rays = rays.reshape(-1, 3)
    ray_t, origin = rays @ pose.R, -pose.T @ pose.R
    reach = -origin[2] / ray_t[:, 2]
    x, y = (origin[:2] + reach[:, None] * ray_t[:, :2]).T
    values = np.where(reach > 0.0, shade(x, y), 255.0)  # type: ignore[operator]
    return np.asarray(values.reshape(height, fine, width, fine).mean(axis=(1, 3)).round(), dtype=np.uint8)


POSES = [([0.0, 0.0, 0.02], [-0.11, -0.08, 0.35]), ([0.3, -0.35, 0.3], [-0.1, -0.1, 0.36])]


@pytest.mark.parametrize(("r", "T"), POSES)
def test_drawn_corners_are_found_to_a_fraction_of_a_pixel(r: list[float], T: list[float]) -> None:
    """A chessboard drawn through a lens with distortion: where its corners are is known exactly."""
    pytest.importorskip("cv2")
    from sinan.calibration.cameras.views import chessboard

    camera, pose, board = TRUTH["k1 k2 p1 p2"], Pose(np.array(r), np.array(T)), Board(8, 6, 0.03)

    def shade(x: FloatArray, y: FloatArray) -> FloatArray:
        i, j = np.floor(x / 0.03), np.floor(y / 0.03)
        on = (i >= -1) & (i < 8) & (j >= -1) & (j < 6)
        return np.where(on & ((i + j) % 2 == 0), 20.0, 235.0)

    view = chessboard("drawn", drawn(camera, pose, shade), board)
    exact = camera.pixels(pose.points(view.points))
    if np.linalg.norm(view.pixels[0] - exact[0]) > 5.0:  # the board looks the same from its other end
        exact = exact[::-1]
    off = np.linalg.norm(view.pixels - exact, axis=1)
    assert len(view) == 48
    assert np.sqrt(np.mean(off**2)) < 0.12
    assert np.max(off) < 0.3


def test_a_board_with_markers_may_be_hidden_in_part() -> None:
    """ChArUco: of a board half covered the corners that are seen are found, each with its own place."""
    cv2 = pytest.importorskip("cv2")
    from sinan.calibration.cameras.views import charuco

    board = Board(8, 6, 0.03, marker=0.022)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    per_metre = 2000.0
    texture = cv2.aruco.CharucoBoard((8, 6), 0.03, 0.022, dictionary).generateImage((480, 360))
    camera, pose = TRUTH["k1 k2 p1 p2"], Pose(np.array([0.2, -0.25, 0.1]), np.array([-0.11, -0.09, 0.34]))

    def shade(x: FloatArray, y: FloatArray) -> FloatArray:
        i, j = np.floor(x * per_metre).astype(int), np.floor(y * per_metre).astype(int)
        on = (i >= 0) & (i < 480) & (j >= 0) & (j < 360) & (x < 0.15)
        return np.where(on, texture[np.clip(j, 0, 359), np.clip(i, 0, 479)], 235.0)

    view = charuco("drawn", drawn(camera, pose, shade), board)
    assert 12 <= len(view) < 35
    off = view.pixels - camera.pixels(pose.points(view.points))
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 0.15


def test_opencvs_own_pictures_give_the_corners_of_the_table() -> None:
    pytest.importorskip("cv2")
    found = views_of(PICTURES, Board(9, 6, 0.025))
    table = {view.name: view for view in left().views}
    assert [view.name for view in found.views] == ["left01.jpg", "left02.jpg", "left03.jpg"]
    assert found.size == SIZE
    for view in (found.views[0], found.views[2]):
        np.testing.assert_allclose(view.pixels, table[view.name].pixels, atol=0.02)


def test_a_picture_without_a_board_is_named(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    for path in PICTURES.glob("left01.jpg"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    cv2.imwrite(str(tmp_path / "wall.png"), np.full((480, 640), 128, dtype=np.uint8))
    (tmp_path / "torn.jpg").write_bytes(b"\xff\xd8\xff")
    found = views_of(tmp_path, Board(9, 6, 0.025))
    assert [view.name for view in found.views] == ["left01.jpg"]
    assert found.without == {"wall.png": "0 corners found, 6 needed", "torn.jpg": "cannot be read"}


def test_without_opencv_a_table_still_serves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "cv2", None)
    with pytest.raises(InputError, match=r"no OpenCV; expected a table of corners, or pip install -e '\.\[camera\]'"):
        views_of(PICTURES, Board(9, 6, 0.025))
    assert isinstance(fit(left().views[:3], Form("k1", "brown", ("k1",)), SIZE), CameraFit)
