"""The loop on a camera: the residual field of a calibrated pinhole, the effect that explains it, the error held out.

Least squares gives evidence as it does for poses: what a candidate would add to the residual, with all that the plain
model can follow (intrinsics, and a pose for each picture) projected out. Its statistic is F with the noise estimated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sinan.calibration.cameras.camera import CameraFit, Form, blocks_of, compare, fit, form
from sinan.calibration.cameras.views import View
from sinan.estimator.evidence.alpha import ALPHA
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError

DISTORTION = "camera.distortion"
#: A focal length takes two, and one is held out.
LEAST_PICTURES = 3
#: Corners are written to a ten-thousandth of a pixel; smaller residuals are not of a camera [pixels].
ROUNDING = 1e-6


@dataclass(frozen=True)
class Candidate:
    """What may be lacking.

    Attributes
    ----------
    name : of the catalogue, or what it is
    parameters, unit : of beta
    columns : (fit, view, number of the view) -> (2 n, parameters): d predicted pixels / d beta
    form : with which the camera is fitted when it is added; None: a probe, which no form of the lens has
    """

    name: str
    parameters: tuple[str, ...]
    unit: tuple[str, ...]
    columns: Callable[[CameraFit, View, int], FloatArray]
    form: Form | None = None


def _distortion(found: CameraFit, view: View, k: int) -> FloatArray:
    _, by_values = found.intrinsics.slopes(found.poses[k].points(view.points))
    return by_values[..., 4:8].reshape(-1, 4)


def _skew(found: CameraFit, view: View, k: int) -> FloatArray:
    plane = found.intrinsics.model.plane(found.poses[k].points(view.points), found.intrinsics.k)
    return np.column_stack([found.intrinsics.f[0] * plane[:, 1], np.zeros(len(plane))]).reshape(-1, 1)


def _of_the_board(found: CameraFit, view: View, k: int, moved: FloatArray) -> FloatArray:
    """Columns of corners moved on the board by (n, 3, parameters)."""
    by_P, _ = found.intrinsics.slopes(found.poses[k].points(view.points))
    return np.asarray(by_P @ (found.poses[k].R @ moved)).reshape(2 * len(view), -1)


def _bend(found: CameraFit, view: View, k: int) -> FloatArray:
    x, y = view.points[:, 0], view.points[:, 1]
    moved = np.zeros((len(view), 3, 3))
    moved[:, 2] = np.column_stack([x * x, x * y, y * y])
    return _of_the_board(found, view, k, moved)


def _stretch(found: CameraFit, view: View, k: int) -> FloatArray:
    moved = np.zeros((len(view), 3, 1))
    moved[:, 1, 0] = view.points[:, 1]
    return _of_the_board(found, view, k, moved)


#: The catalogue's effect, and probes that have no name in it.
CANDIDATES = (
    Candidate(DISTORTION, ("k1", "k2", "p1", "p2"), ("1",) * 4, _distortion, form("k1 k2 p1 p2")),
    Candidate("a board that is bent", ("xx", "xy", "yy"), ("1/m",) * 3, _bend),
    Candidate("a board that is stretched along y", ("scale",), ("1",), _stretch),
    Candidate("pixel rows askew to columns", ("skew",), ("1",), _skew),
)


@dataclass(frozen=True)
class Evidence:
    """How much a candidate would explain.

    Attributes
    ----------
    statistic : how much the sum of squares would fall, by the variance of the noise that is left without it
    p_value : of that by chance, noise being white; of (2 corners - parameters) degrees of freedom
    beta, std : to first order
    """

    candidate: Candidate
    statistic: float
    p_value: float
    beta: FloatArray
    std: FloatArray


def evidence(found: CameraFit, candidates: Sequence[Candidate] = CANDIDATES) -> list[Evidence]:
    """Each candidate's score, with intrinsics and poses projected out of it."""
    from scipy.stats import f as fisher

    blocks = blocks_of(found.views, found.intrinsics, found.poses, found.form.spread)
    frames = [np.linalg.qr(B)[0] for _, _, B in blocks]
    r = np.concatenate([r - Q @ (Q.T @ r) for (r, _, _), Q in zip(blocks, frames, strict=True)])
    A = np.linalg.qr(np.concatenate([A - Q @ (Q.T @ A) for (_, A, _), Q in zip(blocks, frames, strict=True)]))[0]
    r = r - A @ (A.T @ r)
    evidence = []
    for one in candidates:
        rows = [one.columns(found, view, k) for k, view in enumerate(found.views)]
        C = np.concatenate([c - Q @ (Q.T @ c) for c, Q in zip(rows, frames, strict=True)])
        C = C - A @ (A.T @ C)
        beta = -np.linalg.lstsq(C, r, rcond=None)[0]  # r is predicted minus seen: what is added has its opposite
        fall = float(r @ r - np.sum((r + C @ beta) ** 2))
        dof = len(r) - 6 * len(found.views) - len(found.form.names) - C.shape[1]
        if dof < 1:
            raise InputError("camera", f"{len(r)} coordinates of corners", f"more than {len(r) - dof} to judge by")
        variance = max(float(r @ r - fall) / dof, ROUNDING**2)
        p = float(fisher.sf(fall / C.shape[1] / variance, C.shape[1], dof))
        std = np.sqrt(variance * np.diag(np.linalg.inv(C.T @ C)))
        evidence.append(Evidence(one, fall / variance, p, np.asarray(beta), std))
    return evidence


@dataclass(frozen=True)
class CameraTrace:
    """What the loop found.

    Attributes
    ----------
    before, after : the camera of the plain model, and with what was added
    first, rest : evidence of all candidates before, and of those left after
    named : the effect of the catalogue, if it was added
    held_out : RMS of pictures that took no part in the fit [pixels], before and after
    gain, error : by how much their log density rose, summed over the pictures, and its standard error
    verdict : no_effect, effects or unexplained
    """

    before: CameraFit
    after: CameraFit
    first: list[Evidence]
    rest: list[Evidence]
    named: Evidence | None
    held_out: tuple[float, float]
    gain: float
    error: float
    verdict: str


def trace(views: Sequence[View], size: tuple[int, int] = (0, 0), alpha: float = ALPHA) -> CameraTrace:
    """Calibrate without distortion, ask what the residual field shows, add it, count the error of held-out pictures.

    An effect is named where it is the likeliest of all candidates at the level alpha over all of them, and the pictures
    that were held out are predicted better with it.

    Raises
    ------
    InputError : too few pictures to hold one out, or too few corners to judge by
    """
    if len(views) < LEAST_PICTURES:
        raise InputError("camera", f"{len(views)} pictures", f"{LEAST_PICTURES}, so that one can be held out")
    before = fit(views, form("pinhole"), size)
    first = evidence(before)
    best = max(first, key=lambda one: one.statistic / len(one.beta))
    lens = best.candidate.form
    if best.p_value * len(first) > alpha:
        return CameraTrace(before, before, first, first, None, (before.rms, before.rms), 0.0, 0.0, "no_effect")
    if lens is None:
        return CameraTrace(before, before, first, first, None, (before.rms, before.rms), 0.0, 0.0, "unexplained")
    after = fit(views, lens, size)
    _, (plain, full) = compare(views, [form("pinhole"), lens], size)
    gain = full.score - plain.score
    error = float(np.std(gain, ddof=1) * np.sqrt(len(gain)))
    rest = evidence(after, [one for one in CANDIDATES if one.form is None])
    better = float(np.sum(gain)) > 0.0
    return CameraTrace(
        before, after, first, rest, _refined(best, after), (plain.rms, full.rms), float(np.sum(gain)), error,
        "effects" if better else "unexplained",
    )  # fmt: skip


def _refined(best: Evidence, after: CameraFit) -> Evidence:
    """The candidate with its beta from the exact fit."""
    at = [after.form.names.index(name) for name in best.candidate.parameters]
    return Evidence(best.candidate, best.statistic, best.p_value, after.parameters[at], after.std[at])


def document(found: CameraTrace, alpha: float = ALPHA) -> dict[str, object]:
    """The trace as JSON, in the keys of `sinan trace`."""
    return {
        "alpha": alpha,
        "verdict": found.verdict,
        "effects": [
            {
                "name": one.candidate.name,
                "beta": one.beta.tolist(),
                "std": one.std.tolist(),
                "unit": list(one.candidate.unit),
                "p_value": one.p_value,
            }
            for one in ([found.named] if found.named and found.verdict == "effects" else [])
        ],
        "error": {
            "held_out": True,
            "stream": "camera",
            "before": {"rms": found.held_out[0], "unit": "pixel"},
            "after": {"rms": found.held_out[1], "unit": "pixel"},
            "log_density_gain": {"sum": found.gain, "standard_error": found.error},
            "in_sample": {"before": {"rms": found.before.rms}, "after": {"rms": found.after.rms}},
        },
        "candidates": [_row(one) for one in found.first],
        "remaining": [_row(one) for one in found.rest if one.p_value * len(found.rest) <= alpha],
    }


def _row(one: Evidence) -> dict[str, object]:
    return {
        "name": one.candidate.name,
        "statistic": one.statistic,
        "dof": len(one.beta),
        "p_value": one.p_value,
        "beta": one.beta.tolist(),
        "std": one.std.tolist(),
    }
