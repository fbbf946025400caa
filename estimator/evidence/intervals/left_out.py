"""Whether functions that explain readings also predict readings that they were not fitted to.

Of a linear model with flat priors the readings D that were left out have, given the rest, the predictive density

    -2 log p(D | rest) = SSE(all) - SSE(rest) + log |J'J (all)| - log |J'J (rest)|        (noise of one)

and Student's with the same parts where the noise level is estimated: what a fit through few readings predicts is wide,
and costs little where it is wrong. Source: S. Geisser, W. F. Eddy, J. American Statistical Association 74 (1979) 153.
"""

from __future__ import annotations

import numpy as np
from scipy import special, stats

from sinan.sensors.arrays import BoolArray, FloatArray, IntArray

#: Prior precision of every parameter, so that directions that the rest does not see are not infinite: bound of work
#: (`bounds_of_work poses`).
_RIDGE = 1e-9


def log_p_left_out(residual: FloatArray, given: FloatArray, added: FloatArray, fold: IntArray, known: bool) -> float:
    """Logarithm of the p-value that `added` predicts nothing: Student's t of the gains over the folds, one-sided.

    Parameters as of `gains_left_out`.
    """
    gains = gains_left_out(residual, given, added, fold, known)
    if len(gains) < 2:
        return 0.0
    t = np.mean(gains) / max(float(np.std(gains, ddof=1)) / np.sqrt(len(gains)), 1e-300)
    return float(stats.t.logsf(t, len(gains) - 1))


def gains_left_out(
    residual: FloatArray, given: FloatArray, added: FloatArray, fold: IntArray, known: bool
) -> FloatArray:
    """(folds,) by how much `added` lowers -2 log of the predictive density of each fold, given the others.

    Parameters
    ----------
    residual : (n,) whitened
    given, added : (n, p), (n, q) columns that are fitted anyway, and those in question
    fold : (n,) 0, 1, ...; negative: left out never
    known : whether the noise is declared; it is then not believed to be smaller than that, but may be larger
    """
    both = np.hstack([given, added])
    noise = 1.0
    if known:
        sse, _ = _fitted(residual, both, np.ones(len(residual), dtype=bool))
        noise = max(sse / max(len(residual) - both.shape[1], 1), 1.0)
    without, jointly = (_deviances(residual, J, fold, noise if known else None) for J in (given, both))
    return without - jointly


def _deviances(residual: FloatArray, J: FloatArray, fold: IntArray, noise: float | None) -> FloatArray:
    """(folds,) -2 log predictive density; `noise` None: estimated."""
    J = J / np.maximum(np.linalg.norm(J, axis=0), np.finfo(float).tiny)
    n, p = J.shape
    sse, log_det = _fitted(residual, J, np.ones(n, dtype=bool))
    found = []
    for k in range(int(fold.max()) + 1):
        rest = fold != k
        sse_rest, log_det_rest = _fitted(residual, J, rest)
        spread = log_det - log_det_rest
        if noise is not None:
            found.append((sse - sse_rest) / noise + spread)
            continue
        dof, dof_rest = max(n - p, 1), max(int(np.sum(rest)) - p, 1)
        scale = 2.0 * (special.gammaln(0.5 * dof_rest) - special.gammaln(0.5 * dof))
        found.append(dof * np.log(max(sse, 1e-300)) - dof_rest * np.log(max(sse_rest, 1e-300)) + spread + scale)
    return np.array(found)


def _fitted(residual: FloatArray, J: FloatArray, rows: BoolArray) -> tuple[float, float]:
    """Sum of squares that a fit to some rows leaves, and the logarithm of the determinant of its information."""
    A, r = J[rows], residual[rows]
    values, vectors = np.linalg.eigh(A.T @ A)
    values = np.maximum(values, 0.0) + _RIDGE
    score = vectors.T @ (A.T @ r)
    return float(r @ r - np.sum(score**2 / values)), float(np.sum(np.log(values)))
