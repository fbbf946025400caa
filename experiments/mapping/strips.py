"""Strips that overlap show how the laser is mounted: the surfaces of two strips have to be one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from sinan.experiments.mapping.cloud import Mounting, Scans, placed
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray, runs_of
from sinan.sensors.motion import Motion
from sinan.sensors.ranging import scan_beams
from sinan.sensors.rotation import cross, matrix_from_quaternion, rotation_exp

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: What is sought: name of the effect, its component, plausible 1-sigma size.
SOUGHT = (
    ("laser.boresight", "roll", 0.05),
    ("laser.boresight", "pitch", 0.05),
    ("laser.lever_arm", "x", 0.1),
    ("laser.lever_arm", "y", 0.1),
    ("laser.time_offset", "b", 0.05),
)
#: A strip ends where the course turns faster, or the body is slower [rad/s], [m/s]; it lasts so long at least [s].
TURNING, SLOW, SHORTEST = 0.15, 0.5, 3.0
#: Side of a cell in which strips are compared [m], and points of one strip in it at least.
CELL, POINTS = 2.0, 8
#: Points that lie along a line, to so many metres RMS, make no plane.
NARROW = 0.05
#: The error of a trajectory is a straight line between knots so far apart [s].
KNOT = 1.0
#: Cells whose plane leaves more than so many times the median are edges of something.
ROUGH = 2.0
PASSES, ROBUST = 10, 3.0
#: Added to the variance of a knot, so that a matrix of such smooth errors can be inverted [1].
ROUNDING = 1e-6


@dataclass(frozen=True)
class Drift:
    """By what the trajectory may lie off: the smoother's covariance of its errors, of one instant and of two.

    Attributes
    ----------
    t : (k,) s, ascending
    covariance : (6 k, 6 k), of each instant position [m, NED] and attitude [rad, of the body's axes]
    """

    t: FloatArray
    covariance: FloatArray


def hardly_any(t: FloatArray) -> Drift:
    """Of a trajectory that is known, to 0.1 mm and a microradian."""
    sigma = np.tile(np.repeat([1e-4, 1e-6], 3), 2)
    return Drift(t[[0, -1]], np.diag(sigma**2))


@dataclass(frozen=True)
class StripFit:
    """What the strips say.

    Attributes
    ----------
    mounting : found
    beta, sigma : (5,) in the order of `SOUGHT`, and 1-sigma
    before, after : RMS difference of height of two strips in a cell [m]
    cells : comparisons of two strips in a cell
    """

    mounting: Mounting
    beta: FloatArray
    sigma: FloatArray
    before: float
    after: float
    cells: int

    def determined(self, k: int) -> bool:
        """Whether the strips say more of a parameter than that it is of a plausible size."""
        return bool(self.sigma[k] < 0.3 * SOUGHT[k][2])


def strips_of(motion: Motion, t: FloatArray) -> IntArray:
    """(n,) number of the strip that a scan belongs to; -1 in turns and where the body hardly moves."""
    at = motion.at(t)
    speed = np.linalg.norm(at.v_n[:, :2], axis=1)
    course = np.unwrap(np.arctan2(at.v_n[:, 1], at.v_n[:, 0]))
    rate = np.abs(np.gradient(course, t)) if len(t) > 1 else np.zeros(len(t))
    gaps = np.diff(t, prepend=t[:1]) > 1.0
    straight = (speed > SLOW) & (rate < TURNING) & ~gaps
    strip = np.full(len(t), -1, dtype=np.int64)
    number = 0
    for first, last in runs_of(straight):
        if t[last - 1] - t[first] >= SHORTEST:
            strip[first:last] = number
            number += 1
    return strip


def mounting_of(beta: FloatArray, up: float = 0.0) -> Mounting:
    """The mounting that the parameters say; `up`: the z of the lever arm, which shows in no strip [m]."""
    return Mounting(beta[:2].copy(), np.array([beta[2], beta[3], up]), float(beta[4]))


def fit_strips(
    scans: Scans, motion: Motion, strip: IntArray, start: Mounting | None = None, drift: Drift | None = None
) -> StripFit | None:
    """Boresight, lever arm and time offset with which overlapping strips agree best; None: none overlap.

    In every cell each strip is a plane; the difference of the heights of two planes in the cell's middle is linear in
    the parameters, d + (J_A - J_B) beta, J the mean over the points of n . dp/dbeta, n = (-slope, 1). The trajectory
    may besides lie off in position and attitude as the smoother says: how far, and how alike at two instants. An
    accelerometer's bias tilts a whole flight alike, as the boresight does; a shorter memory would make of it what
    strips average. Weighted least squares with plausible sizes as a prior, differences beyond `ROBUST`
    robust sigmas of less weight, repeated.

    Parameters
    ----------
    scans, motion : of the flight
    strip : (n,) of each scan
    start : what is declared, about which a plausible size is the prior; default: nothing
    drift : of the trajectory; default: hardly any

    Source: C. K. Toth, Strip adjustment, in: J. Shan, C. Toth, Topographic Laser Ranging and Scanning, 2nd ed.
    Neglects boresight yaw, and what the trajectory's error is between knots beside a straight line.
    """
    if not np.any(np.isfinite(scans.ranges[strip >= 0])):
        return None
    start, drift = start or Mounting(), drift or hardly_any(scans.t[strip >= 0])
    plausible = np.array([entry[2] for entry in SOUGHT])
    first = np.array([*start.boresight, *start.lever_arm[:2], start.time_offset])
    beta, up = first.copy(), float(start.lever_arm[2])
    drifts = np.sqrt(np.diag(drift.covariance))
    size = np.concatenate([plausible, drifts])
    prior = _prior(drift.covariance / np.outer(drifts, drifts))
    before = after = 0.0
    sigma, count = plausible, 0
    for turn in range(PASSES):
        difference, J, share = _differences(_planes(scans, motion, strip, beta, up), drift.t)
        count = len(difference)
        if count < 4 * len(beta):
            return None
        after = _robust_rms(difference)
        before = after if turn == 0 else before
        pull = np.concatenate([(beta - first) / plausible, np.zeros(len(drifts))])
        step, covariance = _robust_step(difference, J * size[None, :], share, prior, pull)
        sigma = plausible * np.sqrt(np.diag(covariance)[: len(beta)])
        moved = plausible * step[: len(beta)]
        beta = beta + moved
        if np.all(np.abs(moved) < 0.1 * sigma):
            break
    return StripFit(mounting_of(beta, up), beta, sigma, before, after, count)


def _robust_rms(difference: FloatArray) -> float:
    bound = ROBUST * 1.4826 * float(np.median(np.abs(difference)))
    return float(np.sqrt(np.mean(np.minimum(np.abs(difference), bound) ** 2)))


def _prior(alike: FloatArray) -> FloatArray:
    """Information in plausible sizes: what is sought by itself, the trajectory's errors as their correlation says."""
    known = len(SOUGHT)
    prior = np.eye(known + len(alike))
    prior[known:, known:] = np.linalg.inv(alike + ROUNDING * np.eye(len(alike)))
    return prior


def _robust_step(
    difference: FloatArray, J: csr_array, share: FloatArray, prior: FloatArray, pull: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The step (k,) in plausible sizes that takes most of the differences (m,) away, and its covariance.

    `prior` (k, k) is the information that there is before, `pull` (k,) how far from it the parameters are.
    """
    step, information = np.zeros(J.shape[1]), prior
    for _ in range(4):
        left = difference + J @ step
        noise = max(1.4826 * float(np.median(np.abs(left))), 1e-4)
        weight = share * np.minimum(1.0, ROBUST * noise / np.maximum(np.abs(left), 1e-12)) / noise**2
        information = (J.T @ (J * weight[:, None])).toarray() + prior
        step = -np.linalg.solve(information, J.T @ (weight * difference) + prior @ pull)
    return np.asarray(step), np.asarray(np.linalg.inv(information))


@dataclass(frozen=True)
class Planes:
    """Of every strip in every cell a plane; sorted by cell.

    Attributes
    ----------
    cell : (g,) number of the cell
    t : (g,) mean instant of its points [s]
    height : (g,) in the cell's middle [m]
    by_mounting, by_pose : (g, 5), (g, 6) its derivatives by what is sought, and by position and attitude
    """

    cell: IntArray
    t: FloatArray
    height: FloatArray
    by_mounting: FloatArray
    by_pose: FloatArray


def _differences(planes: Planes, knots: FloatArray) -> tuple[FloatArray, csr_array, FloatArray]:
    """(k,) height differences of two strips in a cell [m], (k, 5 + 6 knots) their derivatives, and (k,) what each
    counts: of n strips in a cell n - 1 differences are independent, of n (n - 1) / 2.
    """
    from scipy.sparse import csr_array

    _, strips = np.unique(planes.cell, return_counts=True)
    in_cell = np.repeat(strips, strips)
    a, b = [], []
    for away in range(1, int(strips.max(initial=0))):
        same = np.flatnonzero(planes.cell[:-away] == planes.cell[away:])
        a.append(same)
        b.append(same + away)
    first, second = (np.concatenate([np.empty(0, dtype=np.int64), *one]) for one in (a, b))
    known = len(SOUGHT)
    value, column = (
        [planes.by_mounting[first] - planes.by_mounting[second]],
        [np.tile(np.arange(known), (len(first), 1))],
    )
    before = np.clip(np.searchsorted(knots, planes.t, side="right") - 1, 0, len(knots) - 2)
    late = np.clip((planes.t - knots[before]) / np.diff(knots)[before], 0.0, 1.0)[:, None]
    for one, sign in ((first, 1.0), (second, -1.0)):
        for knot, share in ((before[one], 1.0 - late[one]), (before[one] + 1, late[one])):
            value.append(sign * share * planes.by_pose[one])
            column.append(known + 6 * knot[:, None] + np.arange(6))
    values, columns = np.hstack(value), np.hstack(column)
    rows = np.repeat(np.arange(len(first)), values.shape[1])
    J = csr_array((values.ravel(), (rows, columns.ravel())), shape=(len(first), known + 6 * len(knots)))
    return planes.height[first] - planes.height[second], J, 2.0 / in_cell[first]


def _slopes(scans: Scans, motion: Motion, mounting: Mounting, keep: BoolArray) -> FloatArray:
    """(m, 3, 8) derivatives of the points by the mounting and by the attitude."""
    at = motion.at(scans.t - mounting.time_offset)
    row, beam = np.nonzero(keep)
    reach = scans.ranges[keep][:, None] * (scan_beams(scans.angles) @ mounting.turn.T)[beam]
    s = mounting.lever_arm + reach
    rate = at.w_ib_b[row] if at.has("w_ib_b") else np.zeros_like(s)
    axes = np.eye(3)
    pitch_axis = rotation_exp(np.array([mounting.boresight[0], 0.0, 0.0]))[:, 1]
    in_body = [cross(axes[0], reach), cross(pitch_axis, reach), *np.broadcast_to(axes[:2, None], (2, *s.shape))]
    in_body += [-cross(rate, s), *(cross(axis, s) for axis in axes)]
    slopes = np.einsum("mij,mjk->mik", matrix_from_quaternion(at.q_nb)[row], np.stack(in_body, axis=-1))
    slopes[..., 4] -= at.v_n[row]
    return np.asarray(slopes)


def _planes(scans: Scans, motion: Motion, strip: IntArray, beta: FloatArray, up: float) -> Planes:
    """A plane of every strip in every cell where its points lie on all sides of the middle, and are no edge."""
    keep = np.isfinite(scans.ranges) & (strip >= 0)[:, None]
    p = placed(scans, motion, mounting_of(beta, up))[keep]
    cell = np.floor(p[:, :2] / CELL).astype(np.int64)
    key = np.column_stack([np.broadcast_to(strip[:, None], keep.shape)[keep], cell])
    order = np.lexsort(key.T)
    key, p, slopes = key[order], p[order], _slopes(scans, motion, mounting_of(beta, up), keep)[order]
    starts = np.flatnonzero(np.any(np.diff(key, axis=0, prepend=key[:1] - 1) != 0, axis=1))
    n = np.diff(np.append(starts, len(key)))
    group = np.repeat(np.arange(len(starts)), n)
    design = np.column_stack([np.ones(len(p)), p[:, :2] - (key[:, 1:] + 0.5) * CELL])
    normals = np.add.reduceat(design[:, :, None] * design[:, None, :], starts, axis=0)
    usable = (n >= POINTS) & _surround(design[:, 1:], starts) & (np.linalg.eigvalsh(normals)[:, 0] > n * NARROW**2)
    inverse = np.linalg.inv(np.where(usable[:, None, None], normals, np.eye(3)))
    plane = np.einsum("gij,gj->gi", inverse, np.add.reduceat(-p[:, 2:] * design, starts, axis=0))
    left = np.einsum("mi,mi->m", design, plane[group]) + p[:, 2]
    rough = np.sqrt(np.add.reduceat(left**2, starts) / n)
    usable &= rough <= ROUGH * (np.median(rough[usable]) if usable.any() else 0.0)
    slope = _smoothed(key[starts, 1:], plane[:, 1:], np.where(usable, n, 0))
    normal = np.column_stack([-slope, -np.ones(len(plane))])  # of up - plane, in NED
    share = np.einsum("mi,mi->m", design, inverse[group, 0])  # of a point in the height in the middle
    by = np.add.reduceat(share[:, None] * np.einsum("mi,mik->mk", normal[group], slopes), starts, axis=0)
    when = np.add.reduceat(np.broadcast_to(scans.t[:, None], keep.shape)[keep][order], starts) / n
    number = np.cumsum(np.any(np.diff(key[starts, 1:], axis=0, prepend=-(2**40)) != 0, axis=1))
    by_pose = np.column_stack([normal, by[:, len(SOUGHT) :]])
    one = Planes(number, when, plane[:, 0], by[:, : len(SOUGHT)], by_pose)
    return Planes(*(getattr(one, entry.name)[usable] for entry in fields(Planes)))


def _smoothed(cell: IntArray, slope: FloatArray, weight: IntArray) -> FloatArray:
    """(g, 2) slope of the ground: mean over all strips in a cell and those beside it. One plane's own is so noisy that
    even a level ground would seem to show the parameters.
    """
    from scipy.ndimage import convolve

    place = cell - cell.min(axis=0)
    sums = np.zeros((3, *(place.max(axis=0) + 1)))
    for one, value in zip(sums, (weight, weight * slope[:, 0], weight * slope[:, 1]), strict=True):
        np.add.at(one, tuple(place.T), value)
    total, *moments = (convolve(one, np.ones((3, 3)), mode="constant")[tuple(place.T)] for one in sums)
    return np.column_stack(moments) / np.maximum(total, 1)[:, None]


def _surround(offsets: FloatArray, starts: IntArray) -> BoolArray:
    """(g,) whether points lie on all sides of the middle: a plane is not carried on beyond them."""
    least, most = np.minimum.reduceat(offsets, starts, axis=0), np.maximum.reduceat(offsets, starts, axis=0)
    return np.asarray(np.all((least < -0.1 * CELL) & (most > 0.1 * CELL), axis=1))


def mounting_words(one: Mapping[str, Any]) -> tuple[str, str]:
    """`laser.boresight roll` and `0.0100 ± 0.0001 rad` of an entry of the JSON's `found`."""
    unit = {"laser.boresight": "rad", "laser.lever_arm": "m", "laser.time_offset": "s"}[one["effect"]]
    part = "" if one["component"] == "b" else f" {one['component']}"
    value = f"{one['value']:.4f} ± {one['std']:.4f} {unit}" if one["determined"] else "not determined by these strips"
    return f"{one['effect']}{part}", value
