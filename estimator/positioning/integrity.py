"""What the redundancy of a fix can check: w-test, minimal detectable bias, protection levels, dilution of precision.

Sources: W. Baarda, NGC Publications on Geodesy 2-5 (1968); P. J. G. Teunissen, Testing Theory (2006), 3.3 and 4.5;
R. G. Brown, "A baseline RAIM scheme", ION GPS-92 (protection level from the largest slope).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pymap3d

from sinan.sensors.arrays import BoolArray, FloatArray, IntArray

ALPHA = 1e-3  # false-alarm probability of one w-test (Baarda 1968)
CRITICAL = 3.2905  # |w| that is exceeded with probability ALPHA: norm.isf(ALPHA / 2)
NONCENTRALITY = 17.075  # lambda_0: a bias this strong is found with probability 0.8 at ALPHA (Baarda 1968, nomogram)
COVERAGE = CRITICAL  # sigmas of the noise part of a protection level, probability ALPHA to exceed
LEAST_REDUNDANCY = 1e-6  # redundancy number that is rounding: bound of work (`bounds_of_work ranges`)

UNCHECKED = "four satellites for four unknowns: nothing can be checked"
DETECTION = "one satellite more than unknowns: an error can be seen, but not ascribed to a satellite"
CHECKED = "checked: an error can be seen and ascribed"
FAILED = "the test fails, and no single satellite can be blamed"
UNSOLVED = "no solution"


class Fixed(Protocol):
    """The part of a solution that is tested; `estimator.positioning.point_positioning.Fixes` is one."""

    @property
    def position(self) -> FloatArray:
        """(epochs, 3) ECEF [m]."""

    @property
    def covariance(self) -> FloatArray:
        """(epochs, 3 + clocks, 3 + clocks)."""

    @property
    def used(self) -> BoolArray:
        """(n,) rows that took part."""

    @property
    def residual(self) -> FloatArray:
        """(n,) [m]."""

    @property
    def redundancy(self) -> IntArray:
        """(epochs,) satellites minus unknowns, -1 without a solution."""


@dataclass(frozen=True)
class Integrity:
    """Tests and protection of every epoch.

    Attributes
    ----------
    w : (n,) residual over its own standard deviation; NaN where nothing is redundant or the row took no part
    mdb : (n,) minimal detectable bias of a row [m], found with probability 0.8 at ALPHA; infinite where unchecked
    passed : (epochs,) no |w| above the critical value
    horizontal, vertical : (epochs,) protection levels [m]: position shift by the worst undetected bias, plus noise
    redundancy : (epochs,) satellites minus unknowns, -1 without a solution
    """

    w: FloatArray
    mdb: FloatArray
    passed: BoolArray
    horizontal: FloatArray
    vertical: FloatArray
    redundancy: IntArray

    def statement(self, epoch: int) -> str:
        """In words, what can be checked at an epoch."""
        redundancy = int(self.redundancy[epoch])
        if redundancy < 0:
            return UNSOLVED
        if redundancy == 0:
            return UNCHECKED
        if not self.passed[epoch]:
            return FAILED
        return DETECTION if redundancy == 1 else CHECKED


def check(
    fixes: Fixed,
    satellite_e: FloatArray,
    epoch: IntArray,
    group: IntArray,
    variance: FloatArray,
    field: FloatArray | None = None,
) -> Integrity:
    """Test the residuals of every epoch.

    r_i = 1 - a_i C a_i' / s_i^2        redundancy number, a_i the row of the design matrix
    w_i = v_i / (s_i sqrt(r_i))
    MDB_i = s_i sqrt(lambda_0 / r_i),   shift of the position by it: C a_i' MDB_i / s_i^2

    Parameters
    ----------
    fixes : solution
    satellite_e : (n, 3)
    epoch, group : (n,) index of the epoch and of the clock
    variance : (n,) [m^2]
    field : (n, k) common errors of the solution [m]
    """
    n, epochs = len(epoch), len(fixes.redundancy)
    d = satellite_e - fixes.position[epoch]
    A = np.zeros((n, fixes.covariance.shape[1]))
    A[:, :3] = -d / np.linalg.norm(d, axis=1)[:, None]
    A[np.arange(n), 3 + group] = 1.0
    if field is not None:
        A[:, A.shape[1] - field.shape[1] :] = field
    A[~fixes.used] = 0.0
    P_A = np.matmul(fixes.covariance[epoch], A[..., None])[..., 0]
    redundancy_number = 1.0 - np.sum(A * P_A, axis=1) / variance
    checked = fixes.used & (redundancy_number > LEAST_REDUNDANCY) & (fixes.redundancy[epoch] > 0)
    r = np.where(checked, redundancy_number, np.nan)
    w = np.where(checked, fixes.residual, np.nan) / np.sqrt(variance * r)
    mdb = np.where(checked, np.sqrt(variance * NONCENTRALITY / r), np.inf)
    failed = np.zeros(epochs, dtype=bool)
    np.logical_or.at(failed, epoch[checked], np.abs(w[checked]) > CRITICAL)
    passed = ~failed & (fixes.redundancy >= 0)
    R = east_north_up(fixes.position)
    shift = np.einsum("nij,nj->ni", R[epoch], P_A[:, :3] / variance[:, None])
    shift = shift * np.where(np.isfinite(mdb), mdb, 0.0)[:, None]
    bias = np.zeros((2, epochs))
    for k, size in enumerate((np.hypot(shift[:, 0], shift[:, 1]), np.abs(shift[:, 2]))):
        np.maximum.at(bias[k], epoch[checked], size[checked])
    blind = np.zeros(epochs, dtype=bool)
    np.logical_or.at(blind, epoch[fixes.used], ~checked[fixes.used] & (np.abs(P_A[fixes.used, :3]).max(axis=1) > 1e-9))
    C = R @ fixes.covariance[:, :3, :3] @ np.swapaxes(R, 1, 2)
    noise = COVERAGE * np.sqrt(np.stack([C[:, 0, 0] + C[:, 1, 1], C[:, 2, 2]]))
    level = np.where((fixes.redundancy <= 0) | blind, np.inf, bias + noise)
    return Integrity(w, mdb, passed, level[0], level[1], fixes.redundancy)


def worst_rows(integrity: Integrity, fixes: Fixed, epoch: IntArray) -> IntArray:
    """The row with the largest |w| of each epoch that fails the test and has a redundancy of two or more."""
    size = np.nan_to_num(np.abs(integrity.w))
    candidate = (size > CRITICAL) & (fixes.redundancy[epoch] >= 2)
    largest = np.zeros(len(fixes.redundancy))
    np.maximum.at(largest, epoch, size)
    rows = np.flatnonzero(candidate & (size == largest[epoch]))
    return rows[np.unique(epoch[rows], return_index=True)[1]]


def east_north_up(position: FloatArray) -> FloatArray:
    """(epochs, 3, 3) rotation from ECEF to east, north, up at each position; NaN positions give NaN."""
    latitude, longitude, _ = pymap3d.ecef2geodetic(*position.T, deg=False)
    latitude, longitude = np.atleast_1d(latitude), np.atleast_1d(longitude)
    zero = np.zeros_like(latitude)
    sin_p, cos_p, sin_l, cos_l = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    east = np.stack([-sin_l, cos_l, zero], axis=-1)
    north = np.stack([-sin_p * cos_l, -sin_p * sin_l, cos_p], axis=-1)
    up = np.stack([cos_p * cos_l, cos_p * sin_l, sin_p], axis=-1)
    return np.stack([east, north, up], axis=1)


@dataclass(frozen=True)
class Dilution:
    """Dilution of precision of every epoch: 1-sigma of what for ranges of 1-sigma one; NaN without a solution.

    Attributes
    ----------
    geometric, position, horizontal, vertical, time : (epochs,); `time` is that of the first receiver clock in sight
    """

    geometric: FloatArray
    position: FloatArray
    horizontal: FloatArray
    vertical: FloatArray
    time: FloatArray


def dilution(fixes: Fixed, satellite_e: FloatArray, epoch: IntArray, group: IntArray) -> Dilution:
    """Dilution of precision from the geometry alone: (A' A)^-1 in east, north, up and clocks."""
    epochs, size = len(fixes.redundancy), 4 + int(group.max(initial=0))
    rows = fixes.used
    d = satellite_e[rows] - fixes.position[epoch[rows]]
    A = np.zeros((int(rows.sum()), size))
    A[:, :3] = -d / np.linalg.norm(d, axis=1)[:, None]
    A[np.arange(len(A)), 3 + group[rows]] = 1.0
    N = np.zeros((epochs, size, size))
    np.add.at(N, epoch[rows], A[:, :, None] * A[:, None, :])
    absent = np.diagonal(N, axis1=1, axis2=2) == 0.0
    solved = fixes.redundancy >= 0
    N[~solved] = np.eye(size)
    Q = np.linalg.pinv(N + absent[..., None] * np.eye(size), hermitian=True)
    R = east_north_up(np.where(solved[:, None], fixes.position, np.array([1.0e7, 0.0, 0.0])))
    enu = np.diagonal(R @ Q[:, :3, :3] @ np.swapaxes(R, 1, 2), axis1=1, axis2=2)
    clocks = np.where(absent[:, 3:], 0.0, np.diagonal(Q, axis1=1, axis2=2)[:, 3:])
    first = clocks[np.arange(epochs), np.argmax(clocks > 0.0, axis=1)]
    position = enu.sum(axis=1)
    values = (position + clocks.sum(axis=1), position, enu[:, 0] + enu[:, 1], enu[:, 2], first)
    return Dilution(*(np.where(solved, np.sqrt(np.maximum(value, 0.0)), np.nan) for value in values))
