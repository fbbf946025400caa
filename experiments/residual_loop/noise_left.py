"""How large the noise of a stream is in the residual that a model leaves, in units of the declared noise."""

from __future__ import annotations

import numpy as np

from experiments.residual_loop.source import Fit, Source, StreamResidual

_LAGS = 500


def noise_left(source: Source, fit: Fit, stream: str, slow: bool) -> float:
    """Variance over the declared one of the streams in which an effect on a stream shows: its own, or for one on the
    IMU the largest of all. At least 1: noise smaller than declared is not believed.

    Parameters
    ----------
    slow : of the sum over long times, for what lasts: times 1 + 2 sum rho
    """
    residuals = source.residuals(fit)
    mine = [r for r in residuals if r.stream == stream] or [r for r in residuals if r.stream != "level"]
    return max([1.0, *(_long_run_variance(r) if slow else r.nis_per_dof for r in mine)])


def _long_run_variance(r: StreamResidual) -> float:
    """Mean square of the whitened residual times 1 + 2 sum rho, until rho is within 2 sigma of zero."""
    z = r.whitened - r.whitened.mean(axis=0)
    power, total = float(np.sum(z**2)), 1.0
    for lag in range(1, min(_LAGS, len(z) // 4)):
        rho = float(np.sum(z[lag:] * z[:-lag])) / max(power, 1e-300)
        if rho <= 2.0 / np.sqrt(z.size):  # no larger than that of white noise may be
            break
        total += 2.0 * rho
    return r.nis_per_dof * total
