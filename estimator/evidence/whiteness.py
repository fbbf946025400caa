"""Whether a sequence of normalised residuals is white."""

from __future__ import annotations

import numpy as np
from scipy import stats

from sinan.sensors.arrays import FloatArray

#: Lags of the test of Ljung and Box: 20 at most (Box, Jenkins, Reinsel, Time Series Analysis, 3rd edition, 1994).
MOST_LAGS = 20


def autocorrelation(z: FloatArray, lags: int) -> FloatArray:
    """(lags,) of rows z (n, size) whose mean is zero, all components together, from lag 1 on; zeros: zero."""
    power = max(float(np.sum(z**2)), np.finfo(float).tiny)
    return np.array([np.sum(z[k:] * z[:-k]) / power for k in range(1, lags + 1)])


def whiteness(z: FloatArray, told: float | None = None) -> tuple[float, float] | None:
    """Largest autocorrelation over the first lags and the p-value of Ljung and Box's statistic; None for few rows, or
    zeros.

    Parameters
    ----------
    z : (n, size)
    told : components of a row on average that are readings at all, the others being zero; None: all

    Source: G. M. Ljung, G. E. P. Box, Biometrika 65 (1978) 297.
    """
    n = len(z)
    lags = min(MOST_LAGS, n // 5)
    if lags < 1:
        return None
    z = z - z.mean(axis=0)
    if float(np.sum(z**2)) == 0.0:
        return None
    rho = autocorrelation(z, lags)
    size = z.shape[1] if told is None else told
    q = n * (n + 2) * size * np.sum(rho**2 / (n - np.arange(1, lags + 1)))
    return float(rho[np.argmax(np.abs(rho))]), float(stats.chi2.sf(q, lags))
