"""Solutions of the lab `camera`."""

from __future__ import annotations

import numpy as np

from sinan.experiments.student_labs.camera import FAR, POINT, WANTED
from sinan.experiments.student_labs.lab import Data, Solution
from sinan.sensors.arrays import FloatArray
from sinan.sensors.camera import Intrinsics
from sinan.sensors.rotation import rotation_exp


def linear(points: FloatArray, uv: FloatArray) -> FloatArray:
    """(11,) f_x, f_y, u0, v0, k1 = 0, rotation vector, T of s (u, v, 1) = M1 M2 (P_e, 1), which is linear in M1 M2."""
    from scipy.linalg import rq
    from scipy.spatial.transform import Rotation

    P, zero = np.column_stack([points, np.ones(len(points))]), np.zeros((len(points), 4))
    A = np.concatenate([np.hstack([P, zero, -uv[:, :1] * P]), np.hstack([zero, P, -uv[:, 1:] * P])])
    M = np.linalg.svd(A)[2][-1].reshape(3, 4)
    M = M * np.sign(np.linalg.det(M[:, :3]))
    K, R = rq(M[:, :3])
    sign = np.diag(np.sign(np.diag(K)))
    K, R = K @ sign, sign @ R
    K, T = K / K[2, 2], np.linalg.solve(K, M[:, 3])
    return np.concatenate([[K[0, 0], K[1, 1], K[0, 2], K[1, 2], 0.0], Rotation.from_matrix(R).as_rotvec(), T])


def fitted(data: Data, distorted: bool) -> tuple[FloatArray, FloatArray, float]:
    """(11,) as of `linear` at the minimum of the residual, with k1 or with k1 = 0; the residual (n, 2); its RMS."""
    from scipy.optimize import least_squares

    points, uv = (np.column_stack([data[c] for c in names]) for names in ("xyz", "uv"))
    start = linear(points, uv)
    free = np.arange(11) if distorted else np.delete(np.arange(11), 4)

    def residual(x: FloatArray) -> FloatArray:
        whole = start.copy()
        whole[free] = x
        return np.asarray((seen(whole, points) - uv).ravel())

    size = np.array([1e3] * 4 + [0.1] + [1.0] * 6)[free]
    found = least_squares(residual, start[free], x_scale=size, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    whole = start.copy()
    whole[free] = found.x
    r = residual(found.x).reshape(-1, 2)
    return whole, r, float(np.sqrt(np.mean(np.sum(r**2, axis=1))))


def seen(x: FloatArray, points: FloatArray) -> FloatArray:
    """(n, 2) pixels of points (n, 3)."""
    return Intrinsics(x[:2], x[2:4], "brown", x[4:5]).pixels(points @ rotation_exp(x[5:8]).T + x[8:])


def place(data: Data, distorted: bool) -> FloatArray:
    """(3,) where the camera stands [m]: -R' T."""
    x = fitted(data, distorted)[0]
    return -rotation_exp(x[5:8]).T @ x[8:]


def baseline(data: Data) -> FloatArray:
    """b = Z^2 sqrt(2) sigma / (f_x sigma_Z) [m], sigma of one coordinate = RMS of the point / sqrt(2)."""
    x, _, rms = fitted(data, True)
    return np.array([FAR**2 * rms / (x[0] * WANTED)])


SOLUTIONS = {
    "intrinsics": Solution(
        lambda d: fitted(d, False)[0][:4],
        (lambda d: fitted(d, True)[0][:4], lambda d: fitted(d, False)[0][[0, 2, 1, 3]]),
    ),
    "rms": Solution(
        lambda d: np.array([fitted(d, False)[2]]), (lambda d: np.array([fitted(d, False)[2] / np.sqrt(2.0)]),)
    ),
    "pixel": Solution(lambda d: seen(fitted(d, False)[0], POINT[None])[0]),
    "k1": Solution(lambda d: fitted(d, True)[0][4:5], (lambda d: -fitted(d, True)[0][4:5],)),
    "place": Solution(lambda d: place(d, True), (lambda d: fitted(d, True)[0][8:], lambda d: place(d, False))),
    "baseline": Solution(baseline, (lambda d: baseline(d) / np.sqrt(2.0), lambda d: baseline(d) / FAR)),
}
