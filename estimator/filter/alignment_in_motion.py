"""The first attitude of a body in motion: the one under which force and GPS velocity agree over the first seconds.

With S(t) the integral of the specific force, turned back to the first body axes with the gyroscope, and b0 those axes,

    S_k - mean(S) = C_nb0' ((v_k - g t_k) - mean(v - g t))           at the instants t_k of the GPS

are pairs of vectors, and the mean field is another: Wahba's problem. Where the acceleration varies it gives all three
angles; where it does not, all pairs are along the vertical, and it levels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from sinan.estimator.filter.flight_model import FlightModel
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import ACCEL, GYRO, VELOCITY, Recording
from sinan.sensors.rotation import (
    quaternion_conjugate,
    quaternion_exp,
    quaternion_from_matrix,
    quaternion_log,
    quaternion_multiply,
    rotate,
    rotate_back,
    skew,
    turned_since_start,
)

#: Seconds that are looked at: three velocities of a GPS at 1 Hz; a rate off by 0.01 rad/s turns by 0.03 rad meanwhile.
SECONDS = 3.0
LEAST = 3  # velocities: two differences, of which two directions are enough
LATE = 0.1  # s, 1-sigma of the lateness of a GPS that nobody told: receivers of autopilots have 0.05 to 0.2
SCALE = 0.01  # 1-sigma of the scales of accelerometer and gyroscope: a turn of 360 deg is known to 3.6 deg
ROUNDS, ENOUGH = 20, 1e-3  # rad: Gauss-Newton ends after few rounds, where it moves by less
HEADINGS, APART = 4, 0.5  # starts about the vertical; attitudes further apart than that [rad] are two
DOUBT = 1e-3  # likelihood ratio of a second attitude from which on the heading counts as unknown
UNKNOWN = np.pi / np.sqrt(3.0)  # rad, 1-sigma of an angle that nothing shows: uniform over the circle


@dataclass(frozen=True)
class Field:
    """The mean field that the compass sees in the first body axes, that of the place, and the errors of both.

    Attributes
    ----------
    m_b, m_n : (3,)
    variance : of the mean reading, an axis
    errors : name and (3, 3) covariance of the states that add to the reading
    of_place : (3, 3) covariance of m_n, where it is a state
    """

    m_b: FloatArray
    m_n: FloatArray
    variance: float
    errors: tuple[tuple[str, FloatArray], ...]
    of_place: FloatArray | None


@dataclass(frozen=True)
class _Pairs:
    """Vectors of both frames, and what the errors add to those of the body: `columns` name -> (n, 3, size), cov."""

    body: FloatArray
    nav: FloatArray
    columns: dict[str, tuple[FloatArray, FloatArray]]


def align_in_motion(
    recording: Recording, model: FlightModel, field: Field | None
) -> tuple[FloatArray, FloatArray, dict[str, FloatArray]] | None:
    """q_nb at the first instant, its covariance (3, 3), and that with the states; None: fewer than `LEAST` velocities.

        e = s_b - C' s_n = [s_b]x dtheta_b + A (b_accel, b_gyro, lateness, b_mag, ...) + n

    by generalised least squares, C from Wahba's problem first. The noise of the velocities is as large as their
    residual says, at least as declared.

    Scales and lateness have priors. Neglects accel.misalignment, gps.lever_arm.
    """
    pairs = _velocity_pairs(recording, model)
    if pairs is None:
        return None
    n, variance = len(pairs.body), float(model.sensors["gps"].R[3, 3])
    body, nav = pairs.body, pairs.nav
    spread = [np.sum((c @ P) * c) / (3.0 * n) for c, P in pairs.columns.values()]
    weights = np.full(n, 1.0 / (variance + sum(spread)))
    if field is not None:
        body, nav = np.concatenate([body, field.m_b[None]]), np.concatenate([nav, field.m_n[None]])
        wrong = (*(P for _, P in field.errors), *(() if field.of_place is None else (field.of_place,)))
        weights = np.append(weights, 1.0 / (field.variance + sum(float(np.trace(P)) / 3.0 for P in wrong)))
    first = wahba(body, nav, weights)
    turns = quaternion_exp(np.outer(np.arange(HEADINGS) * 2.0 * np.pi / HEADINGS, [0.0, 0.0, 1.0]))
    errors = _errors(pairs, field)
    fits = [_fitted(errors, field, body, nav, variance, quaternion_multiply(turn, first)) for turn in turns]
    best = min(fits, key=lambda fit: fit.surprise)
    P = best.P
    for other in fits:
        apart = quaternion_log(quaternion_multiply(quaternion_conjugate(best.q), other.q))
        if np.linalg.norm(apart) > APART and other.surprise - best.surprise < -2.0 * np.log(DOUBT):
            down = rotate_back(best.q, np.array([0.0, 0.0, 1.0]))
            P = best.P + UNKNOWN**2 * np.outer(down, down)
    return best.q, P, best.beside


@dataclass(frozen=True)
class _Fit:
    """An attitude at which the squares are least, their -2 log likelihood, and the covariances."""

    q: FloatArray
    P: FloatArray
    beside: dict[str, FloatArray]
    surprise: float


def _fitted(
    errors: _Errors, field: Field | None, body: FloatArray, nav: FloatArray, declared: float, q: FloatArray
) -> _Fit:
    """Gauss-Newton from q; the variance of the velocities is at least as declared."""
    variance, J = declared, skew(body).reshape(-1, 3)
    prior = errors.covariance
    for _ in range(ROUNDS):
        A = errors.added(q)
        noise = np.full(3 * len(body), variance)
        if field is not None:
            noise[-3:] = field.variance
        M = np.diag(noise) + A @ prior @ A.T
        e = (body - rotate_back(q, nav)).ravel()
        weighed = np.linalg.solve(M, np.column_stack([J, e]))
        P = np.linalg.inv(J.T @ weighed[:, :3] + np.eye(3) / UNKNOWN**2)
        dtheta, K = P @ J.T @ weighed[:, 3], P @ weighed[:, :3].T
        left = e - J @ dtheta
        square = float(left @ np.linalg.solve(M, left))
        surprise = square + float(np.linalg.slogdet(M)[1])
        variance = max(variance * square / max(len(e) - 6, 1), declared)
        q = quaternion_multiply(q, quaternion_exp(dtheta))
        if np.linalg.norm(dtheta) < ENOUGH:
            break
    return _Fit(q, P, _beside(-K @ A @ prior, errors.names), surprise)


def _beside(covariance: FloatArray, names: list[tuple[str, int]]) -> dict[str, FloatArray]:
    """(3, size) parts of a covariance (3, n), by name."""
    ends = np.cumsum([size for _, size in names])
    return {name: covariance[:, end - size : end] for (name, size), end in zip(names, ends, strict=True)}


def wahba(body: FloatArray, nav: FloatArray, weights: FloatArray) -> FloatArray:
    """q_nb that turns vectors of the body (n, 3) as nearly as it can to those of NED (n, 3), squares weighted (n,).

    Source: F. L. Markley, J. Astronaut. Sci. 36(3), 1988 (singular values).
    """
    U, _, V_t = np.linalg.svd((weights[:, None] * nav).T @ body)
    U[:, 2] *= np.linalg.det(U) * np.linalg.det(V_t)
    return quaternion_from_matrix(U @ V_t)


@dataclass(frozen=True)
class _Errors:
    """Names and sizes of the errors, what they add to all pairs (3 n, size), and their covariance.

    Those of a field that is a state come last; what they add is open, as it turns with the attitude.
    """

    names: list[tuple[str, int]]
    columns: FloatArray
    covariance: FloatArray
    field_turns: bool

    def added(self, q: FloatArray) -> FloatArray:
        """(3 n, size) at an attitude."""
        if not self.field_turns:
            return self.columns
        columns = self.columns.copy()
        columns[-3:, -3:] = -rotate_back(q, np.eye(3)).T
        return columns


def _errors(pairs: _Pairs, field: Field | None) -> _Errors:
    """Of all pairs."""
    columns = [(name, c.reshape(-1, c.shape[2]), P) for name, (c, P) in pairs.columns.items()]
    if field is not None:
        columns = [(name, np.concatenate([c, np.zeros((3, c.shape[1]))]), P) for name, c, P in columns]
        above = np.zeros((pairs.body.size, 3))
        columns += [(name, np.concatenate([above, np.eye(3)]), P) for name, P in field.errors]
        if field.of_place is not None:
            columns.append(("field", np.concatenate([above, np.zeros((3, 3))]), field.of_place))
    A = np.concatenate([c for _, c, _ in columns], axis=1)
    names = [(name, c.shape[1]) for name, c, _ in columns]
    turns = field is not None and field.of_place is not None
    return _Errors(names, A, block_diag(*(P for _, _, P in columns)), turns)


def _velocity_pairs(recording: Recording, model: FlightModel) -> _Pairs | None:
    """The pairs of force and velocity over the first `SECONDS`, less their means; None: too few velocities."""
    if "gps" not in model.sensors or not recording.streams["gps"].has(VELOCITY):
        return None
    imu, gps = recording.streams["imu"], recording.streams["gps"]
    window = imu.t <= imu.t[0] + SECONDS
    t = imu.t[window]
    near = (gps.t >= t[0]) & (gps.t <= t[-1])
    if np.count_nonzero(near) < LEAST:
        return None
    f_b, w = imu.array(ACCEL)[window], imu.array(GYRO)[window]
    turn = turned_since_start(t, w)
    f = rotate(turn, f_b)
    turned = np.stack([rotate(turn, axis) for axis in np.eye(3)], axis=-1)  # (n, 3, 3), of a bias to the first axes
    sums = {
        "b_accel": _integral(t, turned),
        "b_gyro": -_integral(t, skew(f) @ _integral(t, turned)),
        "accel.scale": _integral(t, turned * f_b[:, None, :]),
        "gyro.scale": -_integral(t, skew(f) @ _integral(t, turned * w[:, None, :])),
    }
    at = {name: _at(gps.t[near], t, total) for name, total in sums.items()}
    at["late"] = _at(gps.t[near], t, f)[..., None]  # v(t) = v(t_k - late): the sum is by f late too large
    S = _at(gps.t[near], t, _integral(t, f))
    v = gps.array(VELOCITY)[near] - (gps.t[near, None] - t[0]) * model.g_n
    spread = {"b_accel": model.accel.bias_std**2, "b_gyro": model.gyro.bias_std**2, "late": LATE**2}
    spread |= {"accel.scale": SCALE**2, "gyro.scale": SCALE**2}
    columns = {name: (c - c.mean(axis=0), spread[name] * np.eye(c.shape[2])) for name, c in at.items()}
    return _Pairs(S - S.mean(axis=0), v - v.mean(axis=0), columns)


def _integral(t: FloatArray, values: FloatArray) -> FloatArray:
    """(n, ...) integral from the first instant to each, by trapezia."""
    total = np.zeros_like(values)
    h = np.diff(t).reshape(-1, *(1,) * (values.ndim - 1))
    total[1:] = np.cumsum(0.5 * h * (values[1:] + values[:-1]), axis=0)
    return total


def _at(instants: FloatArray, t: FloatArray, values: FloatArray) -> FloatArray:
    """Values (n, ...) between the instants t at others, linear."""
    i = np.clip(np.searchsorted(t, instants, side="right") - 1, 0, len(t) - 2)
    share = ((instants - t[i]) / (t[i + 1] - t[i])).reshape(-1, *(1,) * (values.ndim - 1))
    return np.asarray((1.0 - share) * values[i] + share * values[i + 1])
