"""Attitude error against a reference on another body: mounting and delay from the rates, whatever the estimator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sensors.arrays import FloatArray
from sensors.recording import GYRO, Recording, Stream
from sensors.rotation import (
    quaternion_conjugate,
    quaternion_from_matrix,
    quaternion_from_rpy,
    quaternion_interpolate,
    quaternion_log,
    quaternion_multiply,
    rpy_from_quaternion,
)

QUATERNION = ("qw", "qx", "qy", "qz")
#: A reference that turns faster than this is wrong: three turns a second are beyond hands and robots [rad/s].
FASTEST = 20.0
#: Rows left out on either side of such a jump [s]: interpolation carried it that far.
AROUND = 0.08
#: Delays that are tried, their step, and the width over which rates are averaged before they are compared [s].
LARGEST_DELAY, DELAY_STEP, WIDTH = 0.2, 0.01, 0.2
GRID = 0.02


@dataclass(frozen=True)
class Mounted:
    """A reference brought to the sensor's axes and clock.

    Attributes
    ----------
    reference : on the recording's clock, its jumps left out
    mounting : (4,) sensor axes -> axes of the reference
    delay : how much later the recording's stamps are than the reference's [s]
    """

    reference: Stream
    mounting: FloatArray
    delay: float


@dataclass(frozen=True)
class AttitudeError:
    """Error of an attitude, row by row of the reference [rad].

    Attributes
    ----------
    t : (n,) s
    total, tilt, heading : (n,) angle of the whole rotation; of the vertical; about the vertical, signed
    north : constant heading between the two norths, taken off
    """

    t: FloatArray
    total: FloatArray
    tilt: FloatArray
    heading: FloatArray
    north: float


def mounted(recording: Recording, reference: Stream) -> Mounted:
    """Find mounting and delay of a reference with attitude from the recording's gyroscope alone.

    Least squares over rotations C and delays: sum |w_gyro(t + delay) - C w_reference(t)|^2, averaged over `WIDTH`.
    Source of the rotation: G. Wahba's problem, solved by SVD (F. L. Markley, J. Astronaut. Sci. 36, 1988).
    A reference without heading is returned as it is.
    """
    if not reference.has(QUATERNION):
        return Mounted(reference, np.array([1.0, 0.0, 0.0, 0.0]), 0.0)
    reference = without_jumps(reference)
    t, w_reference = _rates_of(reference, recording.streams["imu"])
    integral = _integral(recording.streams["imu"])
    best, found = np.inf, (np.eye(3), 0.0)
    for delay in np.arange(-LARGEST_DELAY, LARGEST_DELAY + 1e-9, DELAY_STEP):
        w_gyro = _rates(t + delay, *integral)
        u, _, vt = np.linalg.svd(w_gyro.T @ w_reference)
        C = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
        miss = float(np.sum((w_gyro - w_reference @ C.T) ** 2))
        if miss < best:
            best, found = miss, (C, float(delay))
    C, delay = found
    return Mounted(Stream(reference.t + delay, reference.columns), quaternion_from_matrix(C.T), delay)


@dataclass(frozen=True)
class GyroError:
    """A gyroscope against the rates of a reference, whatever the estimator.

    Attributes
    ----------
    scale : (3,) w_i += scale_i w_i
    cross_axis : (3,) symmetric part xy, xz, yz; the rest is the mounting
    rms : of the rate that neither explains [rad/s]
    """

    scale: FloatArray
    cross_axis: FloatArray
    rms: float


def gyro_error(recording: Recording, target: Mounted) -> GyroError:
    """Scale and crookedness of a gyroscope from a reference with attitude.

    w_gyro = G w_reference + bias by least squares; G = K R with K symmetric (polar decomposition), R the mounting.
    The reference's own noise takes a little off the scale.
    """
    imu = recording.streams["imu"]
    t, w_reference = _rates_of(target.reference, imu)
    w_gyro = _rates(t, *_integral(imu))
    A = np.hstack([w_reference, np.ones((len(w_reference), 1))])
    x = np.linalg.lstsq(A, w_gyro, rcond=None)[0]
    u, size, _ = np.linalg.svd(x[:3].T)
    K = u @ np.diag(size) @ u.T
    left = w_gyro - A @ x
    return GyroError(np.diag(K) - 1.0, np.array([K[0, 1], K[0, 2], K[1, 2]]), float(np.sqrt(np.mean(left**2))))


def without_jumps(reference: Stream) -> Stream:
    """The reference without rows around turns that no body makes, such as interpolation through a change of sign."""
    q = reference.array(QUATERNION)
    rate = np.linalg.norm(quaternion_log(quaternion_multiply(quaternion_conjugate(q[:-1]), q[1:])), axis=1)
    jumps = reference.t[1:][rate / np.diff(reference.t) > FASTEST]
    if not len(jumps):
        return reference
    after = np.clip(np.searchsorted(jumps, reference.t), 0, len(jumps) - 1)
    before = np.clip(after - 1, 0, None)
    near = np.minimum(np.abs(jumps[after] - reference.t), np.abs(jumps[before] - reference.t))
    return reference.rows(near > AROUND)


def attitude_error(t: FloatArray, q_nb: FloatArray, target: Mounted) -> AttitudeError:
    """Error of an estimated attitude against a mounted reference.

    The norths of a robot, of cameras and of the Earth differ: the mean heading between the two is taken off for every
    estimator. A reference of roll and pitch scores the tilt alone.

    Parameters
    ----------
    t, q_nb : (n,), (n, 4) the estimate
    target : the reference
    """
    inside = (target.reference.t >= t[0]) & (target.reference.t <= t[-1])
    reference = target.reference.rows(inside)
    q = quaternion_interpolate(reference.t, t, q_nb)
    if not reference.has(QUATERNION):
        rpy = rpy_from_quaternion(q)
        between = np.sum(_down(rpy[:, 0], rpy[:, 1]) * _down(reference["roll"], reference["pitch"]), axis=1)
        tilt = np.arccos(np.clip(between, -1.0, 1.0))
        return AttitudeError(reference.t, tilt, tilt, np.zeros(len(tilt)), 0.0)
    q_reference = reference.array(QUATERNION)
    q_reference = quaternion_multiply(q_reference, np.broadcast_to(target.mounting, q_reference.shape))
    d = quaternion_multiply(q, quaternion_conjugate(q_reference))  # in NED
    heading = 2.0 * np.arctan2(d[:, 3], d[:, 0])
    north = float(np.angle(np.mean(np.exp(1j * heading))))
    back = np.array([np.cos(0.5 * north), 0.0, 0.0, -np.sin(0.5 * north)])
    d = quaternion_multiply(np.broadcast_to(back, d.shape), d)
    heading = np.angle(np.exp(2j * np.arctan2(d[:, 3], d[:, 0])))
    tilt = 2.0 * np.arcsin(np.clip(np.hypot(d[:, 1], d[:, 2]), 0.0, 1.0))
    return AttitudeError(reference.t, np.linalg.norm(quaternion_log(d), axis=1), tilt, heading, north)


def in_frame(target: Mounted, t: FloatArray, q_nb: FloatArray) -> Stream:
    """A mounted reference as if it were the truth of the recording: its axes, its clock, the north of an estimate.

    A reference of roll and pitch is given the heading of the estimate, so that its attitude error is that of the tilt.

    Parameters
    ----------
    t, q_nb : (n,), (n, 4) the estimate
    """
    reference = target.reference.rows((target.reference.t >= t[0]) & (target.reference.t <= t[-1]))
    if reference.has(("roll", "pitch")) and len(reference):
        yaw = rpy_from_quaternion(quaternion_interpolate(reference.t, t, q_nb))[:, 2]
        q = quaternion_from_rpy(np.stack([reference["roll"], reference["pitch"], yaw], axis=-1))
    elif reference.has(QUATERNION) and len(reference):
        north = attitude_error(t, q_nb, target).north
        turn = np.array([np.cos(0.5 * north), 0.0, 0.0, np.sin(0.5 * north)])
        q = quaternion_multiply(reference.array(QUATERNION), np.broadcast_to(target.mounting, (len(reference), 4)))
        q = quaternion_multiply(np.broadcast_to(turn, q.shape), q)
    else:
        return reference
    rest = {name: values for name, values in reference.columns.items() if name not in ("roll", "pitch")}
    return Stream(reference.t, {**rest, **dict(zip(QUATERNION, q.T, strict=True))})


def _down(roll: FloatArray, pitch: FloatArray) -> FloatArray:
    """(n, 3) down in the body."""
    return np.stack([-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)], axis=-1)


def _rates_of(reference: Stream, imu: Stream) -> tuple[FloatArray, FloatArray]:
    """A grid of instants that both cover, and the averaged rates of the reference between them."""
    t = np.arange(max(imu.t[0], reference.t[0]) + 0.5, min(imu.t[-1], reference.t[-1]) - 0.5, GRID)
    at = quaternion_interpolate(t, reference.t, reference.array(QUATERNION))
    turn = quaternion_log(quaternion_multiply(quaternion_conjugate(at[:-1]), at[1:])) / GRID
    return t, _averaged(turn)


def _integral(imu: Stream) -> tuple[FloatArray, FloatArray]:
    """Instants of the IMU and the integral of the gyroscope's readings to each."""
    return imu.t, np.concatenate([np.zeros((1, 3)), np.cumsum(_steps(imu.t, imu.array(GYRO)), axis=0)])


def _rates(t: FloatArray, at: FloatArray, integral: FloatArray) -> FloatArray:
    """Averaged rates between the instants t of readings whose integral is known."""
    ends = np.stack([np.interp(t, at, column) for column in integral.T], axis=-1)
    return _averaged(np.diff(ends, axis=0) / GRID)


def _steps(t: FloatArray, values: FloatArray) -> FloatArray:
    return 0.5 * np.diff(t)[:, None] * (values[1:] + values[:-1])


def _averaged(values: FloatArray) -> FloatArray:
    width = round(WIDTH / GRID)
    return np.stack([np.convolve(column, np.full(width, 1.0 / width), mode="same") for column in values.T], axis=-1)
