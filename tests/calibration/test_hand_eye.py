"""A camera's mounting: against a simulated truth, and OpenCV's hand-eye calibration."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from sinan.calibration.cameras import hand_eye
from sinan.calibration.cameras.camera import Pose
from sinan.calibration.cameras.hand_eye import Mounting, from_poses, from_rates, rotation_between
from sinan.sensors.arrays import FloatArray
from sinan.sensors.camera import LOOKS_AHEAD
from sinan.sensors.errors import InputError
from sinan.sensors.rotation import (
    matrix_from_quaternion,
    quaternion_exp,
    quaternion_from_matrix,
    quaternion_log,
    right_jacobian,
    rotation_exp,
)

FALSE_ALARM = 1e-3
C_BC = LOOKS_AHEAD @ rotation_exp(np.array([0.05, -0.12, 0.08]))
L_B = np.array([0.11, -0.04, 0.06])
C_NT, P_T = rotation_exp(np.array([1.2, 0.4, -0.3])), np.array([2.0, 0.3, -1.1])
SIGMA_R, SIGMA_T = 0.004, 0.006
DELAY, BIAS = 0.037, np.array([0.012, -0.007, 0.004])
SIGMA_PICTURE, DENSITY = 0.002, 0.002


def poses(n: int, seed: int, spread: float = 0.5, noise: float = 1.0) -> tuple[FloatArray, FloatArray, list[Pose]]:
    """Body and camera in front of a target, by the definition of the mounting, with noise in the camera's pose."""
    rng = np.random.default_rng(seed)
    q_nb = quaternion_exp(rng.normal(0.0, spread, (n, 3)))
    p_n = rng.normal(0.0, 0.3, (n, 3))
    seen = []
    for q, p in zip(q_nb, p_n, strict=True):
        C_cn = (matrix_from_quaternion(q) @ C_BC).T
        R = C_cn @ C_NT @ rotation_exp(noise * SIGMA_R * rng.standard_normal(3))
        T = C_cn @ (P_T - p) - C_BC.T @ L_B + noise * SIGMA_T * rng.standard_normal(3)
        seen.append(Pose(Rotation.from_matrix(R).as_rotvec(), T))
    return q_nb, p_n, seen


def off(found: Mounting) -> FloatArray:
    """(6,) rotation of C_bc about the camera's axes [rad] and lever arm [m] against the truth: estimate minus truth."""
    return np.append(quaternion_log(quaternion_from_matrix(C_BC.T @ found.C_bc)), found.l_b - L_B)


def test_a_wahba_problem_is_solved() -> None:
    C, b = rotation_exp(np.array([0.4, 2.0, -1.0])), np.random.default_rng(0).normal(size=(9, 3))
    np.testing.assert_allclose(rotation_between(b @ C.T, b), C, atol=1e-12)
    flat = b * np.array([1.0, 1.0, 0.0])  # of vectors in a plane a reflection would do as well
    np.testing.assert_allclose(rotation_between(flat @ C.T, flat), C, atol=1e-12)


def test_the_mounting_is_found_from_exact_poses() -> None:
    q_nb, p_n, seen = poses(5, 0, noise=0.0)
    np.testing.assert_allclose(off(from_poses(q_nb, seen, p_n)), 0.0, atol=1e-10)
    alone = from_poses(q_nb, seen)
    np.testing.assert_allclose(alone.C_bc, C_BC, atol=1e-10)
    assert np.all(np.isnan(alone.l_b))


def test_errors_from_poses_are_as_large_as_the_covariance_says() -> None:
    white, sigmas = [], []
    rows = [0, 1, 2, 6, 7, 8]
    for seed in range(40):
        q_nb, p_n, seen = poses(25, seed)
        found = from_poses(q_nb, seen, p_n)
        assert found.names[6:9] == ("lever arm x", "lever arm y", "lever arm z")
        white.append(np.linalg.solve(np.linalg.cholesky(found.covariance[np.ix_(rows, rows)]), off(found)))
        sigmas.append([found.sigma["rotation"], found.sigma["place"]])
    low, high = chi2.ppf([FALSE_ALARM / 2, 1.0 - FALSE_ALARM / 2], 6 * 40)
    assert low < np.sum(np.square(white)) < high
    np.testing.assert_allclose(np.mean(sigmas, axis=0), [SIGMA_R, SIGMA_T], rtol=0.05)


#: cv2.calibrateHandEye (Tsai) of OpenCV 4.14 (5.0 has none) for poses(30, 3): R row by row, T
OPENCV = (
    0.12233914805353807, 0.042124445013048795, 0.9915940015882897,
    0.9893898379409253, -0.08406198463340409, -0.11849612364429113,
    0.07836377627937707, 0.9955697433489208, -0.05196156940855201,
    0.10724573633982253, -0.043725079474769654, 0.0576472029295714,
)  # fmt: skip


def test_opencv_finds_the_same_mounting() -> None:
    """Tsai and Lenz's method is no least squares over the poses: it and ours lie within the errors of the truth."""
    q_nb, p_n, seen = poses(30, 3)
    found = from_poses(q_nb, seen, p_n)
    R, T = np.array(OPENCV[:9]).reshape(3, 3), np.array(OPENCV[9:])
    theirs = np.append(quaternion_log(quaternion_from_matrix(C_BC.T @ R)), T - L_B)
    std = found.std[[0, 1, 2, 6, 7, 8]]
    assert np.all(np.abs(theirs) < 6.0 * std)
    assert np.all(np.abs(off(found)) < 4.0 * std)


def test_turns_about_one_axis_leave_the_lever_arm_along_it_open() -> None:
    """A vehicle on a floor: what is above or below the camera looks alike."""
    q_nb = quaternion_exp(np.outer(np.linspace(-1.0, 1.0, 8), [0.0, 0.0, 1.0]))
    _, p_n, _ = poses(8, 1)
    seen = []
    for q, p in zip(q_nb, p_n, strict=True):
        C_cn = (matrix_from_quaternion(q) @ C_BC).T
        seen.append(Pose(Rotation.from_matrix(C_cn @ C_NT).as_rotvec(), C_cn @ (P_T - p) - C_BC.T @ L_B))
    found = from_poses(q_nb, seen, p_n)
    assert any("lever arm z" in sentence and "target down" in sentence for sentence in found.undetermined)
    assert np.isinf(found.std[8])


def turning(seed: int, noise: float = 1.0, end: float = 20.0) -> tuple[FloatArray, FloatArray, FloatArray, list[Pose]]:
    """A hand that turns gyroscope and camera about all axes: q = Exp(phi(t)), w = J_r(phi) phi'; late stamps."""
    rng = np.random.default_rng(seed)
    rates, phases, sizes = np.array([2.1, 1.3, 2.9]), np.array([0.0, 0.4, 1.0]), np.array([0.6, 0.7, 0.4])

    def phi(t: FloatArray) -> FloatArray:
        return sizes * np.sin(np.multiply.outer(t, rates) + phases)

    t, t_seen = np.arange(0.0, end, 0.005), np.arange(0.1, end - 0.1, 0.05)
    slope = sizes * rates * np.cos(np.multiply.outer(t, rates) + phases)
    w = np.einsum("nij,nj->ni", right_jacobian(phi(t)), slope)
    C_nc = rotation_exp(phi(t_seen)) @ C_BC
    noisy = rotation_exp(noise * SIGMA_PICTURE * rng.standard_normal((len(t_seen), 3)))
    seen = [Pose(r, np.zeros(3)) for r in Rotation.from_matrix(noisy @ np.swapaxes(C_nc, 1, 2) @ C_NT).as_rotvec()]
    rate_noise = noise * DENSITY / np.sqrt(0.005) * rng.standard_normal(w.shape)
    return t, w + BIAS + rate_noise, t_seen + DELAY, seen


def test_rotation_and_lateness_are_found_from_rates() -> None:
    found = from_rates(*turning(0, noise=0.0))
    np.testing.assert_allclose(quaternion_log(quaternion_from_matrix(C_BC.T @ found.C_bc)), 0.0, atol=1e-4)
    assert found.delay == pytest.approx(DELAY, abs=1e-4)
    np.testing.assert_allclose(found.values, [DELAY, *BIAS], atol=2e-4)
    assert found.undetermined == ()


def test_errors_from_rates_are_as_large_as_the_covariance_says() -> None:
    white, sigmas = [], []
    for seed in range(30):
        found = from_rates(*turning(seed))
        error = np.concatenate(
            [quaternion_log(quaternion_from_matrix(C_BC.T @ found.C_bc)), found.values - np.array([DELAY, *BIAS])]
        )
        white.append(np.linalg.solve(np.linalg.cholesky(found.covariance), error))
        sigmas.append([found.sigma["rotation"], found.sigma["rate"]])
    low, high = chi2.ppf([FALSE_ALARM / 2, 1.0 - FALSE_ALARM / 2], np.size(white))
    assert low < np.sum(np.square(white)) < high
    np.testing.assert_allclose(np.mean(sigmas, axis=0), [SIGMA_PICTURE, DENSITY], rtol=0.05)


def test_slopes_of_the_turns_are_those_of_differences() -> None:
    t, w, t_seen, _ = turning(0, end=3.0)
    _, by_delay, by_bias = hand_eye.turns_between(hand_eye._Turning.of(t, w, np.zeros(3)), t_seen, 0.031)

    def turns(delay: float, bias: FloatArray) -> FloatArray:
        return hand_eye.turns_between(hand_eye._Turning.of(t, w, bias), t_seen, delay)[0]

    h = 1e-7  # s; no picture's instant crosses a sample of the gyroscope
    change = (turns(0.031 + h, np.zeros(3)) - turns(0.031 - h, np.zeros(3))) / (2.0 * h)
    np.testing.assert_allclose(by_delay, change, atol=1e-6)
    for axis in range(3):
        step = 1e-5 * np.eye(3)[axis]
        change = (turns(0.031, step) - turns(0.031, -step)) / 2e-5
        np.testing.assert_allclose(by_bias[:, :, axis], change, atol=1e-5)


def test_a_body_that_turns_about_one_axis_does_not_show_the_turn_about_it() -> None:
    t = np.arange(0.0, 12.0, 0.005)
    angle = np.sin(2.0 * t)
    w = np.outer(2.0 * np.cos(2.0 * t), [0.0, 0.0, 1.0])
    t_seen = np.arange(0.5, 11.5, 0.05)
    seen = [
        Pose(Rotation.from_matrix((rotation_exp(np.array([0.0, 0.0, a])) @ LOOKS_AHEAD).T).as_rotvec(), np.zeros(3))
        for a in np.interp(t_seen, t, angle)
    ]
    found = from_rates(t, w, t_seen, seen)
    assert any("rotation y" in sentence for sentence in found.undetermined)  # body down is the camera's y
    assert found.delay == pytest.approx(0.0, abs=1e-4)


def test_too_few_poses_raise() -> None:
    q_nb, p_n, seen = poses(4, 0)
    with pytest.raises(InputError, match=r"2 poses of the body, 2 of the camera; expected three"):
        from_poses(q_nb[:2], seen[:2], p_n[:2])
    with pytest.raises(InputError, match="hand-eye"):
        from_poses(q_nb, seen, p_n[:3])


@pytest.mark.parametrize(("stamps", "says"), [([1.0, 3.0, 2.0, 4.0], "in order"), ([1.0, 2.0, 3.0, 4.0], "4 pictures")])
def test_stamps_out_of_order_and_too_few_pictures_raise(stamps: list[float], says: str) -> None:
    t = np.arange(0.0, 10.0, 0.01)
    with pytest.raises(InputError, match=says):
        from_rates(t, np.zeros((1000, 3)), np.array(stamps), poses(4, 0)[2])
