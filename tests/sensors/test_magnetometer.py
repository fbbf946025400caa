"""The magnetometer: the field that SciPy's rotations turn, and the heading that it shows."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sinan.estimator.filter.alignment import attitude_from_vectors
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.arrays import FloatArray
from sinan.sensors.magnetometer import Magnetometer, tilt_compensated_heading
from sinan.sensors.motion import Motion
from sinan.sensors.recording import MAG
from sinan.sensors.rotation import quaternion_from_rpy, rpy_from_quaternion
from sinan.sensors.simulate import simulate

MICRORADIAN = 1e-6
FIELD = np.array([0.5, -0.06, 0.86])
DECLINATION = np.arctan2(FIELD[1], FIELD[0])


@pytest.fixture(scope="module")
def rpy() -> FloatArray:
    """(n, 3) tilts of up to one radian, any heading."""
    return np.random.default_rng(5).uniform([-1.0, -1.0, -np.pi], [1.0, 1.0, np.pi], (60, 3))


@pytest.fixture(scope="module")
def m_b(rpy: FloatArray) -> FloatArray:
    return np.asarray(Rotation.from_euler("ZYX", rpy[:, ::-1]).inv().apply(FIELD))


def wrapped(angle: FloatArray) -> FloatArray:
    return np.asarray(np.angle(np.exp(1j * angle)))


def test_the_model_reads_the_field_turned_into_the_body(rpy: FloatArray, m_b: FloatArray) -> None:
    at = Motion(np.arange(float(len(rpy))), q_nb=quaternion_from_rpy(rpy), m_n=FIELD[None])
    np.testing.assert_allclose(Magnetometer(0.01).predict(at), m_b, atol=1e-12)


def test_without_an_attitude_it_reads_the_field_in_the_body(m_b: FloatArray) -> None:
    np.testing.assert_array_equal(Magnetometer(0.01).predict(Motion(np.arange(60.0), m_b=m_b)), m_b)
    half = Motion(np.arange(60.0), q_nb=np.tile([1.0, 0.0, 0.0, 0.0], (60, 1)), m_b=m_b)
    np.testing.assert_array_equal(Magnetometer(0.01).predict(half), m_b)
    other = Motion(np.arange(60.0), m_n=FIELD[None], m_b=m_b)
    np.testing.assert_array_equal(Magnetometer(0.01).predict(other), m_b)


@pytest.mark.parametrize(
    ("m", "degrees"),
    [([1.0, 0.0, 2.0], 0.0), ([0.0, -1.0, 2.0], 90.0), ([-1.0, 0.0, 2.0], 180.0), ([0.0, 1.0, 2.0], -90.0)],
    ids=["north ahead", "north to the left", "north behind", "north to the right"],
)
def test_the_heading_of_a_level_body(m: list[float], degrees: float) -> None:
    """Facing east, north is to the left: the field reads -y."""
    found = tilt_compensated_heading(np.array([m]), np.zeros(1), np.zeros(1))
    assert abs(wrapped(found - np.deg2rad(degrees))[0]) < MICRORADIAN


def test_the_heading_of_a_tilted_body_is_its_yaw(rpy: FloatArray, m_b: FloatArray) -> None:
    found = tilt_compensated_heading(m_b, rpy[:, 0], rpy[:, 1])
    assert np.max(np.abs(wrapped(found + DECLINATION - rpy[:, 2]))) < MICRORADIAN


def test_the_heading_is_that_of_the_formula_of_the_literature(rpy: FloatArray, m_b: FloatArray) -> None:
    """Caruso (2000), eqs. 3 and 4, in our axes: x, y levelled by roll, then pitch."""
    roll, pitch = rpy[:, 0], rpy[:, 1]
    x = m_b[:, 0] * np.cos(pitch) + (m_b[:, 1] * np.sin(roll) + m_b[:, 2] * np.cos(roll)) * np.sin(pitch)
    y = m_b[:, 1] * np.cos(roll) - m_b[:, 2] * np.sin(roll)
    found = tilt_compensated_heading(m_b, roll, pitch)
    assert np.max(np.abs(wrapped(found - np.arctan2(-y, x)))) < MICRORADIAN


def test_the_first_attitude_of_the_filter_has_that_heading(rpy: FloatArray, m_b: FloatArray) -> None:
    """TRIAD from gravity and field, another construction of the same thing."""
    gravity = np.array([0.0, 0.0, 9.8])
    f_b = Rotation.from_euler("ZYX", rpy[:, ::-1]).inv().apply(-gravity)
    triad = np.array([attitude_from_vectors(f, m, -gravity, FIELD) for f, m in zip(f_b, m_b, strict=True)])
    found = tilt_compensated_heading(m_b, rpy[:, 0], rpy[:, 1])
    assert np.max(np.abs(wrapped(found + DECLINATION - rpy_from_quaternion(triad)[:, 2]))) < MICRORADIAN


def test_a_simulated_magnetometer_shows_the_heading_of_the_truth() -> None:
    """Without its bias: what is left is the noise across the horizontal field, at tilts of a few degrees."""
    scenario = load_scenario("yaw_turns")
    recording, truth = simulate(scenario, np.random.default_rng(3))
    mag = recording.streams["mag"]
    bias = np.stack([np.interp(mag.t, truth.t, truth[f"bias_mag_{axis}"]) for axis in "xyz"], axis=1)
    at = scenario.trajectory().motion(mag.t)
    rpy = rpy_from_quaternion(at.q_nb)
    found = tilt_compensated_heading(mag.array(MAG) - bias, rpy[:, 0], rpy[:, 1])
    declination = np.arctan2(scenario.magnetic_field[1], scenario.magnetic_field[0])
    error = wrapped(found + declination - rpy[:, 2])
    horizontal = np.hypot(*scenario.magnetic_field[:2])
    sigma = scenario.sensors["mag"].spec.noise_std / horizontal  # type: ignore[operator]
    assert 0.9 * sigma < np.sqrt(np.mean(error**2)) < 1.1 * sigma
