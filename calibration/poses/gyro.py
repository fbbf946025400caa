"""Calibration of a gyroscope by turns between static poses: T K (reading + b). The course, section 2.

Between two poses the calibrated rate is integrated to a rotation, which must carry the direction that the calibrated
accelerometer showed before the turn into the one it shows after; at rest the calibrated rate must be zero. The
direction is that of specific force (up), the opposite of the course's g (-sin pitch, ...); the residual only changes
its sign.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sinan.calibration.poses.least_squares import LeastSquaresFit, solve
from sinan.calibration.poses.segments import Poses, find_poses
from sinan.calibration.poses.triad import Calibration, calibrate_norm
from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import EARTH_RATE
from sinan.sensors.errors import InputError
from sinan.sensors.formats.plausible import HIGHEST_RATE_AT_REST
from sinan.sensors.rotation import (
    matrix_from_quaternion,
    quaternion_conjugate,
    quaternion_log,
    quaternion_multiply,
    right_jacobian,
    skew,
)

_OFF_DIAGONAL = tuple((i, j) for i in range(3) for j in range(3) if i != j)
_NAMES = tuple(f"scale {a}" for a in "xyz") + tuple(f"offset {a}" for a in "xyz")
_NAMES += tuple("T_" + "xyz"[i] + "xyz"[j] for i, j in _OFF_DIAGONAL)
_PLAUSIBLE = np.array([0.05] * 3 + [0.1] * 3 + [0.05] * 6)  # 1, rad/s, 1: MPU-6050 data sheet, +-3 %, +-20 deg/s, 2 %
#: A turn's path over its change of tilt: one, or a few. Degrees make it 180 / pi = 57 times that, so that the limits
#: are between 1 and 57, between 1 and 1 / 57, and between 57 and the 1000 of thousandths.
_LONGEST_TURN, _SHORTEST_TURN, _NOT_DEGREES = 20.0, 0.1, 300.0


@dataclass(frozen=True)
class GyroLog:
    """A full-rate log of static poses with turns between, its accelerometer calibrated.

    Attributes
    ----------
    t, reading : (n,) s, (n, 3) raw gyroscope [rad/s]
    f_b : (n, 3) calibrated specific force [m/s^2]
    poses : the static segments; channels accel x y z, gyro x y z
    direction : (poses, 3) mean calibrated specific force at rest, scaled to length g [m/s^2]
    sigma_direction : (poses,) 1-sigma of its components [m/s^2]
    density : white-noise density of the gyroscope [rad/s/sqrt(Hz)]
    gravity : m/s^2
    sigma_white : (poses,) what the accelerometer's white noise alone leaves of `sigma_direction` [m/s^2]
    accel : the calibration of the accelerometer; None: too few poses for one
    """

    t: FloatArray
    reading: FloatArray
    f_b: FloatArray
    poses: Poses
    direction: FloatArray
    sigma_direction: FloatArray
    density: float
    gravity: float
    sigma_white: FloatArray
    accel: Calibration | None

    @property
    def turns(self) -> tuple[slice, ...]:
        """Rows of each turn: from the last row at rest to the first row at rest again."""
        return tuple(
            slice(int(a) - 1, int(b) + 1) for a, b in zip(self.poses.stop[:-1], self.poses.start[1:], strict=True)
        )

    @property
    def turn_times(self) -> tuple[FloatArray, FloatArray]:
        """(turns,) start and end of each turn [s]."""
        return self.t[self.poses.stop[:-1] - 1], self.t[self.poses.start[1:]]


def read_turns(
    t: FloatArray,
    accel: FloatArray,
    gyro: FloatArray,
    gravity: float,
    density: float | None = None,
    accel_density: float | None = None,
    where: str = "imu",
) -> GyroLog:
    """Find the poses of a full-rate log and calibrate its accelerometer, as a gyroscope calibration needs it.

    The accelerometer is calibrated with the triangular axes where nine poses or more allow it, else with T = I.

    Parameters
    ----------
    t, accel, gyro : (n,) s, (n, 3) m/s^2, (n, 3) rad/s
    gravity : m/s^2
    density, accel_density : declared white-noise densities; None: measured at rest
    where : how messages call the log

    Raises
    ------
    InputError : fewer than four poses, or a gyroscope that turns as no rate in rad/s does
    """
    poses = find_poses(t, accel, gyro, where, at_least=4)
    rate = 1.0 / float(np.median(np.diff(t)))
    calibration = None
    if len(poses) >= 6:
        axes = "triangular" if len(poses) > 9 else "none"
        calibration = calibrate_norm("accel", poses.mean[:, :3], gravity, axes, where=where)  # type: ignore[arg-type]
    f_b = accel if calibration is None else calibration.apply(accel)
    direction = poses.mean[:, :3] if calibration is None else calibration.apply(poses.mean[:, :3])
    leftover = 0.0 if calibration is None or np.isnan(calibration.fit.sigma) else calibration.fit.sigma
    direction = gravity * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    at_rest = np.sqrt(np.mean(poses.noise[:, :3] ** 2)) if accel_density is None else accel_density * np.sqrt(rate)
    if density is None:
        density = float(np.sqrt(np.mean(poses.noise[:, 3:] ** 2) / rate))
    white = at_rest / np.sqrt(poses.count)
    sigma = np.hypot(white, leftover)
    log = GyroLog(t, gyro, f_b, poses, direction, sigma, density, gravity, white, calibration)
    _require_radians(log, where)
    return log


def rotation_increments(t: FloatArray, w: FloatArray) -> FloatArray:
    """(n-1, 4) rotation from each sample to the next by one Runge-Kutta step of dq/dt = q * (0, w) / 2.

    The equation is linear in q, so a step of the classical fourth-order method is q -> q * p with p a polynomial in w,
    here with w linear between the samples: all steps at once. Source: the course, lecture 5 (quaternion rate) with
    Runge-Kutta; error per step O(h^5), and p is normalised.
    """
    h = np.diff(t)[:, None]
    one = np.array([1.0, 0.0, 0.0, 0.0])

    def rate(q: FloatArray, w_k: FloatArray) -> FloatArray:
        return 0.5 * quaternion_multiply(q, np.concatenate([np.zeros((len(w_k), 1)), w_k], axis=1))

    first, last = w[:-1], w[1:]
    middle = 0.5 * (first + last)
    k1 = rate(np.broadcast_to(one, (len(h), 4)), first)
    k2 = rate(one + 0.5 * h * k1, middle)
    k3 = rate(one + 0.5 * h * k2, middle)
    k4 = rate(one + h * k3, last)
    p = one + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return p / np.linalg.norm(p, axis=1, keepdims=True)


def running_product(p: FloatArray) -> FloatArray:
    """(n, 4) q_k = p_0 * p_1 * ... * p_k by doubling: log2(n) vectorised passes."""
    q = p.copy()
    shift = 1
    while shift < len(q):
        q[shift:] = quaternion_multiply(q[:-shift], q[shift:])
        shift *= 2
    return q


@dataclass(frozen=True)
class Turns:
    """Integrated turns and how they respond to the rate.

    Attributes
    ----------
    predicted : (turns, 3) direction at the end of each turn [m/s^2]
    rotation : (turns, 3, 3) C': predicted = rotation @ (direction before the turn)
    sensitivity : for each turn (samples, 3, 3): d predicted / d w_k [m/s^2 per rad/s]
    rows : for each turn the slice of the log's rows that its samples are
    """

    predicted: FloatArray
    rotation: FloatArray
    sensitivity: tuple[FloatArray, ...]
    rows: tuple[slice, ...]

    def derivative(self, D: FloatArray) -> FloatArray:
        """(turns, 3, m) d predicted / d theta, where D (n, 3, m) is d w / d theta at every row of the log."""
        return np.array(
            [np.einsum("kij,kjm->im", s, D[r]) for s, r in zip(self.sensitivity, self.rows, strict=True)]
        ).reshape(len(self.rows), 3, D.shape[2])


def integrate_turns(t: FloatArray, rows: Sequence[slice], direction: FloatArray, w: FloatArray) -> Turns:
    """Carry the direction before each turn through the turn.

    C = prod Exp(phi_k), f_end = C' f_start;  with phi_k -> phi_k + d phi_k:
    d f_end = [f_end]x sum_k C_k+1..n' J_r d phi_k,  d phi_k = h (d w_k + d w_k+1) / 2

    Parameters
    ----------
    t : (n,) s
    rows : the rows of each turn
    direction : (turns, 3) before each turn [m/s^2]
    w : (n, 3) angular rate [rad/s]
    """
    increments = rotation_increments(t, w)
    q = running_product(increments)  # through everything; a turn is what lies between its ends
    step = right_jacobian(quaternion_log(increments)) * np.diff(t)[:, None, None]
    predicted, rotation, sensitivity = [], [], []
    for turn, before in zip(rows, direction, strict=True):
        steps = slice(turn.start, turn.stop - 1)
        start = q[turn.start - 1] if turn.start > 0 else np.array([1.0, 0.0, 0.0, 0.0])
        C = matrix_from_quaternion(quaternion_multiply(quaternion_conjugate(start), q[turn.stop - 2]))
        f_end = C.T @ before
        rest = matrix_from_quaternion(quaternion_multiply(quaternion_conjugate(q[steps]), q[turn.stop - 2]))  # C_k+1..n
        half = 0.5 * skew(f_end) @ np.swapaxes(rest, 1, 2) @ step[steps]
        response = np.zeros((turn.stop - turn.start, 3, 3))
        response[:-1] += half
        response[1:] += half
        predicted.append(f_end)
        rotation.append(C.T)
        sensitivity.append(response)
    return Turns(np.array(predicted), np.array(rotation), tuple(sensitivity), tuple(rows))


@dataclass(frozen=True)
class GyroCalibration:
    """Result: `calibrated = T @ K @ (reading + offset)`.

    Attributes
    ----------
    T : (3, 3) axes against those of the accelerometer, unit diagonal
    K : (3,) scale
    offset : (3,) rad/s, minus the bias
    fit : the least-squares solution behind it, in whitened residuals
    log : the poses and turns it was made from
    weights : (2,) factors (>= 1) by which the residuals of turns and of rests exceed their noise
    sse_before, sse : sum of squared direction residuals of the turns, before and after [(m/s^2)^2]
    """

    T: FloatArray
    K: FloatArray
    offset: FloatArray
    fit: LeastSquaresFit
    log: GyroLog
    weights: FloatArray
    sse_before: float
    sse: float

    @property
    def undetermined(self) -> tuple[str, ...]:
        """A sentence for each direction that the data do not determine."""
        return self.fit.undetermined

    def std(self) -> dict[str, FloatArray]:
        """1-sigma of T (3, 3), K (3,), b (3,)."""
        T = np.zeros((3, 3))
        for k, entry in enumerate(_OFF_DIAGONAL[: len(self.fit.x) - 6]):
            T[entry] = self.fit.std[6 + k]
        return {"T": T, "K": self.fit.std[:3], "b": self.fit.std[3:6]}

    def apply(self, reading: FloatArray) -> FloatArray:
        """(n, 3) calibrated rate [rad/s]."""
        return (reading + self.offset) * self.K @ self.T.T


def noise_of_turns(log: GyroLog, earth_rotation: bool = True) -> tuple[FloatArray, FloatArray]:
    """1-sigma of each component of a turn's direction residual [m/s^2], and of the mean rate at rest [rad/s].

    A turn: both directions, and the white noise of the rate integrated over it, g N sqrt(duration). At rest: N /
    sqrt(time) and, where the log may hold it, the rate of the Earth, whose direction in the body is not known.
    """
    begin, end = log.turn_times
    duration = end - begin
    gyro = log.gravity * log.density * np.sqrt(duration)
    turn = np.sqrt(log.sigma_direction[:-1] ** 2 + log.sigma_direction[1:] ** 2 + gyro**2)
    time = log.t[log.poses.stop - 1] - log.t[log.poses.start]
    rest = np.hypot(log.density / np.sqrt(time), EARTH_RATE / np.sqrt(3.0) if earth_rotation else 0.0)
    return turn, rest


def calibrate_gyro(log: GyroLog, axes: str = "full", where: str = "imu") -> GyroCalibration:
    """Calibrate a gyroscope by the turns between static poses.

    min sum |C(w)' f_before - f_after|^2 / sigma_turn^2 + sum |mean w at rest|^2 / sigma_rest^2,  w = T K (reading + b)

    The two kinds of residual are weighted by their own scatter, found by iteration where it exceeds the noise.

    Parameters
    ----------
    log : from `read_turns`
    axes : "none": T = I; "triangular": the three entries above the diagonal; "full": all six (needs turns about all
    axes)
    where : how messages call the log

    Neglects gyro.g_sensitivity, gyro.temperature, a bias that wanders during the log, and the rate of the Earth in
    turns.

    Raises
    ------
    InputError : the fit does not settle: too few turns, or such as no calibration explains
    """
    entries = {"none": (), "triangular": ((0, 1), (0, 2), (1, 2)), "full": _OFF_DIAGONAL}[axes]
    names = _NAMES[:6] + tuple("T_" + "xyz"[i] + "xyz"[j] for i, j in entries)
    plausible = np.concatenate([_PLAUSIBLE[:6], np.full(len(entries), 0.05)])
    sigma_turn, sigma_rest = noise_of_turns(log)
    bias = np.median(log.poses.mean[:, 3:], axis=0)
    start = np.concatenate([np.ones(3), -bias, np.zeros(len(entries))])
    factors = np.ones(2)
    for _ in range(4):  # the two scatters settle within a per cent after two or three
        residual, jacobian = _whitened(log, entries, sigma_turn * factors[0], sigma_rest * factors[1])
        fit = solve(residual, jacobian, start, names, plausible, sigma=1.0, where=where)
        turns = 3 * len(log.turns)
        freedom = max(1.0 - len(start) / len(fit.residual), 0.1)
        groups = fit.residual[:turns], fit.residual[turns:]
        factors = np.maximum(factors * [np.sqrt(np.mean(g**2) / freedom) for g in groups], 1.0)
        start = fit.x
    T = np.eye(3)
    for k, entry in enumerate(entries):
        T[entry] = fit.x[6 + k]
    before = _direction_residual(log, log.reading - bias)
    after = _direction_residual(log, (log.reading + fit.x[3:6]) * fit.x[:3] @ T.T)
    return GyroCalibration(
        T, fit.x[:3], fit.x[3:6], fit, log, factors, float(np.sum(before**2)), float(np.sum(after**2))
    )


def _direction_residual(log: GyroLog, w: FloatArray) -> FloatArray:
    return integrate_turns(log.t, log.turns, log.direction[:-1], w).predicted - log.direction[1:]


def _whitened(
    log: GyroLog, entries: tuple[tuple[int, int], ...], sigma_turn: FloatArray, sigma_rest: FloatArray
) -> tuple[Callable[[FloatArray], FloatArray], Callable[[FloatArray], FloatArray]]:
    """Residual and Jacobian over the parameters K, b, entries of T, each row divided by its sigma."""

    def rate(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        T = np.eye(3)
        for k, entry in enumerate(entries):
            T[entry] = x[6 + k]
        v = (y + x[3:6]) * x[:3]
        D = np.zeros((len(y), 3, len(x)))
        D[:, :, :3] = T * (y + x[3:6])[:, None, :]
        D[:, :, 3:6] = T * x[:3]
        for k, (i, j) in enumerate(entries):
            D[:, i, 6 + k] = v[:, j]
        return v @ T.T, D

    def residual(x: FloatArray) -> FloatArray:
        turns = _direction_residual(log, rate(x, log.reading)[0]) / sigma_turn[:, None]
        rest = rate(x, log.poses.mean[:, 3:])[0] / sigma_rest[:, None]
        return np.concatenate([turns.ravel(), rest.ravel()])

    def jacobian(x: FloatArray) -> FloatArray:
        w, D = rate(x, log.reading)
        turns = integrate_turns(log.t, log.turns, log.direction[:-1], w).derivative(D) / sigma_turn[:, None, None]
        rest = rate(x, log.poses.mean[:, 3:])[1] / sigma_rest[:, None, None]
        return np.concatenate([turns.reshape(-1, len(x)), rest.reshape(-1, len(x))])

    return residual, jacobian


def _require_radians(log: GyroLog, where: str) -> None:
    """Compare the turns as the gyroscope and as the accelerometer saw them: degrees come out 57 times too long."""
    expected = "a gyroscope in rad/s, after the conversion of a map"
    bias = np.median(log.poses.mean[:, 3:], axis=0)
    at_rest = float(np.linalg.norm(bias))
    if at_rest > HIGHEST_RATE_AT_REST:
        found = f"gyroscope with a rate of {at_rest:.3g} rad/s ({np.rad2deg(at_rest):.0f} deg/s) at rest"
        raise InputError(
            where,
            f"{found}: looks like deg/s, or another unit",
            f"{expected}, below {HIGHEST_RATE_AT_REST:.0f} at rest",
        )
    speed = np.linalg.norm(log.reading - bias, axis=1)
    angle = np.array([np.sum(speed[turn][:-1] * np.diff(log.t[turn])) for turn in log.turns])
    unit = log.direction / log.gravity
    tilt = np.arccos(np.clip(np.sum(unit[1:] * unit[:-1], axis=1), -1.0, 1.0))
    ratio = float(np.median(angle / np.maximum(tilt, 1e-3)))
    if _SHORTEST_TURN <= ratio <= _LONGEST_TURN:
        return
    turned, shown = np.rad2deg(float(np.median(angle))), np.rad2deg(float(np.median(tilt)))
    relation = f"{ratio:.0f} times longer" if ratio > 1.0 else f"{1.0 / max(ratio, 1e-9):.0f} times shorter"
    found = f"gyroscope with turns of {turned:.3g} deg where the accelerometer shows {shown:.3g} deg ({relation})"
    looks = "looks like deg/s" if _LONGEST_TURN < ratio < _NOT_DEGREES else "looks like another unit, or no turns"
    raise InputError(where, f"{found}: {looks}", expected)
