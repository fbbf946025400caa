"""Whether a sequence of normalised residuals is white."""

from __future__ import annotations

import numpy as np
from scipy import stats

from sensors.arrays import FloatArray

MOST_LAGS = 20


def whiteness(z: FloatArray) -> tuple[float, float] | None:
    """Largest autocorrelation over the first lags and the p-value of Ljung and Box's statistic; None for few rows, or
    zeros.

    Source: G. M. Ljung, G. E. P. Box, Biometrika 65 (1978) 297.
    """
    n = len(z)
    lags = min(MOST_LAGS, n // 5)
    if lags < 1:
        return None
    z = z - z.mean(axis=0)
    power = float(np.sum(z**2))
    if power == 0.0:
        return None
    rho = np.array([np.sum(z[k:] * z[:-k]) / power for k in range(1, lags + 1)])
    size = z.shape[1]
    q = n * (n + 2) * size * np.sum(rho**2 / (n - np.arange(1, lags + 1)))
    return float(rho[np.argmax(np.abs(rho))]), float(stats.chi2.sf(q, lags))
