"""Rotations: matrices from vectors and angles, quaternions from matrices. Active and right-handed."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray


def skew(v: FloatArray) -> FloatArray:
    """(..., 3, 3) with skew(v) @ x = v x x."""
    x, y, z = np.moveaxis(np.asarray(v, dtype=np.float64), -1, 0)
    zero = np.zeros_like(x)
    rows = [np.stack(row, axis=-1) for row in ([zero, -z, y], [z, zero, -x], [-y, x, zero])]
    return np.stack(rows, axis=-2)


def vee(M: FloatArray) -> FloatArray:
    """(..., 3) the vector of the antisymmetric part of M."""
    parts = [M[..., 2, 1] - M[..., 1, 2], M[..., 0, 2] - M[..., 2, 0], M[..., 1, 0] - M[..., 0, 1]]
    return 0.5 * np.stack(parts, axis=-1)


def exp_rotation(v: FloatArray) -> FloatArray:
    """(..., 3, 3) Exp(v) = I + sin|v|/|v| [v]x + (1 - cos|v|)/|v|^2 [v]x^2 (Rodrigues)."""
    v = np.asarray(v, dtype=np.float64)
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    K = skew(v)
    sine = np.sinc(angle / np.pi)
    versine = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    return np.eye(3) + sine * K + versine * (K @ K)


def rot_x(angle: float) -> FloatArray:
    """(3, 3) about x."""
    return exp_rotation(np.array([angle, 0.0, 0.0]))


def rot_y(angle: float) -> FloatArray:
    """(3, 3) about y."""
    return exp_rotation(np.array([0.0, angle, 0.0]))


def rot_z(angle: float) -> FloatArray:
    """(3, 3) about z."""
    return exp_rotation(np.array([0.0, 0.0, angle]))


def quaternion(C: FloatArray) -> FloatArray:
    """(n, 4) w x y z of rotation matrices (n, 3, 3), w >= 0 (Shepperd's choice of the largest component)."""
    trace = np.trace(C, axis1=1, axis2=2)
    squares = np.stack([1.0 + trace, *(1.0 - trace + 2.0 * C[:, i, i] for i in range(3))], axis=-1)
    k = np.argmax(squares, axis=1)
    largest = 0.5 * np.sqrt(np.max(squares, axis=1))
    wx, wy, wz = (C[:, 2, 1] - C[:, 1, 2], C[:, 0, 2] - C[:, 2, 0], C[:, 1, 0] - C[:, 0, 1])
    xy, xz, yz = (C[:, 0, 1] + C[:, 1, 0], C[:, 0, 2] + C[:, 2, 0], C[:, 1, 2] + C[:, 2, 1])
    four = 4.0 * largest**2
    table = np.stack([
        np.stack([four, wx, wy, wz], axis=-1),
        np.stack([wx, four, xy, xz], axis=-1),
        np.stack([wy, xy, four, yz], axis=-1),
        np.stack([wz, xz, yz, four], axis=-1),
    ])  # fmt: skip
    q = table[k, np.arange(len(C))] / (4.0 * largest[:, None])
    return q * np.where(q[:, :1] < 0.0, -1.0, 1.0)


def random_rotation(rng: np.random.Generator) -> FloatArray:
    """(3, 3) uniform over all attitudes."""
    Q, R = np.linalg.qr(rng.normal(size=(3, 3)))
    Q = Q * np.sign(np.diag(R))
    return Q if np.linalg.det(Q) > 0.0 else -Q


def random_direction(rng: np.random.Generator, size: int = 3) -> FloatArray:
    """(size,) uniform on the unit sphere; for one parameter its sign."""
    v = rng.normal(size=size)
    return np.asarray(v / np.linalg.norm(v))


def mat_vec(C: FloatArray, v: FloatArray) -> FloatArray:
    """(n, 3) C v row by row."""
    return np.einsum("nij,nj->ni", C, v)


def cross_rows(a: FloatArray, b: FloatArray) -> FloatArray:
    """(n, 3) a x b row by row."""
    return np.cross(a, b)
