"""Calibration of a three-axis sensor by constant norm: T K (reading + b). The course, sections 1 and 3.

A static accelerometer sees gravity, a magnetometer turned at one place sees the Earth's field: the length of the
calibrated reading is known, its direction is not. So a rotation of the calibrated axes leaves no trace, and the
course's small rotation T (antisymmetric) cannot be found; the triangular form (non-orthogonality) can.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from sinan.calibration.poses.least_squares import LeastSquaresFit, solve
from sinan.sensors.arrays import FloatArray, as_floats
from sinan.sensors.errors import InputError
from sinan.sensors.rotation import cross, rotation_exp

Axes = Literal["none", "triangular", "full"]
AXES: tuple[Axes, ...] = ("none", "triangular", "full")

#: Entries of T above the diagonal: non-orthogonality of the axes.
UPPER = tuple((i, j) for i in range(3) for j in range(3) if i < j)
_AXIS = "xyz"
_SMALLEST = 1e-60  # of a reading: its fourth power and that of its inverse are numbers, (1e-60)^4 = 1e-240 > 1e-308
#: No accelerometer that is sold is off by so much: initial tolerances are a tenth of it (+-3 %, +-0.08 g: MPU-6050 data
#: sheet). Lengths of readings at rest agree to noise and non-linearity, some percent; those in flight do not.
_LARGEST_SCALE_ERROR, _LARGEST_OFFSET, _LARGEST_RESIDUAL = 0.5, 0.5, 0.1
_PLAUSIBLE_SCALE = 0.05  # 1, of K about its start: initial tolerance of consumer parts is +-3 % (MPU-6050 data sheet)
_PLAUSIBLE_TURN = 0.05  # rad, of the entries of T: cross-axis sensitivity +-2 % and mounting (MPU-6050 data sheet)


@dataclass(frozen=True)
class Calibration:
    """Result of a calibration: `calibrated = T @ K @ (reading + offset)`.

    Attributes
    ----------
    sensor : accel, gyro or mag
    T : (3, 3) axes; NaN where the data do not determine an entry
    K : (3,) scale
    offset : (3,) in the unit of the reading; minus the bias of "reading = truth + bias"
    fit : the least-squares solution behind it
    axes : the form of T
    n : number of readings
    normalised_by : what the readings were divided by before the fit; `K` and `offset` refer to divided readings
    T_seen : (3, 3) a T that explains the data as well as any other: unit upper triangular, no rotation, by convention
    """

    sensor: str
    T: FloatArray
    K: FloatArray
    offset: FloatArray
    fit: LeastSquaresFit
    axes: Axes
    n: int
    normalised_by: float
    T_seen: FloatArray

    @property
    def undetermined(self) -> tuple[str, ...]:
        """A sentence for each direction that the data do not determine."""
        return self.fit.undetermined

    def std(self) -> dict[str, FloatArray]:
        """1-sigma of T (3, 3; zero where fixed, infinite where undetermined), K (3,) and b (3,)."""
        std = self.fit.std
        T = np.zeros((3, 3))
        if self.axes != "none":
            T[np.triu_indices(3, 1)] = std[6:9]
        T[np.isnan(self.T)] = np.inf
        return {"T": T, "K": std[:3], "b": std[3:6]}

    def apply(self, reading: FloatArray) -> FloatArray:
        """(n, 3) calibrated readings, T K (reading / normalised_by + offset)."""
        return (reading / self.normalised_by + self.offset) * self.K @ self.T_seen.T

    def response(self, readings: FloatArray) -> FloatArray:
        """(3 n, 3 n) derivative of the calibrated readings by the readings that the calibration was made from.

        u = T K (r + b) moves with its own reading, and with all of them through the fit: d x = -J^+ d residual, with
        d residual_k = e_k' T K d r_k and e = u / |u|. A change that the calibration takes up whole leaves nothing.

        Parameters
        ----------
        readings : (n, 3) those of the fit, `normalised_by` not divided out
        """
        r = readings / self.normalised_by
        n, x = len(r), np.concatenate([self.fit.x[:9], np.zeros(max(len(self.fit.x) - 9, 0))])
        M = self.T_seen * self.K
        u = (r + self.offset) @ M.T
        e = u / np.linalg.norm(u, axis=1, keepdims=True)
        J = norm_jacobian(x, r)[:, :9]
        by_parameter = np.zeros((n, 3, J.shape[1]))
        by_parameter[:, :, :3] = self.T_seen * (r + self.offset)[:, None, :]
        by_parameter[:, :, 3:6] = M
        for k, (i, j) in enumerate(UPPER[: J.shape[1] - 6]):
            by_parameter[:, i, 6 + k] = (r[:, j] + self.offset[j]) * self.K[j]
        moved = np.einsum("kip,pj,jl->kijl", by_parameter, np.linalg.pinv(J), e @ M)
        own = np.einsum("kj,il->kijl", np.eye(n), M)
        return np.asarray(own - moved).reshape(3 * n, 3 * n) / self.normalised_by


def parameter_names(axes: Axes) -> tuple[str, ...]:
    """Names of the parameters in the order of the solution: scales, offsets, non-orthogonality, rotation."""
    names = tuple(f"scale {a}" for a in _AXIS) + tuple(f"offset {a}" for a in _AXIS)
    if axes != "none":
        names += tuple(f"T_{_AXIS[i]}{_AXIS[j]}" for i, j in UPPER)
    if axes == "full":
        names += tuple(f"rotation about {a}" for a in _AXIS)
    return names


def axes_matrix(x: FloatArray) -> FloatArray:
    """(3, 3) T of a parameter vector: Exp(rotation) times the unit upper triangle; identity where it has neither."""
    T = np.eye(3)
    if len(x) > 6:
        T[np.triu_indices(3, 1)] = x[6:9]
    if len(x) > 9:
        T = rotation_exp(x[9:12]) @ T
    return T


def norm_residual(x: FloatArray, readings: FloatArray, norm: float) -> FloatArray:
    """(n,) |T K (reading + b)| - norm."""
    v = (readings + x[3:6]) * x[:3]
    return np.linalg.norm(v @ axes_matrix(x).T, axis=1) - norm


def norm_jacobian(x: FloatArray, readings: FloatArray) -> FloatArray:
    """(n, parameters) of `norm_residual`.

    With v = K (reading + b), u = T v and e = u / |u|:
    d|u|/dK_i = (T'e)_i (reading + b)_i,  d|u|/db_i = (T'e)_i K_i,  d|u|/dT_ij = (R'e)_i v_j with T = R (upper),
    d|u|/drotation = u x e, which is zero: the data say by themselves that a rotation leaves no trace.
    """
    shifted = readings + x[3:6]
    v = shifted * x[:3]
    T = axes_matrix(x)
    u = v @ T.T
    e = u / np.linalg.norm(u, axis=1, keepdims=True)
    back = e @ T
    columns = [back * shifted, back * x[:3]]
    if len(x) > 6:
        e_upper = e @ rotation_exp(x[9:12]) if len(x) > 9 else e
        columns += [(e_upper[:, i] * v[:, j])[:, None] for i, j in UPPER]
    if len(x) > 9:
        columns.append(cross(u, e))
    return np.concatenate(columns, axis=1)


def ellipsoid_start(readings: FloatArray, norm: float) -> tuple[FloatArray, FloatArray]:
    """Start of K and b from an algebraic fit, good however far off the readings are.

    The axis-aligned ellipsoid sum A_i r_i^2 + B_i r_i = 1 is linear in A and B; a sphere where that is no ellipsoid.
    Source: Q. Li, J. Griffiths, "Least squares ellipsoid specific fitting", GMP 2004 (the algebraic distance).
    """
    mean = readings.mean(axis=0)
    spread = max(float(np.sqrt(np.mean((readings - mean) ** 2))), np.finfo(float).tiny)
    r = (readings - mean) / spread
    if len(r) > 6:
        solution, *_ = np.linalg.lstsq(np.hstack([r**2, r]), np.ones(len(r)), rcond=None)
        A, B = solution[:3], solution[3:]
        if np.all(A > 0.0) and A.max() < 9.0 * A.min():  # an ellipsoid of axes within a factor of three
            centre = -B / (2 * A)
            radius = np.sqrt((1.0 + np.sum(A * centre**2)) / A)
            return norm / (radius * spread), -(mean + centre * spread)
    solution, *_ = np.linalg.lstsq(np.hstack([2 * r, np.ones((len(r), 1))]), np.sum(r**2, axis=1), rcond=None)
    centre = solution[:3]
    radius_squared = solution[3] + centre @ centre
    if not np.all(np.isfinite(centre)) or radius_squared <= 0.0 or np.max(np.abs(centre)) > 10.0:
        return np.full(3, norm / np.mean(np.linalg.norm(readings, axis=1))), np.zeros(3)
    return np.full(3, norm / (np.sqrt(radius_squared) * spread)), -(mean + centre * spread)


def calibrate_norm(
    sensor: str,
    readings: FloatArray,
    norm: float,
    axes: Axes = "none",
    sigma: float | None = None,
    normalised_by: float = 1.0,
    where: str = "readings",
    analytic: bool = True,
) -> Calibration:
    """Calibrate a three-axis sensor whose true reading has a constant norm.

    min sum (|T K (reading + b)| - norm)^2

    Parameters
    ----------
    sensor : accel or mag
    readings : (n, 3) static or slowly turned readings, one direction each
    norm : length of the true reading, in the unit wanted for the calibrated one
    axes : "none": T = I, the course's choice; "triangular": non-orthogonality; "full": all six entries, of which norms
        determine only three combinations: then T is NaN there, and `undetermined` says so
    sigma : white noise of one reading per axis, in its unit; None: estimated from the residuals
    normalised_by : what the readings have been divided by, for the record
    where : how messages call the input
    analytic : use the analytic Jacobian; two-point differences are there for comparison

    Neglects <sensor>.temperature, accel.scale_nonlinearity, mag.current, and everything that changes with time.

    Raises
    ------
    InputError : too few readings, all alike, or a fit that does not converge
    """
    readings = as_floats("readings", readings, (None, 3))
    names = parameter_names(axes)
    determinable = min(len(names), 9)
    if len(readings) < determinable:
        raise InputError(where, f"{len(readings)} readings", f"at least {determinable} in different directions")
    _require_spread(readings, where)
    K0, b0 = ellipsoid_start(readings, norm)
    size = float(np.median(norm / K0))
    turns = np.ones(len(names) - 6)
    fit = solve(
        lambda x: norm_residual(x, readings, norm),
        (lambda x: norm_jacobian(x, readings)) if analytic else "2-point",
        start=np.concatenate([K0, b0, 0.0 * turns]),
        names=names,
        plausible=np.concatenate([_PLAUSIBLE_SCALE * K0, np.full(3, _PLAUSIBLE_SCALE * size), _PLAUSIBLE_TURN * turns]),
        bounds=(
            np.concatenate([0.1 * K0, b0 - 10.0 * size, -turns]),
            np.concatenate([10.0 * K0, b0 + 10.0 * size, turns]),
        ),
        sigma=None if sigma is None else sigma * float(np.mean(K0)),
        sse_before=float(np.sum((np.linalg.norm(readings, axis=1) - norm) ** 2)),
    )
    T_seen = axes_matrix(fit.x[:9])
    _require_centre(readings, (readings + fit.x[3:6]) * fit.x[:3] @ T_seen.T, where)
    T = T_seen.copy()
    if np.any(~np.isfinite(fit.std[9:])):
        T[~np.eye(3, dtype=bool)] = np.nan
    return Calibration(sensor, T, fit.x[:3], fit.x[3:6], fit, axes, len(readings), normalised_by, T_seen)


def require_possible(result: Calibration, norm: float, where: str) -> None:
    """Raise where a fit is no accelerometer's: readings that are no rests are fitted, too, by some ellipsoid.

    Raises
    ------
    InputError : a scale or an offset that no accelerometer has; lengths that differ as those of a moving one do
    """
    K, b = result.K, result.offset * result.K / norm
    left = float(np.sqrt(result.fit.sse / result.n)) / norm
    if np.any(np.abs(K / np.median(K) - 1.0) > _LARGEST_SCALE_ERROR):  # the median is the unit's
        found = f"scales {', '.join(f'{k:.3g}' for k in K)}, which differ by more than half"
    elif np.any(np.abs(b) > _LARGEST_OFFSET):
        found = f"offsets {', '.join(f'{one:.2g}' for one in b)} of gravity"
    elif left > _LARGEST_RESIDUAL:
        found = f"readings whose length is {left:.0%} of gravity off after the fit (RMS)"
    else:
        return
    expected = "one reading of a sensor at rest a row, in many attitudes"
    raise InputError(where, f"{found}: no accelerometer that rests", expected)


def _require_centre(readings: FloatArray, calibrated: FloatArray, where: str) -> None:
    """Raise if the fit ran away: seen from far outside, all readings have one length and one direction.

    A norm with free scales and offsets has a second minimum at infinity. Readings in a narrow cone slide there; those
    that surround their centre do not.
    """

    def spread(v: FloatArray) -> float:
        e = v / np.linalg.norm(v, axis=1, keepdims=True)
        return float(np.sqrt(np.sum(np.var(e, axis=0))))

    if spread(calibrated) < 0.5 * spread(readings):
        expected = "readings all round the sphere, or the attitude of each (`sinan lab reference` shows both)"
        raise InputError(where, "directions too much alike to fix scale and offset", expected)


def _of_size(largest: float) -> str:
    """What readings of a size that no sensor has are called."""
    return "readings that are all 0" if largest == 0.0 else f"readings of at most {largest:.3g}"


def _require_spread(readings: FloatArray, where: str) -> None:
    """Raise if all readings point the same way: nothing can be calibrated then; or if their squares are no numbers."""
    largest = float(np.max(np.abs(readings)))
    if not _SMALLEST < largest < 1.0 / _SMALLEST:
        raise InputError(where, _of_size(largest), "readings of a sensor that works")
    centred = readings - readings.mean(axis=0)
    size = np.max(np.linalg.norm(readings, axis=1))
    spread = np.sqrt(np.linalg.eigvalsh(centred.T @ centred / len(readings))[-1])
    if spread < 0.02 * size:  # under about one degree of turn
        raise InputError(where, "all readings point the same way", "readings in different directions (turn the sensor)")
