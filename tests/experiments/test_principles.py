"""The principles of the lecture: each against a derivation of another kind than the lab's own."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from sinan.calibration.poses.reference import (
    calibrate_by_attitude,
    calibrate_directions,
    small_rotation,
    three_angles,
)
from sinan.calibration.poses.triad import calibrate_norm
from sinan.experiments.labs import attitudes, coriolis, iterations, magneto_bridge, sonar_echo, spring_mass, tilt
from sinan.sensors.atmosphere import height_from_pressure
from sinan.sensors.rotation import quaternion_from_rpy, rotate_back


def test_a_mass_on_a_spring_reads_what_its_equation_of_motion_says() -> None:
    """Newton's law for the mass in the inertial frame, integrated step by step; the spring presses, gravity pulls."""
    t = np.arange(0.0, 0.03, spring_mass.STEP)
    case = -9.81  # dropped at 0 from rest
    read = spring_mass.spring_reading(np.concatenate([[9.81], np.zeros(len(t) - 1)]), spring_mass.STEP, 200.0, 0.1)
    w = 2.0 * np.pi * 200.0

    def newton(_: float, y: np.ndarray) -> list[float]:
        spring = -(w**2) * y[0] - 2.0 * 0.1 * w * y[1]  # per mass, on the mass
        return [y[1], spring - 9.81 - case]

    begin = [-9.81 / w**2, 0.0]
    exact = solve_ivp(newton, (0.0, t[-1]), begin, t_eval=t, rtol=1e-10, atol=1e-15).y[0]
    one = round(1e-4 / spring_mass.STEP)  # the force of the first step is held over it: the fall begins one step later
    assert np.max(np.abs(read[one:] + w**2 * exact[: len(t) - one])) < 1e-3
    assert abs(np.mean(spring_mass.spring_reading(np.zeros(100), 1e-4, 200.0, 0.1))) < 1e-15
    assert spring_mass.shaken(200.0) == pytest.approx(1.0 / (2.0 * spring_mass.DAMPING), rel=0.01)


def test_a_pair_reads_a_rate_and_no_acceleration() -> None:
    t = np.arange(0.0, 0.06, 1.0 / coriolis.SAMPLING)
    middle = (t > 0.03) & (t < 0.05)
    still, shaking = np.zeros(len(t)), np.cos(2.0 * np.pi * coriolis.DRIVE * t)
    turning = coriolis.pair(t, np.full(len(t), 0.5), still)
    # the Coriolis force as the second derivative of the path in the inertial frame says it: 2 w v, mass by mass
    assert np.mean(coriolis.demodulated(t, turning.one - turning.two)[middle]) == pytest.approx(0.5, rel=2e-3)
    shaken = coriolis.pair(t, still, shaking)
    assert np.max(np.abs(shaken.one - shaken.two)) < 1e-20
    assert np.min(np.abs(np.mean(coriolis.demodulated(t, shaken.one)[middle]))) > 0.1


def test_a_turning_frame_bends_a_straight_path_as_its_two_forces_say() -> None:
    t = np.linspace(0.0, 2.0, 21)
    straight = 1.5 * t[:, None] * np.stack([np.cos(0.7 * t), -np.sin(0.7 * t)], axis=1)
    assert np.max(np.abs(coriolis.rolled(t, 0.7, 1.5) - straight)) < 1e-12
    sideways = coriolis.rolled(np.array([0.01]), 0.7, 1.5, centrifugal=False)[0, 1]
    assert sideways == pytest.approx(-0.7 * 1.5 * 0.01**2, rel=1e-3)  # half of 2 w v t^2


def test_a_bridge_answers_to_the_field_and_its_flip_takes_the_offset_out() -> None:
    """Small fields: ratio h / (1 + ratio / 2), from R = R0 (1 + ratio cos^2) about 45 deg by hand."""
    field = np.array([0.2])
    expected = magneto_bridge.RATIO * 0.2 / magneto_bridge.ANISOTROPY / (1.0 + 0.5 * magneto_bridge.RATIO)
    equal = np.zeros(4)
    assert magneto_bridge.bridge(field, arms=equal)[0] == pytest.approx(expected, rel=1e-3)
    assert magneto_bridge.bridge(field, 40.0, arms=equal)[0] == pytest.approx(expected, rel=1e-3)
    half = 0.5 * (magneto_bridge.bridge(field) - magneto_bridge.bridge(field, flipped=True))
    assert half[0] == pytest.approx(expected, rel=2e-3)
    path = magneto_bridge.orbit(500.0, 5e-5, 1e8, np.linspace(0.0, 1e-3, 50))
    centre = np.array([0.0, -500.0 / (1e8 * 5e-5)])  # the radius is m v / (q B); a positive charge turns right
    assert np.linalg.norm(path - centre, axis=1) == pytest.approx(500.0 / 5e3, rel=1e-12)


def test_the_sonar_fails_as_figure_7_13_says() -> None:
    heard = {
        name: bool(sonar_echo.SONAR.echo(sonar_echo.over_ground(np.array([h]), np.deg2rad([a])), s)[0])
        for name, (h, a, s) in sonar_echo.CASES.items()
    }
    assert [name for name, is_heard in heard.items() if is_heard] == ["hard and level"]
    assert sonar_echo.highest(np.array([0.3]), 0.75)[0] == pytest.approx(8.0 * 0.5 * np.cos(0.3), rel=1e-6)


def test_height_from_pressure_is_the_weight_of_the_air() -> None:
    """dp/dh = -p g / (R T) with T = 288.15 - 0.0065 h, integrated."""
    air = solve_ivp(
        lambda h, p: -p * 9.80665 / (287.05287 * (288.15 - 0.0065 * h)), (0.0, 1000.0), [101325.0], rtol=1e-11
    )
    assert height_from_pressure(air.y[0, -1]) == pytest.approx(1000.0, abs=1e-3)


def test_tilt_of_gravity_and_of_rates() -> None:
    rpy = np.array([[0.3, -0.5, 1.0]])
    f = rotate_back(quaternion_from_rpy(rpy), np.array([[0.0, 0.0, -9.81]]))
    roll, pitch = tilt.tilt_of_gravity(f)
    assert (roll[0], pitch[0]) == pytest.approx((0.3, -0.5))
    t = np.linspace(0.0, 1.0, 101)
    assert tilt.tilt_of_rates(t, np.tile([0.2, 0.0, 0.0], (101, 1)), 0.3, 0.0)[0][-1] == pytest.approx(0.5)


def test_levenberg_and_marquardt_go_where_scipy_goes() -> None:
    rng = np.random.default_rng(4)
    v = rng.standard_normal((20, 3))
    r = 9.8 * v / np.linalg.norm(v, axis=1, keepdims=True) / [1.02, 0.99, 1.01] - [0.1, -0.2, 0.3]

    def residual(x: np.ndarray) -> np.ndarray:
        return np.linalg.norm((r + x[3:]) * x[:3], axis=1) - 9.8

    def slopes(x: np.ndarray) -> np.ndarray:
        return np.stack([(residual(x + 1e-6 * e) - residual(x - 1e-6 * e)) / 2e-6 for e in np.eye(6)], 1)

    start = np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])
    x, index = iterations.marquardt(residual, slopes, start)
    assert x == pytest.approx(least_squares(residual, start).x, abs=1e-6)
    assert np.all(np.diff(index) <= 0.0)


@pytest.mark.parametrize("a", [0.1, 1.0 / 9.8, 7.0])
def test_another_gravity_scales_k_and_leaves_b(a: float) -> None:
    """K' = a K, b' = b: the whole index is a^2 times what it was, so is its minimum, with residuals in the data."""
    rng = np.random.default_rng(5)
    v = rng.standard_normal((12, 3))
    r = 9.8 * v / np.linalg.norm(v, axis=1, keepdims=True) + [0.1, -0.2, 0.3] + 0.05 * rng.standard_normal((12, 3))
    one, other = calibrate_norm("accel", r, 9.8), calibrate_norm("accel", r, a * 9.8)
    assert pytest.approx(a * one.K, rel=1e-7) == other.K
    assert other.offset == pytest.approx(one.offset, abs=1e-7)
    assert other.fit.sse == pytest.approx(a**2 * one.fit.sse, rel=1e-7)


def test_what_the_ten_attitudes_and_the_six_faces_leave_open() -> None:
    """By hand: T_xy enters |T v| as v_x v_y, and no one of the ten leans to the side and forward at once."""
    f = attitudes.poses()
    assert np.max(np.abs(f[:, 0] * f[:, 1])) < 1e-3 * 9.8**2
    std, _ = attitudes.determined(f, 2e-3)
    assert std[6] > attitudes.OPEN > np.max(np.delete(std, 6))
    six, _ = attitudes.determined(f[:6], 2e-3)
    assert np.all(six[6:] > attitudes.OPEN)
    assert np.all(six[:6] < 1e-3)
    leaning = rotate_back(quaternion_from_rpy(np.array([[0.8, 0.6, 0.0]])), np.array([[0.0, 0.0, -9.8]]))
    assert np.all(attitudes.determined(np.vstack([f, leaning]), 2e-3)[0] < 0.01)


def test_known_directions_give_back_the_three_angles() -> None:
    angles, K, b = np.array([0.03, -0.02, 0.01]), np.array([1.02, 0.97, 1.01]), np.array([0.1, 0.2, -0.1])
    truth = attitudes.poses()
    raw = truth @ np.linalg.inv(small_rotation(angles)).T / K - b
    found = calibrate_directions(raw, truth, antisymmetric=True)
    assert found.fit.x == pytest.approx(np.concatenate([K, b, angles]), abs=1e-7)
    assert found.apply(raw) == pytest.approx(truth, abs=1e-6)
    assert three_angles(found.T)[0] == pytest.approx(angles, abs=1e-7)


def test_an_attitude_gives_back_t_current_and_the_direction_of_the_field() -> None:
    rng = np.random.default_rng(6)
    q = quaternion_from_rpy(rng.uniform(-1.0, 1.0, (400, 3)) * [0.5, 0.5, 3.0])
    field, current = np.array([0.5, 0.1, 0.7]) / np.linalg.norm([0.5, 0.1, 0.7]), rng.uniform(0.0, 20.0, 400)
    T = small_rotation(np.array([0.05, -0.03, 0.08]))
    d, b, K = np.array([1e-3, -2e-3, 3e-3]), np.array([0.1, -0.05, 0.02]), np.array([1.1, 0.9, 1.0])
    raw = rotate_back(q, field[None]) @ np.linalg.inv(T).T / K - b - current[:, None] * d
    found = calibrate_by_attitude(raw, q, 1.0, current)
    assert pytest.approx(T, abs=1e-5) == found.T
    assert np.concatenate([found.K, found.offset, found.current]) == pytest.approx(np.concatenate([K, b, d]), abs=1e-5)
    assert found.direction == pytest.approx(field, abs=1e-5)
    assert found.apply(raw, current) == pytest.approx(rotate_back(q, field[None]), abs=1e-5)
