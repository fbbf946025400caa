"""Intrinsic calibration of a camera from views of a target: least squares over intrinsics and a pose for each view.

    residual = pixels(R_i X + T_i) - seen;  x = (f_x, f_y, u0, v0, coefficients of the lens, r_i, T_i)

The normal equations have the form of an arrow: a pose enters its own view alone, and is eliminated view by view.

Source: Z. Zhang, IEEE Trans. PAMI 22(11), 2000, with the start from homographies (section 3.1, the principal point in
the middle); R. Hartley, A. Zisserman, Multiple View Geometry, 2nd edition, appendix 6 (sparse Levenberg-Marquardt).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sinan.calibration.cameras.damped import minimised
from sinan.calibration.cameras.views import View
from sinan.calibration.poses.least_squares import covariance_of, undetermined_directions
from sinan.sensors.arrays import FloatArray
from sinan.sensors.camera import Intrinsics
from sinan.sensors.errors import InputError
from sinan.sensors.lenses import LENSES
from sinan.sensors.rotation import right_jacobian, rotation_exp, skew

#: Plausible sizes of the parameters, which bring their columns to like sizes before null directions are judged [pixels,
#: 1]: bound of work (`bounds_of_work camera`).
_PLAUSIBLE = {"f": 100.0, "centre": 30.0, "k": 0.1}
#: Half angles of the diagonal that starts of a lens are made with, from a long lens to a fisheye [rad]: bound of work
#: (`bounds_of_work lenses`).
_HALF_ANGLES = np.deg2rad([15.0, 30.0, 50.0, 75.0, 95.0])
#: Focal lengths beyond so many half pictures are rounding, for atan(1 / 1000) is 0.06 deg: `bounds_of_work camera`.
_LONGEST = 1e3
#: A picture is set aside where its RMS is so many robust sigmas of the pictures' logarithms above their median, of this
#: many at least: a choice. Of 200 sets of 20 whose errors scatter by half 1 loses a picture in vain, of 8, whose sigma
#: is known less well, 4; one that is 20 times as far off goes in 147 and 116. Half of the first loses one in 48 and 37,
#: twice finds it in 10 and 35; half of the second finds it in 91 sets of 4 (`bounds_of_work misfits`).
_FAR, _LEAST_VIEWS = 5.0, 5


@dataclass(frozen=True)
class Pose:
    """Where the target is: P_c = R X + T, R = Exp(r)."""

    r: FloatArray
    T: FloatArray

    @property
    def R(self) -> FloatArray:
        """(3, 3)."""
        return rotation_exp(self.r)

    def points(self, X: FloatArray) -> FloatArray:
        """(n, 3) points of the target in the camera."""
        return X @ self.R.T + self.T

    def slopes(self, X: FloatArray) -> FloatArray:
        """(n, 3, 6) d P_c / d (r, T): -R [X]x J_r(r), and the unit matrix."""
        turn = -self.R @ skew(X) @ right_jacobian(self.r)
        return np.concatenate([turn, np.broadcast_to(np.eye(3), turn.shape)], axis=-1)


@dataclass(frozen=True)
class Form:
    """Which lens is fitted, and which of its coefficients; the others stay zero.

    Attributes
    ----------
    name : as reports say it
    lens : of `sensors.lenses`
    free : names of the coefficients
    square : f_x = f_y
    """

    name: str
    lens: str
    free: tuple[str, ...]
    square: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters that are fitted."""
        return (*(("f",) if self.square else ("f_x", "f_y")), "u0", "v0", *self.free)

    @property
    def spread(self) -> FloatArray:
        """(4 + coefficients, parameters): d `Intrinsics.values` / d parameters, zeros and ones."""
        names = ("f_x", "f_y", "u0", "v0", *LENSES[self.lens].coefficients)
        columns = [
            [float(name == own or (own == "f" and name in ("f_x", "f_y"))) for name in names] for own in self.names
        ]
        return np.array(columns).T

    @property
    def plausible(self) -> FloatArray:
        """(parameters,) plausible sizes."""
        sizes = {"f": "f", "f_x": "f", "f_y": "f", "u0": "centre", "v0": "centre"}
        return np.array([_PLAUSIBLE[sizes.get(name, "k")] for name in self.names])


#: The forms that are compared, each lens's from the simplest on. Nested: `pinhole` < `k1` < ... < `k1 k2 p1 p2 k3`.
FORMS: tuple[Form, ...] = (
    Form("pinhole", "brown", ()),
    Form("k1", "brown", ("k1",)),
    Form("k1 k2", "brown", ("k1", "k2")),
    Form("k1 k2 p1 p2", "brown", ("k1", "k2", "p1", "p2")),
    Form("k1 k2 p1 p2 k3", "brown", ("k1", "k2", "p1", "p2", "k3")),
    Form("fisheye", "fisheye", ("k1", "k2", "k3", "k4")),
    Form("unified", "omnidirectional", ("xi",)),
    Form("omnidirectional", "omnidirectional", ("xi", "k1", "k2", "p1", "p2")),
)


def form(name: str) -> Form:
    """The form of that name.

    Raises
    ------
    InputError : there is none
    """
    for entry in FORMS:
        if entry.name == name:
            return entry
    raise InputError("form of the lens", name, ", ".join(entry.name for entry in FORMS))


@dataclass(frozen=True)
class CameraFit:
    """A calibrated camera.

    Attributes
    ----------
    form : what was fitted
    intrinsics : the solution
    poses : of each view
    views : that were fitted
    covariance : (parameters, parameters) of `form.names`; infinite where the views do not determine one
    undetermined : a sentence for each direction that they do not determine
    residual : of each view, (n, 2) predicted minus seen [pixels]
    sigma : standard deviation of one coordinate of a corner, estimated [pixels]
    """

    form: Form
    intrinsics: Intrinsics
    poses: tuple[Pose, ...]
    views: tuple[View, ...]
    covariance: FloatArray
    undetermined: tuple[str, ...]
    residual: tuple[FloatArray, ...]
    sigma: float

    @property
    def parameters(self) -> FloatArray:
        """(parameters,) of `form.names`."""
        spread = self.form.spread
        return np.asarray((self.intrinsics.values @ spread) / np.sum(spread, axis=0))

    @property
    def std(self) -> FloatArray:
        """(parameters,) 1-sigma."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def rms(self) -> float:
        """Root mean square distance between a corner and its prediction [pixels], as OpenCV's `calibrateCamera`."""
        return _rms(np.concatenate(self.residual))

    @property
    def rms_of_view(self) -> FloatArray:
        """(views,) the same of each."""
        return np.array([_rms(r) for r in self.residual])


def _rms(residual: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))


def homography(flat: FloatArray, seen: FloatArray) -> FloatArray:
    """(3, 3) H with s (seen, 1) = H (flat, 1), both (n, 2), by normalised direct linear transformation.

    Source: Hartley, Zisserman, algorithm 4.2.
    """

    def normaliser(points: FloatArray) -> FloatArray:
        middle = points.mean(axis=0)
        scale = np.sqrt(2.0) / max(float(np.mean(np.linalg.norm(points - middle, axis=1))), 1e-300)
        return np.array([[scale, 0.0, -scale * middle[0]], [0.0, scale, -scale * middle[1]], [0.0, 0.0, 1.0]])

    N, M = normaliser(flat), normaliser(seen)
    a = flat @ N[:2, :2].T + N[:2, 2]
    b = seen @ M[:2, :2].T + M[:2, 2]
    one, zero = np.column_stack([a, np.ones(len(a))]), np.zeros((len(a), 3))
    rows = np.vstack([np.hstack([one, zero, -b[:, :1] * one]), np.hstack([zero, one, -b[:, 1:] * one])])
    h = np.linalg.svd(rows, full_matrices=len(rows) < 9)[2][-1].reshape(3, 3)
    return np.asarray(np.linalg.inv(M) @ h @ N)


def pose_of_plane(X: FloatArray, rays: FloatArray) -> Pose:
    """Start for the pose of a flat target (z = 0) from directions (n, 3) in the camera; those not ahead are left out.

    H = (r1, r2, T) up to a factor; the nearest rotation by the singular values. Zhang, section 3.1.
    """
    from scipy.spatial.transform import Rotation

    ahead = rays[:, 2] > 0.1  # tan 84 deg; beyond, a plane at distance one is too far away to weigh with the rest
    if np.sum(ahead) < 4:
        raise np.linalg.LinAlgError("no four corners ahead of the camera")
    H = homography(X[ahead, :2], rays[ahead, :2] / rays[ahead, 2:])
    H *= np.sign((H @ np.append(X[ahead, :2].mean(axis=0), 1.0))[2])
    scale = 2.0 / (np.linalg.norm(H[:, 0]) + np.linalg.norm(H[:, 1]))
    r1, r2, T = (scale * H).T
    U, _, Vt = np.linalg.svd(np.column_stack([r1, r2, np.cross(r1, r2)]))
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return Pose(Rotation.from_matrix(R).as_rotvec(), T)


def focal_start(views: Sequence[View], centre: FloatArray) -> FloatArray:
    """(2,) f_x, f_y of a pinhole from the homographies, the principal point being known.

    Of each H about the centre, with columns h1, h2: h1' B h2 = 0, h1' B h1 = h2' B h2, B = diag(1/f_x^2, 1/f_y^2, 1).
    Not a number where the views determine none (all parallel to the picture). Zhang, section 3.1.
    """
    rows, right = [], []
    for view in views:
        H = homography(view.points[:, :2], view.pixels - centre)
        a, b = (H[:, :2] / np.linalg.norm(H[:, :2])).T
        rows += [a[:2] * b[:2], a[:2] ** 2 - b[:2] ** 2]
        right += [-a[2] * b[2], b[2] ** 2 - a[2] ** 2]
    inverse_squares = np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0]
    extent = max(float(np.max(np.abs(view.pixels - centre))) for view in views)
    least = 1.0 / (_LONGEST * extent) ** 2
    return np.asarray(1.0 / np.sqrt(np.where(inverse_squares > least, inverse_squares, np.nan)))


def require_flat(views: Sequence[View]) -> None:
    """The starts are those of flat targets.

    Raises
    ------
    InputError : a view whose target is not at z = 0, or whose corners are on one line
    """
    for view in views:
        if np.any(view.points[:, 2] != 0.0):
            raise InputError(view.name, "corners with z other than 0", "a flat target with z = 0")
        spread = np.linalg.svd(view.points[:, :2] - view.points[:, :2].mean(axis=0))[1]
        if spread[1] < 1e-6 * spread[0]:
            raise InputError(view.name, "corners on one line", "corners that span the target's plane")


def starts(views: Sequence[View], entry: Form, size: tuple[int, int]) -> list[Intrinsics]:
    """Where to begin: Zhang's closed form, else lenses of several angles of view."""
    seen = np.concatenate([view.pixels for view in views])
    extent = np.array(size, dtype=np.float64) if all(size) else seen.max(axis=0) + seen.min(axis=0)
    centre = 0.5 * (extent - 1.0)
    reach = 0.5 * float(np.linalg.norm(extent))
    k = np.zeros(len(LENSES[entry.lens].coefficients))
    if entry.lens == "omnidirectional":
        k[0] = 1.0  # xi between the pinhole's 0 and a hyperbolic mirror's
    plane = {
        "brown": np.tan(np.minimum(_HALF_ANGLES, 1.2)),
        "fisheye": _HALF_ANGLES,
        "omnidirectional": np.sin(_HALF_ANGLES) / (1.0 + np.cos(_HALF_ANGLES)),
    }[entry.lens]
    found = [Intrinsics(np.full(2, reach / radius), centre, entry.lens, k) for radius in plane]
    f = focal_start(views, centre)
    if entry.lens == "brown" and np.all(np.isfinite(f)):
        return [Intrinsics(np.full(2, f.mean()) if entry.square else f, centre, entry.lens, k)]
    return found


def fit(
    views: Sequence[View], entry: Form, size: tuple[int, int] = (0, 0), start: Intrinsics | None = None
) -> CameraFit:
    """Calibrate a camera.

    Parameters
    ----------
    views : of a flat target
    entry : what is fitted
    size : width, height of the pictures [pixels]; (0, 0): unknown, taken from where corners are
    start : where to begin; default: the best of `starts`

    Raises
    ------
    InputError : no view, a target that is not flat, more unknowns than corners say, no start from which a fit settles
    """
    views = tuple(views)
    if not views:
        raise InputError("camera", "no view", "pictures of a target")
    require_flat(views)
    given, asked = 2 * sum(map(len, views)), len(entry.names) + 6 * len(views)
    if given <= asked:
        found = f"{given} coordinates of corners for {asked} unknowns"
        raise InputError("camera", found, "more views, or more corners")
    begun = []
    for begin in [start] if start is not None else starts(views, entry, size):
        try:
            poses = [pose_of_plane(view.points, begin.rays(view.pixels)) for view in views]
        except np.linalg.LinAlgError:
            continue
        begun.append((_cost(views, begin, poses), begin, poses))
    for cost, begin, poses in sorted(begun, key=lambda one: one[0]):  # the likeliest first
        if np.isfinite(cost):
            camera, poses = _minimise(views, entry.spread, begin, poses)
            return _result(views, entry, camera, poses)
    raise InputError("camera", f"no start from which {entry.name} settles", "more views, turned more differently")


def blocks_of(
    views: Sequence[View], camera: Intrinsics, poses: Sequence[Pose], spread: FloatArray
) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Of each view: residual (2 n,), its Jacobians by the intrinsics (2 n, parameters) and by the pose (2 n, 6)."""
    P = np.concatenate([pose.points(view.points) for view, pose in zip(views, poses, strict=True)])
    by_pose = np.concatenate([pose.slopes(view.points) for view, pose in zip(views, poses, strict=True)])
    by_P, by_values = camera.slopes(P)
    A, B = by_values @ spread, by_P @ by_pose
    r = camera.pixels(P) - np.concatenate([view.pixels for view in views])
    ends = np.cumsum([len(view) for view in views])[:-1]
    return [
        (r_i.ravel(), A_i.reshape(2 * len(r_i), spread.shape[1]), B_i.reshape(2 * len(r_i), 6))
        for r_i, A_i, B_i in zip(np.split(r, ends), np.split(A, ends), np.split(B, ends), strict=True)
    ]


def _residuals(views: Sequence[View], camera: Intrinsics, poses: Sequence[Pose]) -> list[FloatArray]:
    """Of each view (n, 2) predicted minus seen."""
    P = np.concatenate([pose.points(view.points) for view, pose in zip(views, poses, strict=True)])
    r = camera.pixels(P) - np.concatenate([view.pixels for view in views])
    return np.split(r, np.cumsum([len(view) for view in views])[:-1])


def _cost(views: Sequence[View], camera: Intrinsics, poses: Sequence[Pose]) -> float:
    """Sum of squared residuals; infinite where a corner cannot be seen."""
    with np.errstate(invalid="ignore", over="ignore"):
        total = sum(float(np.sum(r**2)) for r in _residuals(views, camera, poses))
    return total if np.isfinite(total) else np.inf


def _minimise(
    views: Sequence[View], spread: FloatArray, camera: Intrinsics, poses: list[Pose]
) -> tuple[Intrinsics, list[Pose]]:
    """Intrinsics and poses of the least squares, the poses eliminated."""

    def moved(
        state: tuple[Intrinsics, list[Pose]], da: FloatArray, dp: Sequence[FloatArray]
    ) -> tuple[Intrinsics, list[Pose]] | None:
        camera, poses = state
        values = camera.values + spread @ da
        if not (np.all(np.isfinite(values)) and np.all(values[:2] > 0.0)):
            return None
        turned = [_wrapped(Pose(p.r + d[:3], p.T + d[3:])) for p, d in zip(poses, dp, strict=True)]
        return camera.with_values(values), turned

    start = (camera, poses)
    return minimised(start, lambda s: _cost(views, *s), lambda s: blocks_of(views, *s, spread), moved)


def _wrapped(pose: Pose) -> Pose:
    """The same rotation by the vector that is not longer than pi, where J_r is regular."""
    angle = float(np.linalg.norm(pose.r))
    return pose if angle <= np.pi else Pose(pose.r * (1.0 - 2.0 * np.pi / angle), pose.T)


def _result(views: tuple[View, ...], entry: Form, camera: Intrinsics, poses: Sequence[Pose]) -> CameraFit:
    """The covariance from the Jacobian with the poses projected out: A - B B^+ A of each view."""
    spread = entry.spread
    projected = []
    for _, A, B in blocks_of(views, camera, poses, spread):
        Q = np.linalg.qr(B)[0]
        projected.append(A - Q @ (Q.T @ A))
    residual = tuple(_residuals(views, camera, poses))
    J, given = np.concatenate(projected), 2 * sum(map(len, views))
    sigma = float(np.sqrt(sum(float(np.sum(r**2)) for r in residual) / (given - len(entry.names) - 6 * len(views))))
    _, sentences, _ = undetermined_directions(J, entry.names, entry.plausible)
    covariance = covariance_of(J, entry.plausible, sigma)
    return CameraFit(entry, camera, tuple(poses), views, covariance, sentences, residual, sigma)


def resection(view: View, camera: Intrinsics) -> tuple[Pose, FloatArray]:
    """The pose of one view with the camera known, and the residual (n, 2) [pixels], which judges a held-out picture.

    Raises
    ------
    numpy.linalg.LinAlgError : the camera cannot have seen it
    """
    pose = pose_of_plane(view.points, camera.rays(view.pixels))
    _, (pose,) = _minimise([view], np.zeros((len(camera.values), 0)), camera, [pose])
    return pose, _residuals([view], camera, [pose])[0]


def that_do_not_fit(found: CameraFit) -> tuple[str, ...]:
    """Names of the pictures whose error is far above the usual one: none where there are too few to say.

    The logarithms of the pictures' RMS are compared with their median and median absolute deviation, which is taken no
    smaller than white noise of a picture's corners makes it, 1 / sqrt(2 dof).
    """
    rms = found.rms_of_view
    if len(rms) < _LEAST_VIEWS:
        return ()
    logs = np.log(np.maximum(rms, 1e-12))
    middle = np.median(logs)
    scatter = 1.4826 * float(np.median(np.abs(logs - middle)))  # of a normal law: its standard deviation
    least = 1.0 / np.sqrt(2.0 * np.array([2 * len(view) - 6 for view in found.views]))
    far = logs - middle > _FAR * np.maximum(scatter, least)
    return tuple(view.name for view, out in zip(found.views, far, strict=True) if out)


def fit_without_misfits(
    views: Sequence[View], entry: Form, size: tuple[int, int] = (0, 0)
) -> tuple[CameraFit, tuple[tuple[str, float], ...]]:
    """Calibrate, and leave out the pictures that do not fit until all do; those with their RMS by the camera [pixels].

    Of several that do not fit the worst goes first, since it may have drawn the others.
    """
    kept, aside = list(views), []
    while True:
        found = fit(kept, entry, size)
        far = that_do_not_fit(found)
        if not far:
            break
        rms = dict(zip((view.name for view in found.views), found.rms_of_view, strict=True))
        worst = max(far, key=lambda name: rms[name])
        aside.append(next(view for view in kept if view.name == worst))
        kept = [view for view in kept if view.name != worst]
    errors = []
    for view in aside:
        try:
            errors.append((view.name, _rms(resection(view, found.intrinsics)[1])))
        except np.linalg.LinAlgError:
            errors.append((view.name, float("inf")))
    return found, tuple(errors)


@dataclass(frozen=True)
class Comparison:
    """What one form makes of pictures that took no part in its fit.

    Attributes
    ----------
    form : of the lens
    rms : of the held-out pictures, their poses fitted [pixels]
    score : (views,) log density of each, up to what all forms share: -n log of its RMS
    behind : by how much its score is below the best one's, summed, and the standard error of that
    """

    form: Form
    rms: float
    score: FloatArray
    behind: tuple[float, float] = (0.0, 0.0)


def held_out(views: Sequence[View], entry: Form, size: tuple[int, int], parts: int) -> tuple[float, FloatArray]:
    """RMS [pixels] and score of each view by cameras calibrated without it and every `parts`-th other one."""
    score, squares, number = np.full(len(views), -np.inf), 0.0, 0
    start = fit(views, entry, size).intrinsics  # where each fit begins; where it ends is its own views' matter
    for part in range(parts):
        camera = fit([view for k, view in enumerate(views) if k % parts != part], entry, size, start).intrinsics
        for k in range(part, len(views), parts):
            try:
                _, residual = resection(views[k], camera)
            except np.linalg.LinAlgError:
                return np.inf, np.full(len(views), -np.inf)
            score[k] = -2.0 * len(residual) * np.log(max(_rms(residual), 1e-12))
            squares, number = squares + float(np.sum(residual**2)), number + len(residual)
    return float(np.sqrt(squares / number)), score


def compare(
    views: Sequence[View], forms: Sequence[Form] = FORMS, size: tuple[int, int] = (0, 0), parts: int = 5
) -> tuple[Form, list[Comparison]]:
    """The form that the pictures call for, and what each makes of pictures held out.

    The simplest form whose score is within one standard error, over the pictures, of the best one's is taken: pairs of
    scores of the same picture are compared, so that what is bad about a picture counts for no form.

    Source: T. Hastie, R. Tibshirani, J. Friedman, The Elements of Statistical Learning, 2nd edition, section 7.10.
    """
    parts = min(parts, len(views))
    if parts < 2:
        raise InputError("camera", f"{len(views)} view", "at least two views: one to hold out")
    tried = []
    for entry in forms:
        try:
            rms, score = held_out(views, entry, size, parts)
        except InputError:  # too few views for so many coefficients, or none from which it settles
            continue
        if np.isfinite(rms):
            tried.append(Comparison(entry, rms, score))
    if not tried:
        raise InputError("camera", "no form that settles without a part of the views", "more views")
    best = max(tried, key=lambda one: float(np.sum(one.score)))
    judged = []
    for one in tried:
        gap = best.score - one.score
        error = float(np.std(gap, ddof=1) * np.sqrt(len(gap))) if len(gap) > 1 else 0.0
        judged.append(replace(one, behind=(float(np.sum(gap)), error)))
    near = [one for one in judged if one.behind[0] <= one.behind[1]]
    chosen = min(near, key=lambda one: (len(one.form.free), one.behind[0]))
    return chosen.form, judged
