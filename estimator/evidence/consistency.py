"""Whether the filter's own covariance tells the truth: NEES, NIS, whiteness, and what the innovations follow.

Every statistic comes with the interval in which it lies, by chance alone, with a stated probability.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.layout import StateLayout, size_of
from sinan.sensors.arrays import FloatArray

LEVEL = 0.99  # probability of the intervals: a stated risk of 1 % each, the `alpha` of a trace
BLOCK_NAMES = {
    "position": "position", "velocity": "velocity", "attitude": "attitude",
    "b_accel": "accel bias", "b_gyro": "gyro bias",
    "b_mag": "mag bias", "b_gps": "gps bias", "b_baro": "baro bias", "b_sonar": "sonar bias", "b_laser": "laser bias",
}  # fmt: skip


@dataclass(frozen=True)
class Statistic:
    """A mean square per degree of freedom and its interval under a filter that tells the truth.

    Attributes
    ----------
    mean : per degree of freedom
    interval : of the mean, at `LEVEL`
    dof : degrees of freedom that it sums
    """

    mean: float
    interval: tuple[float, float]
    dof: int

    @property
    def consistent(self) -> bool:
        """Whether the mean lies in its interval."""
        return self.interval[0] <= self.mean <= self.interval[1]


def chi_square(total: float, dof: int, level: float = LEVEL) -> Statistic:
    """A sum of squares that should be chi-square with `dof`, per degree of freedom, with its two-sided interval."""
    from scipy.special import chdtri

    if dof == 0:
        return Statistic(float("nan"), (float("nan"), float("nan")), 0)
    tail = 0.5 * (1.0 - level)
    return Statistic(total / dof, (float(chdtri(dof, 1.0 - tail)) / dof, float(chdtri(dof, tail)) / dof), dof)


def nis(journal: Journal, level: float = LEVEL) -> Mapping[str, Statistic]:
    """Mean NIS per degree of freedom by sensor, over the readings that were used."""
    used, dof = journal.accepted, journal.dof
    table = {}
    for s, name in enumerate(journal.sensors):
        mine = used & (journal.sensor == s)
        table[name] = chi_square(float(np.sum(journal.nis[mine])), int(np.sum(dof[mine])), level)
    return table


def nees(error: FloatArray, P: FloatArray) -> float:
    """dx' P^-1 dx of one error (n,) with its covariance (n, n)."""
    return float(error @ np.linalg.solve(P, error))


def nees_by_block(
    error: FloatArray, P: FloatArray, layout: StateLayout, translation: bool = True
) -> Mapping[str, float]:
    """NEES of each block, each with its own part of P, and `overall`; `translation` as in the model."""
    names = [name for name in layout.names if translation or name not in ("position", "velocity")]
    rows = np.concatenate([np.arange(layout.n)[layout.slice(name)] for name in names])
    table = {"overall": nees(error[rows], P[np.ix_(rows, rows)])}
    for name in names:
        part = layout.slice(name)
        table[BLOCK_NAMES[name]] = nees(error[part], P[part, part])
    return table


def block_dof(layout: StateLayout, translation: bool = True) -> Mapping[str, int]:
    """Degrees of freedom of each entry of `nees_by_block`."""
    names = [name for name in layout.names if translation or name not in ("position", "velocity")]
    return {"overall": sum(size_of(n) for n in names), **{BLOCK_NAMES[n]: size_of(n) for n in names}}


def coverage(error: FloatArray, sigma: FloatArray) -> Mapping[str, float]:
    """Share of components within 1, 2 and 3 sigma; 0.683, 0.954, 0.997 if all is well."""
    ratio = np.abs(error) / sigma
    return {str(k): float(np.mean(ratio <= k)) for k in (1, 2, 3)}


@dataclass(frozen=True)
class Whiteness:
    """Autocorrelation of the whitened innovations of one component.

    Attributes
    ----------
    correlation : (lags,) at lags 1, 2, ...
    bound : two-sided bound of one correlation under whiteness, at `LEVEL`
    statistic, p_value : Ljung and Box's, chi-square with as many degrees of freedom as lags
    """

    correlation: FloatArray
    bound: float
    statistic: float
    p_value: float


def autocorrelation(white: FloatArray, lags: int = 20) -> Whiteness:
    """Ljung-Box test of one component (k,). Source: G. M. Ljung, G. E. P. Box, Biometrika 65(2), 1978, eq. 3."""
    from scipy.special import chdtrc, ndtri

    k = len(white)
    lags = min(lags, max(1, k // 4))
    if k < 8:
        return Whiteness(np.full(lags, np.nan), float("nan"), float("nan"), float("nan"))
    e = white - np.mean(white)
    size = max(1, 1 << int(np.ceil(np.log2(2 * k))))
    spectrum = np.fft.rfft(e, size)
    covariance = np.fft.irfft(spectrum * spectrum.conj(), size)[: lags + 1]
    r = covariance[1:] / covariance[0]
    statistic = float(k * (k + 2) * np.sum(r**2 / (k - np.arange(1, lags + 1))))
    return Whiteness(r, float(ndtri(0.5 * (1 + LEVEL)) / np.sqrt(k)), statistic, float(chdtrc(lags, statistic)))
