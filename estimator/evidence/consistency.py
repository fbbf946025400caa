"""Whether the filter's own covariance tells the truth: NEES and NIS.

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
#: What the blocks of states are called in reports, all of `layout.blocks`.
BLOCK_NAMES = {
    "position": "position", "velocity": "velocity", "attitude": "attitude",
    "b_accel": "accel bias", "b_gyro": "gyro bias",
    "b_mag": "mag bias", "b_gps": "gps bias", "b_baro": "baro bias", "b_sonar": "sonar bias", "b_laser": "laser bias",
    "c_mag": "mag colour", "c_gps": "gps colour", "c_gps_velocity": "gps velocity colour", "c_baro": "baro colour",
    "c_sonar": "sonar colour", "c_laser": "laser colour", "c_zero_rate": "zero rate colour",
    "s_gyro": "gyro axes", "s_mag": "mag axes", "field": "field",
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
    used, dof = journal.accepted, journal.freedom
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
