"""Strips that overlap show how the laser is mounted: the surfaces of two strips have to be one."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from sinan.experiments.mapping.cloud import Mounting, Scans, placed
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray, runs_of
from sinan.sensors.motion import Motion

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
#: Cells whose plane leaves more than so many times the median are edges of something.
ROUGH = 2.0
PASSES, ROBUST = 6, 3.0
#: Differences for the derivatives, in plausible sizes.
STEP = 1e-3


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


def fit_strips(scans: Scans, motion: Motion, strip: IntArray, start: Mounting | None = None) -> StripFit | None:
    """Boresight, lever arm and time offset with which overlapping strips agree best; None: none overlap.

    In every cell each strip is a plane; the difference of the heights of two planes in the cell's middle is linear in
    the parameters, d + (J_A - J_B) beta, J the mean over the points of n . dp/dbeta, n = (-slope, 1). Weighted least
    squares with plausible sizes as a prior, differences beyond `ROBUST` robust sigmas of less weight, repeated.

    Parameters
    ----------
    scans, motion : of the flight
    strip : (n,) of each scan
    start : what is declared, about which a plausible size is the prior; default: nothing

    Source: C. K. Toth, Strip adjustment, in: J. Shan, C. Toth, Topographic Laser Ranging and Scanning, 2nd ed.
    Neglects boresight yaw, and errors of the trajectory, which differ from strip to strip.
    """
    size, start = np.array([entry[2] for entry in SOUGHT]), start or Mounting()
    first = np.array([*start.boresight, *start.lever_arm[:2], start.time_offset])
    beta, up = first.copy(), float(start.lever_arm[2])
    keep = np.isfinite(scans.ranges) & (strip >= 0)[:, None]
    label = np.broadcast_to(strip[:, None], keep.shape)[keep]
    before = after = 0.0
    sigma = size.copy()
    count = 0
    for turn in range(PASSES):
        difference, J, share = _differences(scans, motion, beta, up, size, keep, label)
        count = len(difference)
        if count < 4 * len(beta):
            return None
        robust = 1.4826 * float(np.median(np.abs(difference)))
        after = float(np.sqrt(np.mean(np.minimum(np.abs(difference), ROBUST * robust) ** 2)))
        before = after if turn == 0 else before
        scaled = J * size  # parameters in plausible sizes
        step = np.zeros(len(beta))
        for _ in range(8):
            left = difference + scaled @ step
            noise = max(1.4826 * float(np.median(np.abs(left))), 1e-4)
            weight = share * np.minimum(1.0, ROBUST * noise / np.maximum(np.abs(left), 1e-12)) / noise**2
            information = scaled.T @ (scaled * weight[:, None]) + np.eye(len(beta))
            step = -np.linalg.solve(information, scaled.T @ (weight * difference) + (beta - first) / size)
        sigma = size * np.sqrt(np.diag(np.linalg.inv(information)))
        beta = beta + size * step
        if np.all(np.abs(size * step) < 0.05 * sigma):
            break
    return StripFit(mounting_of(beta, up), beta, sigma, before, after, count)


def _differences(
    scans: Scans, motion: Motion, beta: FloatArray, up: float, size: FloatArray, keep: BoolArray, label: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(k,) height differences of two strips in a cell [m], (k, 5) their derivatives, and (k,) what each counts: of n
    strips in a cell n - 1 differences are independent, of n (n - 1) / 2.
    """
    p = placed(scans, motion, mounting_of(beta, up))[keep]
    slopes = np.empty((len(p), 3, len(beta)))
    for k in range(len(beta)):
        one = np.zeros(len(beta))
        one[k] = STEP * size[k]
        ahead, behind = (placed(scans, motion, mounting_of(b, up))[keep] for b in (beta + one, beta - one))
        slopes[..., k] = (ahead - behind) / (2.0 * one[k])
    planes = _planes(p, slopes, label)
    differences, rows, shares = [], [], []
    for entries in planes.values():
        for (height_a, row_a), (height_b, row_b) in combinations(entries, 2):
            differences.append(height_a - height_b)
            rows.append(row_a - row_b)
            shares.append(2.0 / len(entries))
    return np.array(differences), np.array(rows).reshape(len(rows), len(beta)), np.array(shares)


def _planes(
    p: FloatArray, slopes: FloatArray, label: IntArray
) -> dict[tuple[int, int], list[tuple[float, FloatArray]]]:
    """By cell, of every strip the height of its plane in the cell's middle and its derivative."""
    cell = np.floor(p[:, :2] / CELL).astype(np.int64)
    key = np.column_stack([cell, label])
    order = np.lexsort(key.T)
    key = key[order]
    starts = np.flatnonzero(np.any(np.diff(key, axis=0, prepend=key[:1] - 1) != 0, axis=1))
    found = []
    for first, last in zip(starts, [*starts[1:], len(key)], strict=True):
        if last - first < POINTS:
            continue
        rows = order[first:last]
        middle = (key[first, :2] + 0.5) * CELL
        design = np.column_stack([np.ones(len(rows)), p[rows, :2] - middle])
        up = -p[rows, 2]
        plane, _, rank, _ = np.linalg.lstsq(design, up, rcond=1e-6)
        if rank < 3 or not _surrounds(design[:, 1:]):
            continue
        rough = float(np.sqrt(np.mean((design @ plane - up) ** 2)))
        normal = np.array([-plane[1], -plane[2], -1.0])  # of up - plane, in NED
        solver = np.linalg.pinv(design)[0]  # what the height in the middle is of the points
        derivative = solver @ np.einsum("i,mik->mk", normal, slopes[rows])
        found.append((tuple(key[first, :2]), rough, float(plane[0]), derivative))
    limit = ROUGH * float(np.median([rough for _, rough, _, _ in found])) if found else 0.0
    planes: dict[tuple[int, int], list[tuple[float, FloatArray]]] = {}
    for place, rough, height, derivative in found:
        if rough <= limit:
            planes.setdefault((int(place[0]), int(place[1])), []).append((height, derivative))
    return planes


def _surrounds(offsets: FloatArray) -> bool:
    """Whether points lie on all sides of the middle: a plane is not carried on beyond them."""
    return bool(np.all(np.min(offsets, axis=0) < -0.1 * CELL) and np.all(np.max(offsets, axis=0) > 0.1 * CELL))
