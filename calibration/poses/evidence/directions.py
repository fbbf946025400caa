"""How well the directions of gravity at rest are known: by an accelerometer that was calibrated on the same poses."""

from __future__ import annotations

import numpy as np

from sinan.calibration.poses.evidence.bias_walk import estimated_walk, walk_covariance
from sinan.calibration.poses.gyro import GyroLog
from sinan.calibration.poses.triad import norm_jacobian
from sinan.sensors.arrays import FloatArray


def direction_covariance(log: GyroLog, walk: float | None) -> FloatArray:
    """(3 poses, 3 poses) covariance of the calibrated directions [(m/s^2)^2].

    White noise and a wandering bias enter each direction by its own reading, and all of them through the calibration,
    whose parameters they bend: an error that goes with the direction as the gyroscope's own effects do. What the
    calibration leaves beyond both counts as white.

    Parameters
    ----------
    walk : declared random walk of the accelerometer's bias; None: as the residuals of the calibration have it
    """
    poses = log.poses
    n = len(poses)
    lasting = log.t[poses.stop - 1] - log.t[poses.start]
    reading = poses.mean[:, :3]
    if log.accel is None:
        centre = np.eye(n) - 1.0 / n
        wandering = (walk or 0.0) ** 2 * centre @ walk_covariance(poses.t, lasting) @ centre
        return np.asarray(np.kron(np.diag(log.sigma_direction**2) + wandering, np.eye(3)), dtype=np.float64)
    if walk is None:
        walk = _walk_left(log)
    A = log.accel.response(reading)
    noise = np.kron(np.diag(log.sigma_white**2) + walk**2 * walk_covariance(poses.t, lasting), np.eye(3))
    covariance = A @ noise @ A.T
    e = log.direction / log.gravity
    along = np.einsum("ki,kikj,kj->k", e, covariance.reshape(n, 3, n, 3), e)
    freedom = max(n - len(log.accel.fit.x), 1)
    excess = max(log.accel.fit.sse - float(np.sum(along)), 0.0) / freedom
    return np.asarray(covariance + excess * (A @ A.T))


def _walk_left(log: GyroLog) -> float:
    """Random walk of the accelerometer's bias that its calibration's residuals show [m/s^2/sqrt(s)]."""
    assert log.accel is not None
    reading = log.poses.mean[:, :3]
    fit = log.accel.fit
    e = log.direction / log.gravity
    offset = e @ (log.accel.T_seen * log.accel.K)
    sigma = log.sigma_white
    J = norm_jacobian(fit.x, reading)
    _, walk = estimated_walk(fit.residual / sigma, J / sigma[:, None], offset / sigma[:, None], log.poses.t)
    return walk
