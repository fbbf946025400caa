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

from sinan.estimator.filter.flight import Flight
from sinan.sensors.arrays import FloatArray, integral
from sinan.sensors.recording import ACCEL, GYRO, VELOCITY
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

#: Seconds that are looked at, the least that have three velocities of a GPS at 1 Hz: (3 - 1) * 1 s, and up to 1 s
#: before the first. A rate off by 0.01 rad/s turns by 0.01 * 3 = 0.03 rad meanwhile.
SECONDS = 3.0
LEAST = 3  # velocities: 3 - 1 = 2 differences, of which two directions are enough
#: 1-sigma of the lateness of a GPS that nobody told [s]: autopilots take 0.11 (EKF2_GPS_DELAY of PX4) to 0.22 of a
#: u-blox (`AP_GPS_UBLOX::get_lag` of ArduPilot).
LATE = 0.1
#: 1-sigma of the scales of accelerometer and gyroscope: a choice, a third of the 3 % that data sheets promise; half and
#: twice move the first attitude of flights that begin in the air by 0.35 of its sigma (`bounds_of_work moving`).
SCALE = 0.01
ROUNDS, ENOUGH = 20, 1e-3  # and [rad] where Gauss-Newton ends: bound of work (`bounds_of_work moving`)
#: Starts about the vertical; attitudes further apart than that are two [rad]: bound of work (`bounds_of_work moving`).
HEADINGS, APART = 4, 0.5
#: Likelihood ratio of a second attitude from which on the heading counts as unknown: before the readings both are as
#: likely, so that the one that is left out is the right one once in a thousand: stated risk.
DOUBT = 1e-3
UNKNOWN = np.pi / np.sqrt(3.0)  # rad, 1-sigma of an angle that nothing shows: of +-a, uniform, sigma = a / sqrt(3)


@dataclass(frozen=True)
class Field:
    """The mean field that the compass sees in the first body axes, that of the place, and the errors of both.

    Attributes
    ----------
    m_b, m_n : (3,)
    variance : of the mean reading, an axis
    errors : name, (3, 3) what it adds to the reading and (3, 3) covariance of each state that does
    of_place : (3, 3) covariance of m_n, where it is a state
    """

    m_b: FloatArray
    m_n: FloatArray
    variance: float
    errors: tuple[tuple[str, FloatArray, FloatArray], ...]
    of_place: FloatArray | None

    @property
    def wrong(self) -> list[FloatArray]:
        """(3, 3) covariance of what each of those states adds to the reading."""
        return [A @ P @ A.T for _, A, P in self.errors]


@dataclass(frozen=True)
class _Pairs:
    """Vectors of both frames, and what the errors add to those of the body: `columns` name -> (n, 3, size), cov."""

    body: FloatArray
    nav: FloatArray
    columns: dict[str, tuple[FloatArray, FloatArray]]


def align_in_motion(flight: Flight, field: Field | None) -> tuple[FloatArray, FloatArray, dict[str, FloatArray]] | None:
    """q_nb at the first instant, its covariance (3, 3), and that with the states; None: fewer than `LEAST` velocities.

        e = s_b - C' s_n = [s_b]x dtheta_b + A (b_accel, b_gyro, lateness, b_mag, s_mag, ...) + n

    by least squares in the angles and the errors, C from Wahba's problem first. The noise of the velocities is as large
    as their residual says, at least as declared.

    Scales and lateness have priors. Neglects accel.misalignment, gps.lever_arm.
    """
    pairs = _velocity_pairs(flight)
    if pairs is None:
        return None
    n, variance = len(pairs.body), float(flight.model.sensors["gps"].R[3, 3])
    body, nav = pairs.body, pairs.nav
    spread = [np.sum((c @ P) * c) / (3.0 * n) for c, P in pairs.columns.values()]
    weights = np.full(n, 1.0 / (variance + sum(spread)))
    if field is not None:
        body, nav = np.concatenate([body, field.m_b[None]]), np.concatenate([nav, field.m_n[None]])
        wrong = (*field.wrong, *(() if field.of_place is None else (field.of_place,)))
        weights = np.append(weights, 1.0 / (field.variance + sum(float(np.trace(P)) / 3.0 for P in wrong)))
    first = wahba(body, nav, weights)
    turns = quaternion_exp(np.outer(np.arange(HEADINGS) * 2.0 * np.pi / HEADINGS, [0.0, 0.0, 1.0]))
    fits = _fitted(_errors(pairs, field), field, body, nav, variance, quaternion_multiply(turns, first))
    best = min(fits, key=lambda fit: fit.surprise)
    P = best.P
    for other in fits:
        apart = quaternion_log(quaternion_multiply(quaternion_conjugate(best.q), other.q))
        if np.linalg.norm(apart) > APART and other.surprise - best.surprise < -2.0 * np.log(DOUBT):
            down = rotate_back(best.q, np.array([0.0, 0.0, 1.0]))
            P = best.P + UNKNOWN**2 * np.outer(down, down)
    return best.q, P, best.cross_covariances


@dataclass(frozen=True)
class _Fit:
    """An attitude at which the squares are least, their -2 log likelihood, and the covariances."""

    q: FloatArray
    P: FloatArray
    cross_covariances: dict[str, FloatArray]
    surprise: float


def _fitted(
    errors: _Errors, field: Field | None, body: FloatArray, nav: FloatArray, declared: float, starts: FloatArray
) -> list[_Fit]:
    """Gauss-Newton from each of the starts (h, 4), in the angles and the errors at once; the variance of the velocities
    is at least as declared.
    """
    q, moving = starts.copy(), np.arange(len(starts))
    J, n, size = skew(body).reshape(-1, 3), len(body), 3 + errors.columns.shape[1]
    variance, surprise = np.full(len(starts), declared), np.zeros(len(starts))
    covariance = np.zeros((len(starts), size, size))
    prior = np.diag(np.append(np.full(3, UNKNOWN**-2), np.ones(size - 3)))
    for _ in range(ROUNDS):
        H = np.broadcast_to(np.hstack([J, errors.columns]), (len(moving), 3 * n, size)).copy()
        noise = np.repeat(variance[moving, None], 3 * n, axis=1)
        if field is not None:
            noise[:, -3:] = field.variance
        if errors.field is not None:
            H[:, -3:, -3:] = -_to_body(q[moving]) @ errors.field
        weighed = H / noise[..., None]
        N = np.swapaxes(weighed, 1, 2) @ H + prior
        e = (body - rotate_back(q[moving, None], nav)).reshape(len(moving), -1)
        covariance[moving] = np.linalg.inv(N)
        step = (covariance[moving] @ (np.swapaxes(weighed, 1, 2) @ e[..., None]))[..., 0]
        left = e - (H @ step[..., None])[..., 0]
        square = np.sum(left**2 / noise, axis=1) + np.sum(step[:, 3:] ** 2, axis=1)
        surprise[moving] = square + np.sum(np.log(noise), axis=1) + np.linalg.slogdet(N[:, 3:, 3:])[1]
        variance[moving] = np.maximum(variance[moving] * square / max(3 * n - 6, 1), declared)
        q[moving] = quaternion_multiply(q[moving], quaternion_exp(step[:, :3]))
        moving = moving[np.linalg.norm(step[:, :3], axis=1) >= ENOUGH]
        if not len(moving):
            break
    crosswise = covariance[:, :3, 3:] @ errors.roots.T
    each = zip(q, covariance[:, :3, :3], crosswise, surprise.tolist(), strict=True)
    return [_Fit(q, P, _by_name(of_errors, errors.names), value) for q, P, of_errors, value in each]


def _to_body(q: FloatArray) -> FloatArray:
    """(h, 3, 3) C_nb' of attitudes (h, 4)."""
    return np.swapaxes(rotate_back(q[:, None], np.eye(3)), 1, 2)


def _by_name(covariance: FloatArray, names: list[tuple[str, int]]) -> dict[str, FloatArray]:
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
    """Names and sizes of the errors, and what they add to all pairs (3 n, size), each in its own sigmas.

    Those of a field that is a state come last; what they add turns with the attitude.

    Attributes
    ----------
    roots : (size, size) errors from their sigmas: the root of their covariance
    field : (3, 3) that of the field; None: it is no state
    """

    names: list[tuple[str, int]]
    columns: FloatArray
    roots: FloatArray
    field: FloatArray | None


def _errors(pairs: _Pairs, field: Field | None) -> _Errors:
    """Of all pairs."""
    columns = [(name, c.reshape(-1, c.shape[2]), P) for name, (c, P) in pairs.columns.items()]
    is_state = field is not None and field.of_place is not None
    if field is not None:
        columns = [(name, np.concatenate([c, np.zeros((3, c.shape[1]))]), P) for name, c, P in columns]
        above = np.zeros((pairs.body.size, 3))
        columns += [(name, np.concatenate([above, A]), P) for name, A, P in field.errors]
        if field.of_place is not None:
            columns.append(("field", np.concatenate([above, np.zeros((3, 3))]), field.of_place))
    roots = block_diag(*(_root(P) for _, _, P in columns))
    A = np.concatenate([c for _, c, _ in columns], axis=1) @ roots
    return _Errors([(name, c.shape[1]) for name, c, _ in columns], A, roots, roots[-3:, -3:] if is_state else None)


def _root(P: FloatArray) -> FloatArray:
    """L of P = L L', which may be singular."""
    values, vectors = np.linalg.eigh(P)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _velocity_pairs(flight: Flight) -> _Pairs | None:
    """The pairs of force and velocity over the first `SECONDS`, less their means; None: too few velocities."""
    recording, model = flight.recording, flight.model
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
        "b_accel": integral(t, turned),
        "b_gyro": -integral(t, skew(f) @ integral(t, turned)),
        "accel.scale": integral(t, turned * f_b[:, None, :]),
        "gyro.scale": -integral(t, skew(f) @ integral(t, turned * w[:, None, :])),
    }
    at = {name: _at(gps.t[near], t, total) for name, total in sums.items()}
    at["late"] = _at(gps.t[near], t, f)[..., None]  # v(t) = v(t_k - late): the sum is by f late too large
    S = _at(gps.t[near], t, integral(t, f))
    v = gps.array(VELOCITY)[near] - (gps.t[near, None] - t[0]) * model.g_n
    spread = {"b_accel": model.accel.bias_std**2, "b_gyro": model.gyro.bias_std**2, "late": LATE**2}
    spread |= {"accel.scale": SCALE**2, "gyro.scale": SCALE**2}
    columns = {name: (c - c.mean(axis=0), spread[name] * np.eye(c.shape[2])) for name, c in at.items()}
    return _Pairs(S - S.mean(axis=0), v - v.mean(axis=0), columns)


def _at(instants: FloatArray, t: FloatArray, values: FloatArray) -> FloatArray:
    """Values (n, ...) between the instants t at others, linear."""
    i = np.clip(np.searchsorted(t, instants, side="right") - 1, 0, len(t) - 2)
    share = ((instants - t[i]) / (t[i + 1] - t[i])).reshape(-1, *(1,) * (values.ndim - 1))
    return np.asarray((1.0 - share) * values[i] + share * values[i + 1])
