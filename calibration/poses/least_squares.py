"""Least squares with a covariance, singular values, and a sentence for every direction that the data leave open."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError

#: A gyroscope's calibration settles within three to ten evaluations, in 50 or so where turns about one axis leave most
#: of it open; one that takes so many never does: bound of work (`bounds_of_work turns`).
_MOST_EVALUATIONS = 200
#: Below this share of the largest singular value (of the column-scaled Jacobian) a direction is rounding, not data. The
#: Jacobian is accurate to about 1e-15 in each entry; summing n rows keeps that; 1e-9 = 1e6 * 1e-15 leaves six digits.
_RANK_TOLERANCE = 1e-9


@dataclass(frozen=True)
class LeastSquaresFit:
    """The solution of a least-squares problem.

    Attributes
    ----------
    x : (parameters,) solution
    covariance : (parameters, parameters); infinite variance along directions that the data do not determine
    singular_values : (parameters,) of the Jacobian with its columns scaled by the plausible sizes, largest first
    undetermined : a sentence for each direction that the data do not determine
    residual : (n,) at the solution
    sse_before, sse : sum of squared residuals at the start and at the solution
    sigma : standard deviation of one residual that the covariance is based on; NaN, and so is the covariance, where it
        was not given and as few residuals as parameters leave nothing to estimate it from
    """

    x: FloatArray
    covariance: FloatArray
    singular_values: FloatArray
    undetermined: tuple[str, ...]
    residual: FloatArray
    sse_before: float
    sse: float
    sigma: float

    @property
    def std(self) -> FloatArray:
        """(parameters,) 1-sigma; infinite where undetermined."""
        return np.sqrt(np.diag(self.covariance))


def solve(
    residual: Callable[[FloatArray], FloatArray],
    jacobian: Callable[[FloatArray], FloatArray] | Literal["2-point"],
    start: FloatArray,
    names: Sequence[str],
    plausible: FloatArray,
    bounds: tuple[FloatArray, FloatArray] | None = None,
    sigma: float | None = None,
    sse_before: float | None = None,
    where: str | None = None,
) -> LeastSquaresFit:
    """Minimise the sum of squared residuals by Levenberg and Marquardt's method, within bounds.

    MINPACK's method knows no bounds; where its solution leaves them, a trust-region method repeats the fit within them.

    Parameters
    ----------
    residual : x -> (n,)
    jacobian : x -> (n, parameters), analytic; "2-point" for differences, which benchmarks compare with
    start : (parameters,) where to begin
    names : of the parameters, for the sentences
    plausible : (parameters,) plausible 1-sigma sizes; they scale the columns, so that directions compare
    bounds : lower and upper limits, each (parameters,)
    sigma : standard deviation of a residual where it is known; else it is estimated from the residuals
    sse_before : the sum of squares to report as "before", where that is not the one at `start`
    where : how messages call the readings of a fit that has to settle soon; None: as long as it takes

    Raises
    ------
    InputError : the fit has to settle and does not

    Source: J. J. More, "The Levenberg-Marquardt algorithm", 1978; `scipy.optimize.least_squares`, "lm" and "trf".
    """
    from scipy.optimize import least_squares

    options = {"jac": jacobian, "x_scale": plausible, "xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-12}
    low, high = bounds if bounds is not None else (np.full(len(start), -np.inf), np.full(len(start), np.inf))
    if len(residual(start)) >= len(start):
        most = None if where is None else _MOST_EVALUATIONS
        result = least_squares(residual, start, method="lm", max_nfev=most, **options)
        if where is not None and result.status == 0:
            found = f"a fit of {len(names)} parameters that does not settle"
            raise InputError(where, found, "more readings, or such as the sensor's model can explain")
        inside = bool(np.all((low < result.x) & (result.x < high)))
    else:
        inside = False
    if not inside:
        result = least_squares(residual, start, method="trf", bounds=(low, high), **options)
    r, J = result.fun, np.asarray(result.jac)
    sse = float(r @ r)
    J = np.asarray(np.linalg.qr(J, mode="r"))  # the same singular values and normal equations in a few rows
    values, sentences, rank = undetermined_directions(J, names, plausible)
    if sigma is None:
        sigma = float(np.sqrt(sse / (len(r) - rank))) if len(r) > rank else np.nan
    before = float(np.sum(residual(start) ** 2)) if sse_before is None else sse_before
    covariance = covariance_of(J, plausible, sigma)
    return LeastSquaresFit(result.x, covariance, values, sentences, r, before, sse, sigma)


def undetermined_directions(
    J: FloatArray, names: Sequence[str], plausible: FloatArray
) -> tuple[FloatArray, tuple[str, ...], int]:
    """Singular values of the scaled Jacobian, a sentence for each null direction, and the rank.

    J diag(plausible) = U S V';  a column of V whose singular value is rounding names parameters that can be changed
    together without any change of the residuals.
    """
    values, vt = _scaled_svd(J, plausible)
    null = values <= _RANK_TOLERANCE * max(values[0], np.finfo(float).tiny)
    sentences = tuple(_sentence(v, names) for v in _readable_basis(vt[null].T).T)
    return values, sentences, int(np.sum(~null))


def covariance_of(J: FloatArray, plausible: FloatArray, sigma: float) -> FloatArray:
    """sigma^2 (J'J)^-1 through the singular values; infinite variance where a direction is not seen."""
    values, vt = _scaled_svd(J, plausible)
    seen = values > _RANK_TOLERANCE * max(values[0], np.finfo(float).tiny)
    v = vt[seen].T
    covariance = sigma**2 * (v / values[seen] ** 2) @ v.T
    share = np.sum(vt[~seen] ** 2, axis=0)
    lost = share > 1e-6  # of the parameter's direction, squared; rounding leaves 1e-18
    covariance = covariance * np.outer(plausible, plausible)
    covariance[lost, :] = covariance[:, lost] = 0.0
    covariance[lost, lost] = np.inf
    return covariance


def _scaled_svd(J: FloatArray, plausible: FloatArray) -> tuple[FloatArray, FloatArray]:
    """All singular values (zeros included) and right vectors of J diag(plausible), through its triangular factor."""
    R = J * plausible
    if len(R) > R.shape[1]:
        R = np.asarray(np.linalg.qr(R, mode="r"))
    _, s, vt = np.linalg.svd(R, full_matrices=True)
    values = np.zeros(J.shape[1])
    values[: len(s)] = s
    return values, vt


def _readable_basis(null: FloatArray) -> FloatArray:
    """The same null space with as many zeros as it allows (reduced column echelon form, unit columns)."""
    basis = null.copy()
    n, k = basis.shape
    used: list[int] = []
    for j in range(k):
        free = [i for i in range(n) if i not in used]
        pivot = free[int(np.argmax(np.abs(basis[free, j])))]
        used.append(pivot)
        basis[:, j] /= basis[pivot, j]
        for other in range(k):
            if other != j:
                basis[:, other] -= basis[pivot, other] * basis[:, j]
    basis[np.abs(basis) < 1e-7] = 0.0
    return basis / np.maximum(np.linalg.norm(basis, axis=0), np.finfo(float).tiny)


def _sentence(direction: FloatArray, names: Sequence[str]) -> str:
    largest = np.max(np.abs(direction))
    order = [i for i in np.argsort(-np.abs(direction), kind="stable") if abs(direction[i]) > 0.1 * largest]
    if len(order) == 1:
        return f"{names[order[0]]} cannot be determined from these data"
    lead = direction[order[0]]
    relation = "against" if len(order) == 2 else "with"
    others = ", ".join(f"{names[i]} ({direction[i] / lead:+.2g})" for i in order[1:])
    return f"{names[order[0]]} cannot be told {relation} {others}: they can change together without a trace"
