"""Many small symmetric systems at once: Cholesky's method with the systems along the last axis.

A library call a system costs a microsecond or two; here every step of the elimination is one vector operation over all
systems, which is ten times faster for thousands of systems of four to nine unknowns.
"""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray

SMALLEST_PIVOT = 1e-13  # of the diagonal, below which a system is singular: rounding leaves some 30 eps = 7e-15


def cholesky(N: FloatArray) -> FloatArray:
    """Lower factors L with N = L L'; NaN for systems that are singular or not positive definite.

    Parameters
    ----------
    N : (m, m, systems), symmetric; the lower triangle is read

    Returns
    -------
    (m, m, systems), zero above the diagonal
    """
    m = len(N)
    L = np.zeros_like(N)
    for j in range(m):
        pivot = N[j, j] - np.einsum("ks,ks->s", L[j, :j], L[j, :j])
        good = pivot > SMALLEST_PIVOT * N[j, j]
        L[j, j] = np.where(good, np.sqrt(np.where(good, pivot, 1.0)), np.nan)
        for i in range(j + 1, m):
            L[i, j] = (N[i, j] - np.einsum("ks,ks->s", L[i, :j], L[j, :j])) / L[j, j]
    return L


def substitute(L: FloatArray, right: FloatArray) -> FloatArray:
    """Solve L L' x = right for (m, k, systems) right-hand sides."""
    m = len(L)
    y = np.empty_like(right)
    for i in range(m):
        y[i] = (right[i] - np.einsum("js,jks->ks", L[i, :i], y[:i])) / L[i, i]
    for i in reversed(range(m)):
        y[i] = (y[i] - np.einsum("js,jks->ks", L[i + 1 :, i], y[i + 1 :])) / L[i, i]
    return y


def inverse(N: FloatArray) -> tuple[FloatArray, BoolArray]:
    """(m, m, systems) inverses, identity for the singular ones, and (systems,) which are regular."""
    identity = np.eye(len(N))[:, :, None]
    L = cholesky(N)
    regular = np.isfinite(np.einsum("iis->is", L)).all(axis=0)
    L = np.where(regular, L, identity)
    return substitute(L, np.broadcast_to(identity, N.shape)), np.asarray(regular)
