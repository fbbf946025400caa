"""Cameras from a wand: against a simulated room whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from sinan.calibration.cameras.camera import form
from sinan.calibration.cameras.wand import WandFit, calibrate_wand, distances, essential, relative_pose
from sinan.sensors.arrays import FloatArray
from sinan.sensors.camera import Intrinsics
from sinan.sensors.errors import InputError
from sinan.sensors.rotation import quaternion_from_matrix, quaternion_log, rotation_exp

FALSE_ALARM = 1e-3
ALONG = np.array([0.0, 0.2, 0.5])
SIZE = np.array([640.0, 480.0])
SIGMA = 0.3
CAMERAS = [
    Intrinsics(np.array([500.0, 505.0]), np.array([320.0, 240.0]), "brown", np.array([-0.2, 0.05])),
    Intrinsics(np.array([480.0, 482.0]), np.array([310.0, 236.0]), "brown", np.array([-0.1, 0.0, 1e-3])),
    Intrinsics(np.array([300.0, 300.0]), np.array([326.0, 244.0]), "fisheye", np.array([0.02])),
]
#: Each looks at the middle of the room, 3 m ahead of the first
PLACES = np.array([[0.0, 0.0, 0.0], [2.5, 0.2, 1.0], [-2.0, -0.5, 1.4]])
TURNS = np.array([[0.0, 0.0, 0.0], [0.0, -0.9, 0.05], [0.1, 0.9, 0.0]])
R = np.array([rotation_exp(turn).T for turn in TURNS])
T = -np.einsum("jik,jk->ji", R, PLACES)


def waved(seed: int, sigma: float = SIGMA, instants: int = 40, cameras: list[Intrinsics] = CAMERAS) -> FloatArray:
    """Pixels of the markers; one in ten is hidden, and what falls out of a picture."""
    rng = np.random.default_rng(seed)
    A = rng.normal([0.0, 0.0, 3.0], 0.35, (instants, 3))
    u = rng.normal(0.0, 1.0, (instants, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    P = A[:, None] + ALONG[:, None] * u[:, None]
    seen = np.stack([c.pixels(P @ R[j].T + T[j]) for j, c in enumerate(cameras)], axis=1)
    inside = np.all((seen > 0.0) & (seen < SIZE), axis=-1) & (rng.uniform(size=seen.shape[:3]) > 0.1)
    seen = seen + sigma * rng.standard_normal(seen.shape)
    return np.where(inside[..., None], seen, np.nan)


def off(found: WandFit) -> FloatArray:
    """(12,) turn about the camera's axes and place of the two others: estimate minus truth."""
    rows = []
    for j in (1, 2):
        rows += [quaternion_log(quaternion_from_matrix(found.R[j] @ R[j].T)), found.T[j] - T[j]]
    return np.concatenate(rows)


def test_without_noise_the_cameras_stand_where_they_stand() -> None:
    """To the scale, which is the wand's length."""
    found = calibrate_wand(CAMERAS, waved(0, 0.0), ALONG)
    np.testing.assert_allclose(off(found), 0.0, atol=1e-7)
    assert found.sigma < 1e-6
    assert found.undetermined == ()


def test_errors_are_as_large_as_the_covariance_says() -> None:
    white, sigma = [], []
    for seed in range(15):
        found = calibrate_wand(CAMERAS, waved(seed), ALONG)
        white.append(np.linalg.solve(np.linalg.cholesky(found.covariance), off(found)))
        sigma.append(found.sigma)
    low, high = chi2.ppf([FALSE_ALARM / 2, 1.0 - FALSE_ALARM / 2], np.size(white))
    assert low < np.sum(np.square(white)) < high
    assert np.mean(sigma) == pytest.approx(SIGMA, rel=0.03)


def test_a_wand_tells_the_focal_lengths_too() -> None:
    """Begun with intrinsics that are 3 % and 10 pixels off; two pinholes of the same kind."""
    pinholes = [Intrinsics(c.f, c.centre) for c in CAMERAS]
    wrong = [Intrinsics(1.03 * c.f, c.centre + 10.0) for c in pinholes]
    found = calibrate_wand(wrong, waved(3, 0.2, 80, pinholes), ALONG, form("pinhole"))
    truth = np.concatenate([c.values[:4] for c in pinholes])
    got = np.concatenate([c.values[:4] for c in found.cameras])
    assert found.names[12:16] == ("camera 0 f_x", "camera 0 f_y", "camera 0 u0", "camera 0 v0")
    error = np.append(off(found), got - truth)
    assert error @ np.linalg.solve(found.covariance, error) < chi2.isf(FALSE_ALARM, len(error))
    assert np.all(np.abs(got - truth) < 8.0)


def test_two_directions_meet_where_they_are_nearest() -> None:
    """s_a a + T = s_b b: a along x from (0, 1, 0), b from the origin to (3, 1, 0)."""
    s = distances(np.array([[1.0, 0.0, 0.0]]), np.array([[3.0, 1.0, 0.0]]) / np.sqrt(10.0), np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(s, [[3.0, np.sqrt(10.0)]])


def test_an_essential_matrix_is_t_cross_r() -> None:
    rng = np.random.default_rng(2)
    P = rng.normal([0.0, 0.0, 5.0], 1.0, (20, 3))
    Q = P @ R[1].T + T[1]
    a, b = P / np.linalg.norm(P, axis=1)[:, None], Q / np.linalg.norm(Q, axis=1)[:, None]
    E = essential(a, b)
    expected = np.array([[0.0, -T[1][2], T[1][1]], [T[1][2], 0.0, -T[1][0]], [-T[1][1], T[1][0], 0.0]]) @ R[1]
    cosine = np.sum(E * expected) / np.linalg.norm(E) / np.linalg.norm(expected)
    assert abs(cosine) == pytest.approx(1.0)
    turn, place, s = relative_pose(a, b)
    np.testing.assert_allclose(turn, R[1], atol=1e-9)
    np.testing.assert_allclose(place, T[1] / np.linalg.norm(T[1]), atol=1e-9)
    np.testing.assert_allclose(s[:, 0] * np.linalg.norm(T[1]), np.linalg.norm(P, axis=1))


@pytest.mark.parametrize(
    ("along", "hidden", "says"),
    [
        ([0.0, 0.5, 0.2], False, "from 0 upwards"),
        ([0.0, 0.5], False, r"\(instants, 3, 2, 2\)"),
        ([0.0, 0.2, 0.5], True, "0 markers that camera 2 sees together"),
    ],
)
def test_what_no_wand_shows_raises(along: list[float], hidden: bool, says: str) -> None:
    seen = waved(0)
    if hidden:
        seen[:, 2] = np.nan
    with pytest.raises(InputError, match=says):
        calibrate_wand(CAMERAS, seen, np.array(along))
