"""The scan of a laser: every formula against rays that SciPy's rotations turn, and against the simulator's beams."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sinan.experiments.scenarios import load_scenario
from sinan.sensors.arrays import FloatArray
from sinan.sensors.laser import (
    Laser,
    course_scan_error,
    ground_points,
    scan_height,
    scan_range_of_the_course,
    slant_from_height,
)
from sinan.sensors.motion import Motion
from sinan.sensors.ranging import tilt_compensated_height
from sinan.sensors.rotation import quaternion_from_rpy
from sinan.sensors.simulate import simulate

MICROMETRE, CENTIMETRE = 1e-6, 1e-2
#: Not symmetric: a wrong sign of an angle cancels over a symmetric scan.
ANGLES = np.deg2rad([-25.0, -5.0, 10.0, 35.0])
GROUND_DOWN = 1.5
N = 50


@pytest.fixture(scope="module")
def rpy() -> FloatArray:
    """(n, 3) tilts of up to half a radian, any heading."""
    return np.random.default_rng(3).uniform([-0.5, -0.5, -np.pi], [0.5, 0.5, np.pi], (N, 3))


@pytest.fixture(scope="module")
def motion(rpy: FloatArray) -> Motion:
    p_n = np.random.default_rng(4).uniform([-20.0, -20.0, -12.0], [20.0, 20.0, -2.0], (N, 3))
    return Motion(np.arange(float(N)), p_n, q_nb=quaternion_from_rpy(rpy), ground_down=GROUND_DOWN)


def directions(rpy: FloatArray, angles: FloatArray) -> FloatArray:
    """(n, beams, 3) of the beams (0, sin a, cos a) in NED, turned by SciPy: first roll, then pitch, then yaw."""
    turn = Rotation.from_euler("ZYX", rpy[:, ::-1])
    beams = np.array([[0.0, np.sin(a), np.cos(a)] for a in angles])
    return np.stack([turn.apply(beam) for beam in beams], axis=1)


def rays(motion: Motion, rpy: FloatArray) -> FloatArray:
    """(n, beams) how far along each ray the ground is: p_down + r d_down = ground_down."""
    return np.asarray((GROUND_DOWN - motion.p_n[:, 2:3]) / directions(rpy, ANGLES)[..., 2])


def test_the_model_reads_the_length_of_the_rays(motion: Motion, rpy: FloatArray) -> None:
    np.testing.assert_allclose(Laser(0.03, angles=ANGLES).predict(motion), rays(motion, rpy), rtol=1e-12)


def test_a_beam_that_does_not_point_below_the_horizon_has_no_end() -> None:
    """Rolled by 60 deg to the right, beams at -25 and -35 deg look 5 deg down and up."""
    rpy = np.deg2rad([[60.0, 0.0, 0.0]])
    for height in (2.0, 0.0):
        at = Motion(np.zeros(1), np.array([[0.0, 0.0, -height]]), q_nb=quaternion_from_rpy(rpy))
        down, up = Laser(0.03, angles=np.deg2rad([-25.0, -35.0])).predict(at)[0]
        assert down == pytest.approx(height / np.sin(np.deg2rad(5.0)))
        assert up == np.inf


def test_a_beam_to_the_right_of_a_body_rolled_to_the_right_meets_the_ground_straight_below() -> None:
    """Rolled by phi the beam at the angle phi hangs straight down, so its range is the height, whatever the others."""
    for phi in (-0.4, 0.3):
        found = scan_height(np.array([[7.0]]), np.array([phi]), np.array([phi]), np.zeros(1))
        assert found[0] == pytest.approx(7.0, abs=MICROMETRE)


def test_the_height_of_a_scan_is_that_above_the_ground(motion: Motion, rpy: FloatArray) -> None:
    found = scan_height(rays(motion, rpy), ANGLES, rpy[:, 0], rpy[:, 1])
    np.testing.assert_allclose(found, GROUND_DOWN - motion.p_n[:, 2], atol=MICROMETRE)


def test_the_height_is_the_least_squares_one() -> None:
    """Of ranges that no height makes: sum (r_i - h / c_i)^2 over a grid of h, c_i = cos(pitch) cos(roll - a_i)."""
    ranges, roll, pitch = np.array([[9.0, 8.2, 8.4, 9.9]]), 0.2, -0.15
    c = np.cos(pitch) * np.cos(roll - ANGLES)
    h = np.arange(7.0, 9.0, 1e-4)
    cost = np.sum((ranges - h[:, None] / c) ** 2, axis=1)
    found = scan_height(ranges, ANGLES, np.array([roll]), np.array([pitch]))
    assert found[0] == pytest.approx(h[np.argmin(cost)], abs=1e-4)


def test_the_points_of_a_scan_lie_where_the_rays_end(motion: Motion, rpy: FloatArray) -> None:
    points = ground_points(motion, rays(motion, rpy), ANGLES)
    expected = motion.p_n[:, None, :] + rays(motion, rpy)[..., None] * directions(rpy, ANGLES)
    np.testing.assert_allclose(points, expected, atol=MICROMETRE)
    np.testing.assert_allclose(points[..., 2], GROUND_DOWN, atol=MICROMETRE)


def test_the_slant_range_and_the_height_are_each_other_s_inverse(motion: Motion, rpy: FloatArray) -> None:
    height = GROUND_DOWN - motion.p_n[:, 2]
    slant = height / (np.cos(rpy[:, 1]) * np.cos(rpy[:, 0]))  # R_33 of roll, then pitch: cos(pitch) cos(roll)
    np.testing.assert_allclose(slant_from_height(motion), slant, rtol=1e-12)
    np.testing.assert_allclose(tilt_compensated_height(slant, rpy[:, 0], rpy[:, 1]), height, rtol=1e-12)


def test_the_error_of_the_course_s_mean_is_that_of_the_rays(motion: Motion, rpy: FloatArray) -> None:
    height = GROUND_DOWN - motion.p_n[:, 2]
    slant = height / (np.cos(rpy[:, 1]) * np.cos(rpy[:, 0]))
    mean = np.mean(rays(motion, rpy) * np.cos(ANGLES), axis=1)
    np.testing.assert_allclose(scan_range_of_the_course(rays(motion, rpy), ANGLES), mean, rtol=1e-12)
    np.testing.assert_allclose(course_scan_error(ANGLES, rpy[:, 0]), mean / slant - 1.0, atol=1e-12)


def test_a_simulated_scan_gives_the_height_of_the_truth() -> None:
    """Noise of 3 cm a beam: 1 to 2 cm are left of it in the mean of the beams. The course's mean errs by far more."""
    scenario = load_scenario("aerobatics")
    laser = scenario.sensors["laser"]
    laser = replace(laser, spec=replace(laser.spec, angles=ANGLES))
    recording, _ = simulate(scenario.replace(sensors={**scenario.sensors, "laser": laser}), np.random.default_rng(2))
    scan = recording.streams["laser"]
    ranges = scan.array([f"range_{i}" for i in range(len(ANGLES))])
    at = scenario.trajectory().motion(scan.t)
    yaw_pitch_roll = Rotation.from_quat(at.q_nb, scalar_first=True).as_euler("ZYX")
    roll, pitch = yaw_pitch_roll[:, 2], yaw_pitch_roll[:, 1]
    error = scan_height(ranges, ANGLES, roll, pitch) + at.p_n[:, 2]
    assert np.sqrt(np.mean(error**2)) < 1.8 * CENTIMETRE
    slant = scan_range_of_the_course(ranges, ANGLES)
    course = tilt_compensated_height(slant, roll, pitch) + at.p_n[:, 2]
    assert np.sqrt(np.mean(course**2)) > 20.0 * CENTIMETRE
    predicted = tilt_compensated_height(slant / (1.0 + course_scan_error(ANGLES, roll)), roll, pitch) + at.p_n[:, 2]
    assert np.sqrt(np.mean(predicted**2)) < 1.8 * CENTIMETRE
