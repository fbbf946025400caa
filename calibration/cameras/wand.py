"""Several cameras from a wand that is waved before them: markers on a line, at known distances.

    residual = pixels_j(R_j (A_t + d_m u_t) + T_j) - seen;  R_0 = I, T_0 = 0

A_t and the unit vector u_t are the wand at each instant, d_m the distance of a marker from its first. The start comes
from the essential matrix of two cameras that see it together; the wand's length is the scale.

Source: L. Wang, F. Wu, Z. Hu, Multi-camera calibration with one-dimensional object under general motions, ICCV 2007;
R. Hartley, A. Zisserman, Multiple View Geometry, 2nd edition, algorithms 11.1 and result 9.19.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sinan.calibration.cameras.camera import Form
from sinan.calibration.cameras.damped import minimised
from sinan.calibration.poses.least_squares import covariance_of, undetermined_directions
from sinan.sensors.arrays import FloatArray, IntArray, as_floats
from sinan.sensors.camera import Intrinsics
from sinan.sensors.errors import InputError
from sinan.sensors.rotation import rotation_exp, skew

#: An essential matrix has 9 - 1 = 8 unknowns up to scale, so that there is no linear start from fewer common markers.
_LEAST_COMMON = 8
#: Plausible sizes, which bring turns [rad] and places [m] to like columns: a factor between them is no null direction,
#: since `least_squares._RANK_TOLERANCE` = 1e-9.
_TURN, _PLACE = 0.1, 1.0


@dataclass(frozen=True)
class WandFit:
    """Cameras in the first one's axes: P_j = R_j P_0 + T_j.

    Attributes
    ----------
    cameras : intrinsics, refined where that was asked for
    R, T : (cameras, 3, 3), (cameras, 3) [m]
    A, u : (instants, 3) first marker [m], and the wand's direction, in the first camera
    names : of the parameters: turn about the camera's axes and place of each camera but the first, intrinsics
    covariance : (parameters, parameters)
    undetermined : a sentence for each direction that the wand did not show
    rms : of each camera [pixels]
    sigma : standard deviation of one coordinate of a marker, estimated [pixels]
    """

    cameras: tuple[Intrinsics, ...]
    R: FloatArray
    T: FloatArray
    A: FloatArray
    u: FloatArray
    names: tuple[str, ...]
    covariance: FloatArray
    undetermined: tuple[str, ...]
    rms: FloatArray
    sigma: float

    @property
    def std(self) -> FloatArray:
        """(parameters,) 1-sigma."""
        return np.sqrt(np.diag(self.covariance))


def essential(a: FloatArray, b: FloatArray) -> FloatArray:
    """(3, 3) E with b' E a = 0 of directions (n, 3) in two cameras, by eight points."""
    rows = np.einsum("ni,nj->nij", b, a).reshape(len(a), 9)
    return np.asarray(np.linalg.svd(rows, full_matrices=len(rows) < 9)[2][-1].reshape(3, 3))


def relative_pose(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """R, T of length one, and the distances (n, 2) along both, of directions a, b (n, 3): s_b b = s_a R a + T.

    Of the four poses that an essential matrix allows the one with most points ahead along both directions.
    """
    U, _, Vt = np.linalg.svd(essential(a, b))
    W = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    best: tuple[int, FloatArray, FloatArray, FloatArray] | None = None
    for turn in (W, W.T):
        R = U @ turn @ Vt
        R = R * np.sign(np.linalg.det(R))
        for T in (U[:, 2], -U[:, 2]):
            s = distances(a @ R.T, b, T)
            ahead = int(np.sum(np.all(s > 0.0, axis=1)))
            if best is None or ahead > best[0]:
                best = ahead, R, T, s
    assert best is not None
    return best[1:]


def distances(a: FloatArray, b: FloatArray, T: FloatArray) -> FloatArray:
    """(n, 2) s_a, s_b of least |s_a a + T - s_b b|, for unit vectors (n, 3) in the axes of b."""
    cosine = np.sum(a * b, axis=1)
    a_T, b_T = a @ T, b @ T
    below = np.maximum(1.0 - cosine**2, np.finfo(float).tiny)
    return np.column_stack([(cosine * b_T - a_T) / below, (b_T - cosine * a_T) / below])


def calibrate_wand(
    cameras: Sequence[Intrinsics], seen: FloatArray, along: FloatArray, form: Form | None = None
) -> WandFit:
    """Where the cameras stand, and with `form` their intrinsics too.

    Parameters
    ----------
    cameras : intrinsics, from boards say; with `form` a start
    seen : (instants, cameras, markers, 2) pixels; not a number where a marker is not seen
    along : (markers,) distance of each marker from the first [m], rising from zero
    form : what of the intrinsics is found as well, the same for all cameras

    Raises
    ------
    InputError : shapes, cameras that see too little of the wand together, nothing that settles
    """
    along = as_floats("along", along, (None,), "distances of the markers from the first")
    if len(along) < 2 or along[0] != 0.0 or np.any(np.diff(along) <= 0.0):
        raise InputError("wand", f"distances {along.tolist()}", "two markers or more, from 0 upwards")
    if seen.ndim != 4 or seen.shape[1:] != (len(cameras), len(along), 2):
        raise InputError("wand", f"pixels of shape {seen.shape}", f"(instants, {len(cameras)}, {len(along)}, 2)")
    rays = np.stack([camera.rays(seen[:, j].reshape(-1, 2)) for j, camera in enumerate(cameras)], axis=1)
    R, T = _start(rays, seen.shape, along)
    A, u, kept = _wands(rays, seen.shape, along, R, T)
    state = _State(tuple(cameras), R, T, A, u)
    problem = _Problem(seen[kept], along, form)
    state = problem.minimised(state)
    return problem.result(state)


def _start(rays: FloatArray, shape: tuple[int, ...], along: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Poses of all cameras, each by way of one that is known already and that sees most of the wand with it."""
    count, ends = shape[1], [0, shape[2] - 1]
    there = np.all(np.isfinite(rays), axis=2)
    R, T, known = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)), {0}
    while len(known) < count:
        pairs = [(int(np.sum(there[:, i] & there[:, j])), i, j) for i in known for j in range(count) if j not in known]
        common, i, j = max(pairs)
        if common < _LEAST_COMMON:
            found = f"{common} markers that camera {j} sees together with another one"
            raise InputError("wand", found, f"{_LEAST_COMMON} or more")
        both = there[:, i] & there[:, j]
        R_ij, T_ij, s = relative_pose(rays[both, i], rays[both, j])
        points = np.full((len(rays), 3), np.nan)
        points[both] = s[:, :1] * rays[both, i]
        wand = points.reshape(shape[0], shape[2], 3)[:, ends]
        lengths = np.linalg.norm(wand[:, 1] - wand[:, 0], axis=1)
        if not np.any(np.isfinite(lengths)):
            raise InputError("wand", f"never both ends in cameras {i} and {j}", "the whole wand at some instant")
        scale = float(along[-1] / np.nanmedian(lengths))
        R[j], T[j] = R_ij @ R[i], R_ij @ T[i] + scale * T_ij
        known.add(j)
    return R, T


def _wands(
    rays: FloatArray, shape: tuple[int, ...], along: FloatArray, R: FloatArray, T: FloatArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    """The wand at each instant, its ends as the points nearest to all directions to them; instants that show it."""
    instants, count, markers, _ = shape
    rays = rays.reshape(instants, markers, count, 3)
    in_first = np.einsum("jki,tmjk->tmji", R, rays)
    places = -np.einsum("jki,jk->ji", R, T)
    across = np.eye(3) - np.einsum("tmji,tmjk->tmjik", in_first, in_first)
    there = np.all(np.isfinite(rays), axis=3)
    across = np.where(there[..., None, None], across, 0.0)
    normal, right = across.sum(axis=2), np.einsum("tmjik,jk->tmi", across, places)
    twice = np.sum(there, axis=2) >= 2
    points = np.full((instants, markers, 3), np.nan)
    points[twice] = np.linalg.solve(normal[twice], right[twice][..., None])[..., 0]
    kept = np.flatnonzero(np.sum(twice, axis=1) >= 2)
    A, u = np.zeros((len(kept), 3)), np.zeros((len(kept), 3))
    for n, t in enumerate(kept):
        first, last = np.flatnonzero(twice[t])[[0, -1]]
        u[n] = (points[t, last] - points[t, first]) / np.linalg.norm(points[t, last] - points[t, first])
        A[n] = points[t, first] - along[first] * u[n]
    return A, u, kept


@dataclass(frozen=True)
class _State:
    """What is sought: intrinsics and poses of the cameras, and the wand at each instant."""

    cameras: tuple[Intrinsics, ...]
    R: FloatArray
    T: FloatArray
    A: FloatArray
    u: FloatArray


def _across(u: FloatArray) -> FloatArray:
    """(3, 2) directions at right angles to a unit vector."""
    return np.asarray(np.linalg.svd(u[None, :])[2][1:].T)


@dataclass(frozen=True)
class _Problem:
    """Least squares over the instants that show the wand."""

    seen: FloatArray
    along: FloatArray
    form: Form | None

    def width(self, cameras: int) -> tuple[int, int]:
        """Number of all parameters that the cameras share out, and of the intrinsics of one."""
        own = 0 if self.form is None else len(self.form.names)
        return 6 * (cameras - 1) + own * cameras, own

    def residuals(self, state: _State) -> FloatArray:
        """(instants, cameras, markers, 2) predicted minus seen."""
        P = state.A[:, None] + self.along[:, None] * state.u[:, None]
        seen = [c.pixels(P @ R.T + T) for c, R, T in zip(state.cameras, state.R, state.T, strict=True)]
        return np.stack(seen, axis=1) - self.seen

    def cost(self, state: _State) -> float:
        """Sum of squares; infinite where a marker that was seen cannot be."""
        with np.errstate(invalid="ignore", over="ignore"):
            r = self.residuals(state)
        r = r[np.isfinite(self.seen)]
        return float(r @ r) if np.all(np.isfinite(r)) else np.inf

    def blocks(self, state: _State) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
        """Of each instant: residual, and its Jacobians by what the cameras have and by the wand (A, two of u)."""
        count = len(state.cameras)
        total, own = self.width(count)
        r = self.residuals(state)
        found = []
        for n, (A, u) in enumerate(zip(state.A, state.u, strict=True)):
            P = A + self.along[:, None] * u
            by_wand = np.concatenate(
                [np.tile(np.eye(3), (len(P), 1, 1)), self.along[:, None, None] * _across(u)], axis=2
            )
            rows_r, rows_A, rows_B = [], [], []
            for j, camera in enumerate(state.cameras):
                there = np.all(np.isfinite(self.seen[n, j]), axis=1)
                turned = P[there] @ state.R[j].T
                by_P, by_values = camera.slopes(turned + state.T[j])
                shared = np.zeros((len(turned), 2, total))
                if j > 0:
                    at = 6 * (j - 1)
                    shared[:, :, at : at + 3], shared[:, :, at + 3 : at + 6] = -by_P @ skew(turned), by_P
                if self.form is not None:
                    at = 6 * (count - 1) + own * j
                    shared[:, :, at : at + own] = by_values @ self.form.spread
                rows_r.append(r[n, j, there].ravel())
                rows_A.append(shared.reshape(-1, total))
                rows_B.append((by_P @ state.R[j] @ by_wand[there]).reshape(-1, 5))
            found.append((np.concatenate(rows_r), np.concatenate(rows_A), np.concatenate(rows_B)))
        return found

    def moved(self, state: _State, da: FloatArray, db: Sequence[FloatArray]) -> _State:
        """The state after a step."""
        count = len(state.cameras)
        _, own = self.width(count)
        R, T, cameras = state.R.copy(), state.T.copy(), list(state.cameras)
        for j in range(1, count):
            step = da[6 * (j - 1) : 6 * j]
            R[j], T[j] = rotation_exp(step[:3]) @ R[j], T[j] + step[3:]
        if self.form is not None:
            for j in range(count):
                at = 6 * (count - 1) + own * j
                cameras[j] = cameras[j].with_values(cameras[j].values + self.form.spread @ da[at : at + own])
        u = np.array([one + _across(one) @ step[3:] for one, step in zip(state.u, db, strict=True)])
        A = state.A + np.array([step[:3] for step in db])
        return _State(tuple(cameras), R, T, A, u / np.linalg.norm(u, axis=1, keepdims=True))

    def minimised(self, state: _State) -> _State:
        """Of the least squares, the wand of each instant eliminated."""
        if not np.isfinite(self.cost(state)):
            raise InputError("wand", "no start from which all markers are seen", "intrinsics of these cameras")
        return minimised(state, self.cost, self.blocks, self.moved)

    def result(self, state: _State) -> WandFit:
        """Covariance with the wand projected out."""
        count = len(state.cameras)
        total, _ = self.width(count)
        projected = []
        for _, A, B in self.blocks(state):
            Q = np.linalg.qr(B)[0]
            projected.append(A - Q @ (Q.T @ A))
        names = [f"camera {j} {what} {axis}" for j in range(1, count) for what in ("turn", "place") for axis in "xyz"]
        plausible = np.tile(np.repeat([_TURN, _PLACE], 3), count - 1)
        if self.form is not None:
            names += [f"camera {j} {name}" for j in range(count) for name in self.form.names]
            plausible = np.append(plausible, np.tile(self.form.plausible, count))
        r = self.residuals(state)
        there = np.isfinite(self.seen)
        dof = int(np.sum(there)) - total - 5 * len(state.A)
        if dof < 1:
            raise InputError("wand", f"{int(np.sum(there))} coordinates of markers", f"{1 - dof} more at least")
        sigma = float(np.sqrt(np.sum(r[there] ** 2) / dof))
        J = np.concatenate(projected)
        _, sentences, _ = undetermined_directions(J, names, plausible)
        rms = np.array([np.sqrt(2.0 * np.mean(r[:, j][there[:, j]] ** 2)) for j in range(count)])
        return WandFit(
            state.cameras, state.R, state.T, state.A, state.u, tuple(names), covariance_of(J, plausible, sigma),
            sentences, rms, sigma,
        )  # fmt: skip
