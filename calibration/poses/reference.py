"""Calibration against an external reference: directions measured otherwise. Unlike a norm it determines T whole.

A norm says how long the calibrated reading is. A turntable, a known angle or the attitude that a log gives say where it
points, too: then a rotation of the axes has an effect on the residual, and the course's three angles are found.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.calibration.poses.least_squares import LeastSquaresFit, solve
from sinan.sensors.arrays import FloatArray, as_floats
from sinan.sensors.errors import InputError
from sinan.sensors.rotation import rotate, rotate_back

_AXIS = "xyz"
_OFF_DIAGONAL = tuple((i, j) for i in range(3) for j in range(3) if i != j)
#: Rows of a log that are looked at, evenly over it: the shape is then known to 1 / sqrt(800), 4 % of the noise.
_MOST_ROWS = 800
#: Plausible scale, offset, entry of T [1] and angle of the field [rad]: of an MPU-6050 +-3 %, +-50 to 80 mg and +-2 %
#: (data sheet); the field as `levels.fields.FIELD_STD`.
_SIZES = (0.05, 0.05, 0.05, 0.1)


@dataclass(frozen=True)
class ReferenceCalibration:
    """Result: `calibrated = T @ K @ (reading + offset + current * d)`.

    Attributes
    ----------
    T : (3, 3) axes, unit diagonal
    K : (3,) scale
    offset : (3,) in the unit of the reading
    current : (3,) d [unit of the reading per A], zero without a current
    direction : (3,) unit vector of the true quantity in the reference's frame; NaN where it was given
    fit : behind it; residuals in the unit of the reading, of one axis after the other
    """

    T: FloatArray
    K: FloatArray
    offset: FloatArray
    current: FloatArray
    direction: FloatArray
    fit: LeastSquaresFit

    def apply(self, reading: FloatArray, current: FloatArray | None = None) -> FloatArray:
        """(n, 3) calibrated readings; `current` (n,) [A]."""
        shift = 0.0 if current is None else current[:, None] * self.current
        return (reading + self.offset + shift) * self.K @ self.T.T


def small_rotation(angles: FloatArray) -> FloatArray:
    """(3, 3) the course's T of three small angles, ordered as its unknowns: about z, about y, about x [rad]."""
    psi, theta, phi = angles
    return np.array([[1.0, psi, -theta], [-psi, 1.0, phi], [theta, -phi, 1.0]])


def three_angles(T: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The antisymmetric part of T as the course's three angles (psi, theta, phi) [rad], and what it cannot say.

    Returns
    -------
    (3,) angles; (3,) the symmetric part's entries xy, xz, yz: axes that are not at right angles
    """
    half = 0.5 * (T - T.T)
    symmetric = 0.5 * (T + T.T)
    return np.array([half[0, 1], -half[0, 2], half[1, 2]]), np.array([symmetric[i] for i in ((0, 1), (0, 2), (1, 2))])


def calibrate_directions(
    readings: FloatArray, truth: FloatArray, antisymmetric: bool = False, sigma: float | None = None
) -> ReferenceCalibration:
    """Calibrate a three-axis sensor whose true reading is known as a vector, from a turntable or known angles.

    min sum |(T K)^-1 truth - b - reading|^2

    Parameters
    ----------
    readings : (n, 3)
    truth : (n, 3) what it should have read
    antisymmetric : T as the course writes it, with three angles; else all six entries
    sigma : white noise of one reading per axis; None: estimated from the residuals

    Neglects what the norm calibration neglects, and every error of the reference.

    Raises
    ------
    InputError : fewer readings than unknowns
    """
    readings = as_floats("readings", readings, (None, 3))
    truth = as_floats("truth", truth, (len(readings), 3))
    size = float(np.mean(np.linalg.norm(truth, axis=1)))
    turns = 3 if antisymmetric else 6
    _require_rows(readings, 6 + turns)

    def residual(x: FloatArray) -> FloatArray:
        M = _axes(x[6:], antisymmetric) * x[:3]
        return np.asarray(truth @ np.linalg.inv(M).T - x[3:6] - readings).T.ravel()

    names = _names(antisymmetric)
    plausible = np.concatenate([np.full(3, _SIZES[0]), np.full(3, _SIZES[1] * size), np.full(turns, _SIZES[2])])
    start = np.concatenate([np.ones(3), np.zeros(3 + turns)])
    fit = solve(residual, "2-point", start, names, plausible, sigma=sigma)
    x = fit.x
    return ReferenceCalibration(_axes(x[6:], antisymmetric), x[:3], x[3:6], np.zeros(3), np.full(3, np.nan), fit)


def calibrate_by_attitude(
    readings: FloatArray, q_nb: FloatArray, norm: float, current: FloatArray | None = None
) -> ReferenceCalibration:
    """Calibrate a magnetometer (or an accelerometer at rest) by the attitude that a log gives.

    min sum |(T K)^-1 C_bn n(a, d) norm - b - d I - reading|^2,  n = (cos d cos a, cos d sin a, sin d)

    The field's direction in the reference's frame is found too: its heading may have any zero.

    Parameters
    ----------
    readings : (n, 3)
    q_nb : (n, 4) attitude at their stamps
    norm : length that a calibrated reading shall have
    current : (n,) A; None: no effect of a current

    Neglects errors of the attitude, which are most of the residual of a log whose own filter made it.

    Raises
    ------
    InputError : fewer readings than unknowns
    """
    readings = as_floats("readings", readings, (None, 3))
    chosen = np.unique(np.linspace(0, len(readings) - 1, _MOST_ROWS).astype(np.int64))
    r, q = readings[chosen], q_nb[chosen]
    amperes = np.zeros(len(r)) if current is None else current[chosen]
    extra = 0 if current is None else 3
    _require_rows(r, 14 + extra)
    size = float(np.mean(np.linalg.norm(r, axis=1)))
    seen = np.mean(rotate(q, r), axis=0)
    start = np.concatenate([np.full(3, norm / size), np.zeros(9), _angles_of(seen), np.zeros(extra)])

    def residual(x: FloatArray) -> FloatArray:
        M = _axes(x[6:12], False) * x[:3]
        expected = rotate_back(q, norm * _unit(x[12:14])[None]) @ np.linalg.inv(M).T - x[3:6]
        if extra:
            expected = expected - amperes[:, None] * x[14:17]
        return np.asarray(expected - r).T.ravel()

    names = (*_names(False), "declination", "dip", *[f"current {a}" for a in _AXIS[:extra]])
    kinds = np.repeat([_SIZES[0] * norm / size, _SIZES[1] * size, _SIZES[2], _SIZES[3]], [3, 3, 6, 2])
    plausible = np.concatenate([kinds, np.full(extra, 0.01 * size)])
    fit = solve(residual, "2-point", start, names, plausible)
    x = fit.x
    d = x[14:17] if extra else np.zeros(3)
    return ReferenceCalibration(_axes(x[6:12], False), x[:3], x[3:6], d, _unit(x[12:14]), fit)


def _names(antisymmetric: bool) -> tuple[str, ...]:
    turns = ("psi", "theta", "phi") if antisymmetric else tuple(f"T_{_AXIS[i]}{_AXIS[j]}" for i, j in _OFF_DIAGONAL)
    return (*(f"scale {a}" for a in _AXIS), *(f"offset {a}" for a in _AXIS), *turns)


def _axes(entries: FloatArray, antisymmetric: bool) -> FloatArray:
    if antisymmetric:
        return small_rotation(entries)
    T = np.eye(3)
    for value, entry in zip(entries, _OFF_DIAGONAL, strict=True):
        T[entry] = value
    return T


def _unit(angles: FloatArray) -> FloatArray:
    a, d = angles
    return np.array([np.cos(d) * np.cos(a), np.cos(d) * np.sin(a), np.sin(d)])


def _angles_of(v: FloatArray) -> FloatArray:
    return np.array([np.arctan2(v[1], v[0]), np.arctan2(v[2], np.hypot(v[0], v[1]))])


def _require_rows(readings: FloatArray, unknowns: int) -> None:
    if 3 * len(readings) < unknowns:
        raise InputError(
            "readings", f"{len(readings)} readings", f"at least {-(-unknowns // 3)} for {unknowns} unknowns"
        )
