"""How large the noise of a stream is in the residual that a model leaves, in units of the declared noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sinan.estimator.evidence.source import Fit, Source, StreamResidual
from sinan.sensors.bounds import ASSUMED

#: Lags of the correlation that is summed until it is nothing: bound of work (`bounds_of_work flight`).
_LAGS = 500
#: A residual is slow where its sum over long times varies this many times as much as that of white noise: a
#: choice, half and twice of which change nothing of a late GPS (`bounds_of_work brief`).
_SLOW = 1.1


def noise_left(source: Source, fit: Fit, stream: str, slow: bool) -> float:
    """Variance over the declared one of the streams in which an effect on a stream shows: its own, or for one on the
    IMU the largest of all. At least 1: noise smaller than declared is not believed. Where none is declared, the size of
    the residual is the unit already, and what is left to say is how slow it is.

    Parameters
    ----------
    slow : of the sum over long times, for what lasts: times 1 + 2 sum rho
    """
    residuals = source.residuals(fit)
    mine = [r for r in residuals if r.stream == stream] or [r for r in residuals if r.stream not in ASSUMED]
    known = source.noise_known
    units = [1.0 if known else max(r.nis_per_dof, 1e-300) for r in mine]
    sizes = [_long_run_variance(r) if slow else r.nis_per_dof for r in mine]
    return max([1.0, *(size / unit for size, unit in zip(sizes, units, strict=True))])


def slow_streams(residuals: Sequence[StreamResidual]) -> tuple[str, ...]:
    """The streams whose residual adds up over long times to more than white noise would."""
    return tuple(
        r.stream for r in residuals if len(r.t) > 1 and _long_run_variance(r) > _SLOW * max(r.nis_per_dof, 1e-300)
    )


def _long_run_variance(r: StreamResidual) -> float:
    """Mean square of the whitened residual times 1 + 2 sum rho, until rho is within 2 sigma of zero."""
    z = r.centred
    power, total = float(np.sum(z**2)), 1.0
    for lag in range(1, min(_LAGS, len(z) // 4)):
        rho = float(np.sum(z[lag:] * z[:-lag])) / max(power, 1e-300)
        if rho <= 2.0 / np.sqrt(np.sum(r.dof)):  # no larger than that of white noise may be
            break
        total += 2.0 * rho
    return r.nis_per_dof * total
