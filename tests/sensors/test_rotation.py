"""Rotations written out component by component, against NumPy's cross product and SciPy's rotations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sinan.sensors.arrays import FloatArray
from sinan.sensors.rotation import (
    cross,
    matrix_from_quaternion,
    quaternion_exp,
    quaternion_from_rpy,
    quaternion_log,
    quaternion_multiply,
    rotate,
    rotate_back,
    rpy_from_quaternion,
    skew,
)

RNG = np.random.default_rng(3)
ROUNDING = 1e-14


def random(*shape: int) -> FloatArray:
    return RNG.standard_normal(shape)


def attitudes(*shape: int) -> FloatArray:
    q = random(*shape, 4)
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


@pytest.mark.parametrize(("first", "second"), [((3,), (3,)), ((7, 3), (3,)), ((1, 3), (7, 3)), ((2, 5, 3), (5, 3))])
def test_cross_is_numpys(first: tuple[int, ...], second: tuple[int, ...]) -> None:
    u, v = random(*first), random(*second)
    np.testing.assert_array_equal(cross(u, v), np.cross(u, v))
    np.testing.assert_allclose(np.einsum("...ij,...j->...i", skew(u), v), np.cross(u, v), atol=ROUNDING)


def test_a_quaternion_turns_as_scipys() -> None:
    q, p, v = attitudes(20), attitudes(20), random(20, 3)
    one, other = (Rotation.from_quat(a, scalar_first=True) for a in (q, p))
    np.testing.assert_allclose(rotate(q, v), one.apply(v), atol=ROUNDING)
    np.testing.assert_allclose(rotate_back(q, v), one.inv().apply(v), atol=ROUNDING)
    np.testing.assert_allclose(rotate(q, v[:1]), one.apply(v[0]), atol=ROUNDING)
    np.testing.assert_allclose(matrix_from_quaternion(q), one.as_matrix(), atol=ROUNDING)
    product = (one * other).as_quat(canonical=True, scalar_first=True)
    ours = quaternion_multiply(q, p)
    np.testing.assert_allclose(ours * np.sign(ours[:, :1]), product, atol=ROUNDING)


def test_exponential_and_logarithm_are_scipys() -> None:
    phi = np.concatenate([random(20, 3), 1e-9 * random(5, 3), np.zeros((1, 3))])
    q = quaternion_exp(phi)
    np.testing.assert_allclose(matrix_from_quaternion(q), Rotation.from_rotvec(phi).as_matrix(), atol=ROUNDING)
    expected = Rotation.from_quat(q, scalar_first=True).as_rotvec()
    np.testing.assert_allclose(quaternion_log(q), expected, atol=ROUNDING)
    np.testing.assert_allclose(quaternion_log(-q), expected, atol=ROUNDING)


def test_angles_of_flight_are_scipys() -> None:
    rpy = np.array([1.0, 0.49, 1.0]) * np.pi * (2.0 * RNG.random((20, 3)) - 1.0)
    q = quaternion_from_rpy(rpy)
    expected = Rotation.from_euler("ZYX", rpy[:, ::-1]).as_matrix()
    np.testing.assert_allclose(matrix_from_quaternion(q), expected, atol=ROUNDING)
    np.testing.assert_allclose(rpy_from_quaternion(q), rpy, atol=1e-12)
