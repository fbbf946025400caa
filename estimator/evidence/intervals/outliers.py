"""Single wrong readings among those that a log has, before any is left out or thinned: those far from their neighbours.

A reading's distance from its neighbours, each less what the motion says, in units of what is usual around it, follows
Student's t where nothing is wrong, however heavy its tail; where a share of the readings is wrong, those that are alone
follow a mixture of that law and of a much wider one. Both are fitted; the ratio of their likelihoods decides. What
moves the neighbours, too, is of the first law in both.

Source of the mixture: G. E. P. Box, G. C. Tiao, "A Bayesian approach to some outlier problems", Biometrika 55 (1968)
119; its wider law is here in the place of their known factor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize, special

from sinan.estimator.evidence.score import log_p_value
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray

#: Neighbours on either side whose median a reading is held against, and on either side whose distances are usual. Of 30
#: wrong readings among 3000 they find 29, and 3 others; half of the first 23 and none, twice, and half and twice of the
#: second, 29 or 30 and 3 (measured: `bounds_of_work outliers`).
_NEAR, _USUAL = 3, 20
#: A distance is never less usual than this share of the log's own; half and twice find 29 and 30, and 4 and 2 others
#: (measured: `bounds_of_work outliers`).
_LEAST_USUAL = 0.5
#: A wrong reading is alone: from the neighbours of either side it is off by this share of its distance. What moves them
#: too, a step or a disturbance, is not. A choice: half of it finds the same of 30 wrong readings, and of twice, which
#: asks more than the distance, none is alone: it finds none (`bounds_of_work outliers`).
_ALONE = 0.5
#: Of a normal law, its standard deviation over its median absolute value: 1 / norm.ppf(0.75).
_OF_MEDIAN = 1.4826
#: Bounds of how much wider wrong readings scatter than the others; half and twice find 29 and 28, and 3 and 2 others
#: (measured: `bounds_of_work outliers`).
_FACTOR = (5.0, 1e3)
#: Fewer readings have no law: a choice. Half finds wrong readings in 6 of 30 streams of 30, none of them false, and
#: twice no more those of 80, 8 of 30 (`bounds_of_work few`).
_LEAST = 50
#: Parameters of the mixture besides those of the law without wrong readings, of which there are two: share and spread.
ADDED = 2


@dataclass(frozen=True)
class WrongReadings:
    """What one stream has of them.

    Attributes
    ----------
    row : (k,) of the wrong readings
    readings : how many there are
    gain : by how much the mixture lowers -2 log L
    log_p : logarithm of the p-value of that
    """

    row: IntArray
    readings: int
    gain: float
    log_p: float

    @property
    def share(self) -> float:
        """Of the readings that are wrong."""
        return len(self.row) / self.readings


def wrong_among(error: FloatArray) -> WrongReadings | None:
    """The wrong readings of a stream; None where it has too few, or all are as good as equal.

    Parameters
    ----------
    error : (n, m) readings less what the motion says, in time order, each reading once
    """
    if len(error) < _LEAST:
        return None
    distances = _distances(error)
    if distances is None:
        return None
    distance, either = distances
    is_alone = either > _ALONE * distance
    m = error.shape[1]
    plain = _fit(distance, m)
    mixed = _fit(distance, m, is_alone, plain[1])
    gain = 2.0 * (mixed[0] - plain[0])
    wrong = _is_wrong(distance, m, mixed[1]) & is_alone
    return WrongReadings(np.flatnonzero(wrong), len(error), gain, log_p_value(gain, ADDED))


def _distances(error: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """(n,) distance of each reading from the median of its neighbours on both sides, and the lesser of those from the
    neighbours of one side, in units of what is usual around it.
    """
    from scipy.ndimage import median_filter

    padded = np.pad(error, ((_NEAR, _NEAR), (0, 0)), mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * _NEAR + 1, axis=0)
    before, after = around[..., :_NEAR], around[..., _NEAR + 1 :]
    away = [error - np.median(part, axis=2) for part in (np.concatenate([before, after], axis=2), before, after)]
    size = np.abs(away[0])
    whole = np.median(size, axis=0)
    if np.any(whole <= 0.0):  # most readings are the same: only their quantum could be said
        return None
    usual = np.maximum(median_filter(size, size=(2 * _USUAL + 1, 1), mode="nearest"), _LEAST_USUAL * whole)
    both, *sides = (np.linalg.norm(part / (_OF_MEDIAN * usual), axis=1) for part in away)
    return both, np.minimum(*sides)


def _log_student(r: FloatArray, m: int, log_scale: float, log_nu: float) -> FloatArray:
    """Logarithm of the density of m components at distance r, by Student's law."""
    nu, z = np.exp(log_nu), r * np.exp(-log_scale)
    constant = special.gammaln(0.5 * (nu + m)) - special.gammaln(0.5 * nu) - 0.5 * m * np.log(nu * np.pi)
    return np.asarray(constant - m * log_scale - 0.5 * (nu + m) * np.log1p(z**2 / nu))


def _log_normal(r: FloatArray, m: int, log_scale: float) -> FloatArray:
    """The same by the normal law."""
    return np.asarray(-0.5 * m * np.log(2.0 * np.pi) - m * log_scale - 0.5 * (r * np.exp(-log_scale)) ** 2)


def _parts(r: FloatArray, m: int, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Logarithms of the densities of right and of wrong readings, each times its share."""
    log_scale, log_nu, logit, log_factor = x
    right = _log_student(r, m, log_scale, log_nu) + special.log_expit(-logit)
    return right, _log_normal(r, m, log_scale + log_factor) + special.log_expit(logit)


def _fit(
    r: FloatArray, m: int, is_alone: BoolArray | None = None, first: FloatArray | None = None
) -> tuple[float, FloatArray]:
    """Largest log likelihood and (2,) or (4,) logarithms of scale and degrees of freedom, logit of the share of wrong
    readings, logarithm of their spread.

    Parameters
    ----------
    is_alone : (n,) which readings may be wrong; None: none is
    first : (2,) where to begin, too
    """
    bounds = [(-5.0, 5.0), (0.0, np.log(1e3))]
    starts = [np.array([0.0, np.log(nu)]) for nu in (3.0, 30.0)]
    if is_alone is not None:
        bounds += [(special.logit(1e-5), special.logit(0.2)), (np.log(_FACTOR[0]), np.log(_FACTOR[1]))]
        starts = [np.array([*s, special.logit(0.01), np.log(12.0)]) for s in [*starts, first] if s is not None]

    def cost(x: FloatArray) -> float:
        if is_alone is None:
            return -float(np.sum(_log_student(r, m, *x)))
        right, wrong = _parts(r, m, x)
        return -float(np.sum(np.where(is_alone, np.logaddexp(right, wrong), right)))

    found = [optimize.minimize(cost, start, method="L-BFGS-B", bounds=bounds) for start in starts]
    best = min(found, key=lambda one: one.fun)
    return -float(best.fun), np.asarray(best.x)


def _is_wrong(r: FloatArray, m: int, x: FloatArray) -> BoolArray:
    """Which readings are likelier wrong than right."""
    right, wrong = _parts(r, m, x)
    return np.asarray(wrong > right)
