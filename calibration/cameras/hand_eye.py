"""How a camera is mounted on the body: from poses of both, and from the gyroscope's rates with the camera's lateness.

A target that stands still gives the camera's pose in each picture, P_c = R X + T (`calibration.cameras.camera`). C_bc
turns camera axes into the body's, l_b is the camera's centre in the body, both as in `sensors.camera.Camera`.

Source: from poses R. Y. Tsai, R. K. Lenz, IEEE Trans. Robotics and Automation 5(3), 1989 (the equation A X = X B, here
as least squares over the poses themselves); from rates M. Li, A. I. Mourikis, Int. J. Robotics Research 33(7), 2014
(the time offset as an unknown).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from sinan.calibration.cameras.camera import Pose
from sinan.calibration.poses.least_squares import covariance_of, undetermined_directions
from sinan.sensors.arrays import FloatArray, integral
from sinan.sensors.errors import InputError
from sinan.sensors.rotation import (
    matrix_from_quaternion,
    quaternion_conjugate,
    quaternion_from_matrix,
    quaternion_interpolate,
    quaternion_log,
    quaternion_multiply,
    right_jacobian,
    rotate,
    rotation_exp,
    skew,
    turned_since_start,
)

X = TypeVar("X")
#: Rotation of the camera, its lateness [s] and the gyroscope's bias [rad/s].
_Rates = tuple[FloatArray, float, FloatArray]

#: Rounds of Gauss-Newton from a closed form at most, and the step at which it ends: bound of work (`bounds_of_work
#: mounting`).
_ROUNDS, _SETTLED = 20, 1e-10
#: Lateness that is searched for at the start [s], ten times the some 30 ms of USB cameras: bound of work
#: (`bounds_of_work mounting`). Twice leaves out pictures at either end, by which numbers move by 0.1 of their sigma.
REACH = 0.3
#: Plausible sizes, which bring the columns to like sizes before null directions are judged: rotation [rad], arm and
#: place [m], delay [s], bias [rad/s]: bound of work (`bounds_of_work mounting`).
_TURN, _ARM, _DELAY, _BIAS = 0.1, 0.1, 0.03, 0.02


@dataclass(frozen=True)
class Mounting:
    """How the camera sits on the body.

    Attributes
    ----------
    C_bc : (3, 3) camera -> body
    l_b : (3,) the camera's centre in the body [m]; NaN where the body's place is not known
    delay : how late the camera's stamps are [s], a picture belongs to t - delay; NaN from poses
    names : of the parameters: rotation of C_bc about the camera's axes, then what else was found
    covariance : (parameters, parameters)
    undetermined : a sentence for each direction that the data leave open
    sigma : by what it is of, the noise that was found: rotation [rad], place [m], rate [rad/s/sqrt(Hz)]
    values : (parameters - 3,) what else was found, in the order of `names`
    """

    C_bc: FloatArray
    l_b: FloatArray
    delay: float
    names: tuple[str, ...]
    covariance: FloatArray
    undetermined: tuple[str, ...]
    sigma: dict[str, float]
    values: FloatArray

    @property
    def std(self) -> FloatArray:
        """(parameters,) 1-sigma."""
        return np.sqrt(np.diag(self.covariance))


def rotation_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """(3, 3) C with a = C b in the least-squares sense, of vectors (n, 3): Wahba's problem by singular values.

    Source: F. L. Markley, J. Astronautical Sciences 36(3), 1988.
    """
    U, _, Vt = np.linalg.svd(a.T @ b)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)]) @ Vt)


def from_poses(q_nb: FloatArray, seen: Sequence[Pose], p_n: FloatArray | None = None) -> Mounting:
    """The mounting from poses of the body and of the target in the camera at the same instants.

    R_i = C_cb C_bn C_nt,  T_i = C_cb (C_bn (p_t - p_i) - l_b); unknown are C_bc, C_nt and, with places, l_b, p_t

    Parameters
    ----------
    q_nb : (n, 4) attitude of the body
    seen : (n) the target in the camera
    p_n : (n, 3) place of the body [m]; None: the rotation alone

    Raises
    ------
    InputError : fewer than three poses, or of another number than the pictures
    """
    n = len(seen)
    if n < 3 or len(q_nb) != n or (p_n is not None and len(p_n) != n):
        raise InputError("hand-eye", f"{len(q_nb)} poses of the body, {n} of the camera", "three or more of both alike")
    R, T = np.array([pose.R for pose in seen]), np.array([pose.T for pose in seen])
    poses = _Poses(matrix_from_quaternion(q_nb), p_n, R, T)
    unknowns, sizes = poses.closed_form(), poses.unit_sizes()
    for _ in range(3):  # noise of rotation and place, each from its own residual; the third time they stand still
        unknowns = poses.settled(unknowns, sizes)
        sizes = poses.sizes_left(unknowns, sizes)
    _, J = poses.parts(unknowns, sizes)
    names = (*(f"rotation {a}" for a in "xyz"), *(f"target rotation {a}" for a in "xyz"))
    plausible, values, arm = np.full(6, _TURN), _log(unknowns.C_nt), np.full(3, np.nan)
    if p_n is not None:
        names = (*names, *(f"lever arm {a}" for a in "xyz"), *(f"target {a}" for a in ("north", "east", "down")))
        plausible = np.append(plausible, np.full(6, _ARM))
        values, arm = np.concatenate([values, unknowns.l_b, unknowns.p_t]), unknowns.l_b
    _, sentences, _ = undetermined_directions(J, names, plausible)
    covariance = covariance_of(J, plausible, 1.0)
    return Mounting(unknowns.C_bc, arm, np.nan, names, covariance, sentences, sizes, values)


@dataclass(frozen=True)
class _Unknowns:
    """Of `from_poses`: camera -> body, target -> NED, the camera in the body [m], and the target in NED [m]."""

    C_bc: FloatArray
    C_nt: FloatArray
    l_b: FloatArray
    p_t: FloatArray

    def moved(self, step: FloatArray) -> _Unknowns:
        """By turns of C_bc and C_nt about their own axes and, in a step (12,), by l_b and p_t."""
        C_bc, C_nt = self.C_bc @ rotation_exp(step[:3]), self.C_nt @ rotation_exp(step[3:6])
        if len(step) == 6:
            return _Unknowns(C_bc, C_nt, self.l_b, self.p_t)
        return _Unknowns(C_bc, C_nt, self.l_b + step[6:9], self.p_t + step[9:12])


@dataclass(frozen=True)
class _Poses:
    """(n) poses of the body, C_nb (n, 3, 3) and p_n (n, 3) [m] or None, and of the target in the camera, R and T."""

    C_nb: FloatArray
    p_n: FloatArray | None
    R: FloatArray
    T: FloatArray

    def closed_form(self) -> _Unknowns:
        """C_bc from all turns between two poses, then what is linear: p_t - C_nb l_b = p_n + C_nb C_bc T."""
        n = len(self.R)
        i, j = np.transpose([(i, j) for i in range(n) for j in range(i + 1, n)])
        C_bc = rotation_between(_log(_t(self.C_nb[i]) @ self.C_nb[j]), _log(self.R[i] @ _t(self.R[j])))
        C_nt = self.C_nb[0] @ C_bc @ self.R[0]
        if self.p_n is None:
            return _Unknowns(C_bc, C_nt, np.zeros(3), np.zeros(3))
        left = np.concatenate([np.broadcast_to(np.eye(3), self.C_nb.shape), -self.C_nb], axis=2).reshape(-1, 6)
        right = (self.p_n + np.einsum("nij,nj->ni", self.C_nb @ C_bc, self.T)).ravel()
        solution = np.linalg.lstsq(left, right, rcond=None)[0]
        return _Unknowns(C_bc, C_nt, solution[3:], solution[:3])

    def unit_sizes(self) -> dict[str, float]:
        """The noise before it is known: 1 rad and, with places, 1 m."""
        return {"rotation": 1.0} if self.p_n is None else {"rotation": 1.0, "place": 1.0}

    def parts(self, x: _Unknowns, sizes: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """Residual and Jacobian by the turns of C_bc and C_nt about their own axes, l_b and p_t; both weighted."""
        C_cn = _t(self.C_nb @ x.C_bc)
        R_pred = C_cn @ x.C_nt
        e = _log(_t(self.R) @ R_pred)
        back = np.linalg.inv(right_jacobian(e))
        zero = np.zeros_like(self.C_nb)
        J_R = np.concatenate([-back @ _t(R_pred), back, zero, zero], axis=2) / sizes["rotation"]
        r = (e / sizes["rotation"]).reshape(-1)
        if self.p_n is None:
            return r, J_R[:, :, :6].reshape(-1, 6)
        T_pred = np.einsum("nij,nj->ni", C_cn, x.p_t - self.p_n) - x.C_bc.T @ x.l_b
        by_arm = np.broadcast_to(-x.C_bc.T, zero.shape)
        J_T = np.concatenate([skew(T_pred), zero, by_arm, C_cn], axis=2) / sizes["place"]
        r = np.concatenate([r, ((T_pred - self.T) / sizes["place"]).ravel()])
        return r, np.concatenate([J_R.reshape(-1, 12), J_T.reshape(-1, 12)])

    def settled(self, x: _Unknowns, sizes: Mapping[str, float]) -> _Unknowns:
        """At which the weighted squares are least."""
        return _settled(x, lambda x: self.parts(x, sizes), _Unknowns.moved)

    def sizes_left(self, x: _Unknowns, sizes: Mapping[str, float]) -> dict[str, float]:
        """The noise of rotation and of place by what is left of each."""
        r, J = self.parts(x, sizes)
        dof = 1.0 - J.shape[1] / len(r)  # share of the residuals that is left to each
        own = np.split(r, [3 * len(self.R)])
        return {
            name: size * (float(np.sqrt(np.mean(part**2) / dof)) or 1.0)
            for (name, size), part in zip(sizes.items(), own, strict=False)
        }


def _log(C: FloatArray) -> FloatArray:
    """Rotation vectors of matrices (..., 3, 3)."""
    return quaternion_log(quaternion_from_matrix(C))


def _t(C: FloatArray) -> FloatArray:
    """Transposed matrices (n, 3, 3)."""
    return np.swapaxes(C, -1, -2)


@dataclass(frozen=True)
class _Turning:
    """A body turned by its gyroscope's rates less a bias: attitude since the start, and how it follows the bias.

    Attributes
    ----------
    t : (n,) s
    w : (n, 3) rate without bias [rad/s]
    q : (n, 4) attitude relative to the first instant
    D : (n, 3, 3) integral of the rotation matrix: d phi(t) = -R(t)' D(t) d bias, in the axes at t
    """

    t: FloatArray
    w: FloatArray
    q: FloatArray
    D: FloatArray

    @staticmethod
    def of(t: FloatArray, w_meas: FloatArray, bias: FloatArray) -> _Turning:
        w = w_meas - bias
        q = turned_since_start(t, w)
        return _Turning(t, w, q, integral(t, matrix_from_quaternion(q)))

    def at(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Attitude (m, 4), rate (m, 3) of the interpolated attitude, and D (m, 3, 3)."""
        i = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        span = self.t[i + 1] - self.t[i]
        step = quaternion_log(quaternion_multiply(quaternion_conjugate(self.q[i]), self.q[i + 1]))
        share = ((t - self.t[i]) / span)[:, None, None]
        D = (1.0 - share) * self.D[i] + share * self.D[i + 1]
        return quaternion_interpolate(t, self.t, self.q), step / span[:, None], D


def turns_between(turning: _Turning, t: FloatArray, delay: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rotation vectors of the body between pictures, and their slopes by delay and bias.

    Q = R(a)' R(b), a = t_j - delay, b = t_(j+1) - delay;  g = Log Q
    d g / d delay = J_r^-1 (Q' w_a - w_b),  d g / d bias = -J_r^-1 R_b' (D_b - D_a)

    Returns
    -------
    (m - 1, 3) rad, (m - 1, 3) rad/s, (m - 1, 3, 3) s
    """
    q, w, D = turning.at(t - delay)
    Q = quaternion_multiply(quaternion_conjugate(q[:-1]), q[1:])
    g = quaternion_log(Q)
    back = np.linalg.inv(right_jacobian(g))
    by_delay = np.einsum("nij,nj->ni", back, rotate(quaternion_conjugate(Q), w[:-1]) - w[1:])
    R_b = matrix_from_quaternion(q[1:])
    return g, by_delay, -back @ _t(R_b) @ np.diff(D, axis=0)


def from_rates(
    t: FloatArray, w_b: FloatArray, t_seen: FloatArray, seen: Sequence[Pose], reach: float = REACH
) -> Mounting:
    """Rotation and lateness of the camera from a gyroscope that turned with it, and the gyroscope's bias.

    Between two pictures: Log(R_j R_(j+1)') = C_cb g_j. A picture's noise enters the turn before it and the one after it
    with opposite signs, the rate's white noise grows with the time between: both sizes are found from the residuals.

    Parameters
    ----------
    t, w_b : (n,) s, (n, 3) rad/s, of the gyroscope
    t_seen, seen : (m,) s stamps of the pictures, and the target in the camera
    reach : largest lateness, either way, that is looked for [s]

    Raises
    ------
    InputError : too few pictures within the gyroscope's log, or of another number than the stamps
    """
    if len(t_seen) != len(seen) or np.any(np.diff(t_seen) <= 0.0):
        raise InputError("hand-eye", f"{len(t_seen)} stamps of {len(seen)} pictures", "one stamp each, in order")
    inside = (t_seen - reach >= t[0]) & (t_seen + reach <= t[-1])
    if np.sum(inside) < 8:
        there = f"{int(np.sum(inside))} pictures within the gyroscope's log less {reach:g} s at its ends"
        raise InputError("hand-eye", there, "eight or more, while it is turned about several axes")
    t_seen = t_seen[inside]
    q_tc = quaternion_from_matrix(np.array([pose.R.T for pose, keep in zip(seen, inside, strict=True) if keep]))
    turned = quaternion_log(quaternion_multiply(quaternion_conjugate(q_tc[:-1]), q_tc[1:]))
    between = np.diff(t_seen)
    C_bc, delay = _start(_Turning.of(t, w_b, np.zeros(3)), t_seen, turned, reach)
    bias, sigma, density = np.zeros(3), 1.0, 0.0

    def whiten(rows: FloatArray) -> FloatArray:
        return _white(sigma, density, between, rows.reshape(len(between), -1))[0].reshape(rows.shape)

    def parts(x: _Rates) -> tuple[FloatArray, FloatArray]:
        r, J = _rate_parts(_Turning.of(t, w_b, x[2]), t_seen, turned, *x[:2])
        return whiten(r), whiten(J)

    def moved(x: _Rates, step: FloatArray) -> _Rates:
        if abs(x[1] + step[3]) > reach:
            raise InputError("hand-eye", f"a lateness beyond {reach:g} s", "quicker turns, or nearer stamps")
        return x[0] @ rotation_exp(step[:3]), float(x[1] + step[3]), x[2] + step[4:]

    for _ in range(3):
        C_bc, delay, bias = _settled((C_bc, delay, bias), parts, moved)
        r, J = _rate_parts(_Turning.of(t, w_b, bias), t_seen, turned, C_bc, delay)
        sigma, density = _noise(r.reshape(-1, 3), between)
    names = (*(f"rotation {a}" for a in "xyz"), "delay", *(f"gyro bias {a}" for a in "xyz"))
    plausible = np.array([_TURN] * 3 + [_DELAY] + [_BIAS] * 3)
    white = whiten(J)
    _, sentences, _ = undetermined_directions(white, names, plausible)
    found = {"rotation": sigma, "rate": density}
    values = np.append(delay, bias)
    covariance = covariance_of(white, plausible, 1.0)
    return Mounting(C_bc, np.full(3, np.nan), delay, names, covariance, sentences, found, values)


def _settled(x: X, parts: Callable[[X], tuple[FloatArray, FloatArray]], moved: Callable[[X, FloatArray], X]) -> X:
    """Gauss-Newton until the step is nothing; `parts` gives the residual and its Jacobian."""
    for _ in range(_ROUNDS):
        r, J = parts(x)
        step = np.asarray(-np.linalg.lstsq(J, r, rcond=None)[0], dtype=np.float64)
        x = moved(x, step)
        if np.linalg.norm(step) < _SETTLED:
            break
    return x


def _rate_parts(
    turning: _Turning, t_seen: FloatArray, turned: FloatArray, C_bc: FloatArray, delay: float
) -> tuple[FloatArray, FloatArray]:
    """Residual (3 m,) turned - C_cb g, and its Jacobian by the turn of C_bc, delay and bias: -[C_cb g]x, -C_cb dg."""
    g, by_delay, by_bias = turns_between(turning, t_seen, delay)
    g_c = g @ C_bc
    J = np.concatenate([-skew(g_c), -(by_delay @ C_bc)[:, :, None], -C_bc.T @ by_bias], axis=2)
    return (turned - g_c).ravel(), J.reshape(-1, 7)


def _start(turning: _Turning, t_seen: FloatArray, turned: FloatArray, reach: float) -> tuple[FloatArray, float]:
    """The lateness of a grid, half a picture's interval wide, at which a rotation explains the turns best."""
    step = min(0.5 * float(np.median(np.diff(t_seen))), reach / 4.0)
    best = (np.inf, np.eye(3), 0.0)
    for delay in np.arange(-reach, reach + 0.5 * step, step):
        g, _, _ = turns_between(turning, t_seen, float(delay))
        C_bc = rotation_between(g, turned)
        cost = float(np.sum((turned - g @ C_bc) ** 2))
        if cost < best[0]:
            best = (cost, C_bc, float(delay))
    return best[1], best[2]


def _noise(r: FloatArray, between: FloatArray) -> tuple[float, float]:
    """Noise of a picture's rotation [rad] and of the rate [rad/s/sqrt(Hz)] by likelihood, of residuals (m, 3).

    With their ratio given the common size is the root mean square of the whitened residuals. The ratio is sought by its
    logarithm: a rate as noisy as the pictures over anything between a millisecond and a day.
    """
    from scipy.optimize import minimize_scalar

    def size(ratio: float) -> tuple[float, float]:
        """The common size, and minus twice the logarithm of the likelihood."""
        white, log_det = _white(1.0, ratio, between, r)
        scale = float(np.sqrt(np.mean(white**2))) or np.finfo(float).tiny
        return scale, 2.0 * r.size * np.log(scale) + r.shape[1] * log_det

    least, most = np.log(1.0 / np.sqrt(86400.0)), np.log(1.0 / np.sqrt(1e-3))
    ratio = float(np.exp(minimize_scalar(lambda x: size(np.exp(x))[1], bounds=(least, most), method="bounded").x))
    scale, _ = size(ratio)
    return scale, ratio * scale


def _white(sigma: float, density: float, between: FloatArray, rows: FloatArray) -> tuple[FloatArray, float]:
    """Rows (m, k) divided by the Cholesky factor of the turns' covariance, and the logarithm of its determinant.

    The covariance is tridiagonal along the pictures: 2 sigma^2 + density^2 dt, and -sigma^2 between neighbours.
    """
    from scipy.linalg import cholesky_banded, solve_banded

    band = np.zeros((2, len(between)))
    band[0] = 2.0 * sigma**2 + density**2 * between
    band[1, :-1] = -(sigma**2)
    factor = cholesky_banded(band, lower=True)
    return np.asarray(solve_banded((1, 0), factor, rows)), 2.0 * float(np.sum(np.log(factor[0])))
