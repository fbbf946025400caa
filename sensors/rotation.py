"""Rotations as arrays: scalar-first Hamilton quaternions `q_nb` that turn body vectors into NED.

What SciPy lacks or does too slowly for a time loop: quaternion arrays with the scalar first, the exponential map, its
right Jacobian, and the ZYX angles of flight. Everything works on a leading axis of any shape.

Attitude error convention of the whole project: ``C_nb_true = C_nb @ Exp(dtheta_b)``.
Source: J. Sola, "Quaternion kinematics for the error-state Kalman filter", arXiv:1711.02508, 2017 (equation numbers
below).
"""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray

_SMALL_ANGLE = 1e-8  # rad; below it the series is exact to rounding


def _parts(v: FloatArray) -> tuple[FloatArray, ...]:
    """The components along the last axis."""
    return tuple(v[..., k] for k in range(v.shape[-1]))


def _joined(*parts: FloatArray) -> FloatArray:
    """Components along a last axis: `np.stack`, which takes several times as long for short arrays."""
    out = np.empty((*np.shape(parts[0]), len(parts)))
    for k, part in enumerate(parts):
        out[..., k] = part
    return out


def cross(u: FloatArray, v: FloatArray) -> FloatArray:
    """u x v; (..., 3), (..., 3) -> (..., 3): `np.cross`, which takes several times as long for short arrays."""
    a, b, c = _parts(u)
    x, y, z = _parts(v)
    return _joined(b * z - c * y, c * x - a * z, a * y - b * x)


def skew(v: FloatArray) -> FloatArray:
    """Matrix of the cross product, ``skew(v) @ u = v x u``; (..., 3) -> (..., 3, 3)."""
    zero = np.zeros(v.shape[:-1])
    x, y, z = _parts(v)
    return _joined(zero, -z, y, z, zero, -x, -y, x, zero).reshape(*v.shape[:-1], 3, 3)


def quaternion_exp(phi: FloatArray) -> FloatArray:
    """Quaternion of the rotation vector `phi` [rad]; (..., 3) -> (..., 4). Sola eq. 101."""
    x, y, z = _parts(phi)
    half = 0.5 * np.sqrt(x * x + y * y + z * z)
    scale = 0.5 * np.sinc(half / np.pi)
    return _joined(np.cos(half), scale * x, scale * y, scale * z)


def quaternion_log(q: FloatArray) -> FloatArray:
    """Rotation vector [rad] of a unit quaternion, length at most pi; (..., 4) -> (..., 3). Sola eq. 105."""
    w, x, y, z = _parts(q)
    vector_norm = np.sqrt(x * x + y * y + z * z)
    angle = 2.0 * np.arctan2(vector_norm, np.abs(w))
    safe = np.where(vector_norm > _SMALL_ANGLE, vector_norm, 1.0)
    scale = np.where(w < 0.0, -1.0, 1.0) * np.where(vector_norm > _SMALL_ANGLE, angle / safe, 2.0)
    return _joined(scale * x, scale * y, scale * z)


def quaternion_multiply(p: FloatArray, q: FloatArray) -> FloatArray:
    """Hamilton product p * q; (..., 4). Sola eq. 12."""
    pw, px, py, pz = _parts(p)
    qw, qx, qy, qz = _parts(q)
    return _joined(
        pw * qw - px * qx - py * qy - pz * qz,
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
    )


def quaternion_conjugate(q: FloatArray) -> FloatArray:
    """Inverse of a unit quaternion; (..., 4)."""
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def matrix_from_quaternion(q: FloatArray) -> FloatArray:
    """C_nb of q_nb; (..., 4) -> (..., 3, 3). Sola eq. 115."""
    w, x, y, z = _parts(q)
    rows = _joined(
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    )  # fmt: skip
    return rows.reshape(*q.shape[:-1], 3, 3)


def quaternion_from_matrix(C: FloatArray) -> FloatArray:
    """q_nb of C_nb, scalar part not negative; (..., 3, 3) -> (..., 4). SciPy's `Rotation`, scalar first."""
    from scipy.spatial.transform import Rotation

    q = Rotation.from_matrix(C.reshape(-1, 3, 3)).as_quat(canonical=True, scalar_first=True)
    return np.asarray(q, dtype=np.float64).reshape(*C.shape[:-2], 4)


def rotation_exp(phi: FloatArray) -> FloatArray:
    """Rotation matrix of the rotation vector `phi` [rad], active and right-handed; (..., 3) -> (..., 3, 3)."""
    return matrix_from_quaternion(quaternion_exp(phi))


def right_jacobian(phi: FloatArray) -> FloatArray:
    """J_r with Exp(phi + d) = Exp(phi) Exp(J_r d) to first order; (..., 3) -> (..., 3, 3). Sola eq. 183."""
    angle = np.linalg.norm(phi, axis=-1)[..., None, None]
    square = angle * angle
    small = angle < 1e-4  # rad; the series' next term is below 1e-18 there
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 0.5 - square / 24.0, (1.0 - np.cos(safe)) / safe**2)
    b = np.where(small, 1.0 / 6.0 - square / 120.0, (safe - np.sin(safe)) / safe**3)
    S = skew(phi)
    return np.eye(3) - a * S + b * (S @ S)


def rotate(q: FloatArray, v: FloatArray) -> FloatArray:
    """v_n = C_nb v_b = v_b + w t + u x t with t = 2 u x v_b, q = (w, u); (..., 4), (..., 3) -> (..., 3)."""
    w, x, y, z = _parts(q)
    a, b, c = _parts(v)
    t_x, t_y, t_z = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return _joined(
        a + w * t_x + (y * t_z - z * t_y),
        b + w * t_y + (z * t_x - x * t_z),
        c + w * t_z + (x * t_y - y * t_x),
    )


def rotate_back(q: FloatArray, v: FloatArray) -> FloatArray:
    """v_b = C_bn v_n = C_nb' v_n; (..., 4), (..., 3) -> (..., 3)."""
    return rotate(quaternion_conjugate(q), v)


def rpy_from_quaternion(q: FloatArray) -> FloatArray:
    """Roll, pitch, yaw [rad] of q_nb, ZYX sequence; (..., 4) -> (..., 3). At pitch +-90 deg roll and yaw merge."""
    w, x, y, z = _parts(q)
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return _joined(roll, pitch, yaw)


def quaternion_from_rpy(rpy: FloatArray) -> FloatArray:
    """q_nb of roll, pitch, yaw [rad], ZYX sequence; (..., 3) -> (..., 4)."""
    half = 0.5 * np.asarray(rpy, dtype=np.float64)
    cr, cp, cy = _parts(np.cos(half))
    sr, sp, sy = _parts(np.sin(half))
    return _joined(
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def tilted(roll: FloatArray, pitch: FloatArray) -> FloatArray:
    """(..., 4) attitude with that roll and pitch [rad] and no yaw, which neither heights nor magnetic headings need."""
    return quaternion_from_rpy(np.stack(np.broadcast_arrays(roll, pitch, 0.0), axis=-1))


def cos_tilt(q: FloatArray) -> FloatArray:
    """Cosine of the angle between body down and down, cos(pitch) cos(roll); (..., 4) -> (...)."""
    x, y = q[..., 1], q[..., 2]
    return 1.0 - 2.0 * (x * x + y * y)


def turned_since_start(t: FloatArray, w: FloatArray) -> FloatArray:
    """(n, 4) attitude relative to that at the first instant, from rates (n, 3) in the turning axes [rad/s]."""
    turn = np.zeros((len(t), 4))
    turn[0, 0] = 1.0
    turn[1:] = quaternion_exp(0.5 * (w[1:] + w[:-1]) * np.diff(t)[:, None])
    reach = 1
    while reach < len(t):  # each row is the product of the `reach` steps before it
        turn[reach:] = quaternion_multiply(turn[:-reach], turn[reach:])
        reach *= 2
    return turn / np.linalg.norm(turn, axis=1, keepdims=True)


def quaternion_interpolate(t: FloatArray, t_q: FloatArray, q: FloatArray) -> FloatArray:
    """Spherical linear interpolation of q (m, 4) at t_q (m,) to the instants t (n,); extrapolates beyond the ends."""
    if len(t_q) == 1:
        return np.repeat(q, len(t), axis=0)
    i = np.clip(np.searchsorted(t_q, t, side="right") - 1, 0, len(t_q) - 2)
    fraction = (t - t_q[i]) / (t_q[i + 1] - t_q[i])
    step = quaternion_log(quaternion_multiply(quaternion_conjugate(q[i]), q[i + 1]))
    return quaternion_multiply(q[i], quaternion_exp(fraction[:, None] * step))
