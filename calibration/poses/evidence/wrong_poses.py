"""Single readings that a least-squares fit would be better without, however few readings there are.

A wrong reading among some twenty bends the fit towards itself, two hide each other. What tells them is the residual
that a fit without them leaves at them, in units of its own sigma (the externally studentised residual), and the drop
of the sum of squares when they go, against all other sets of as many readings (Bonferroni).
Source: R. D. Cook, S. Weisberg, "Residuals and Influence in Regression" (1982), chapters 2.2 and 3.6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special, stats

from sinan.estimator.evidence.score import log_p_value
from sinan.sensors.arrays import BoolArray, FloatArray

#: A reading is wrong when it is off by this many sigma of what the others leave, as 2 norm.sf(6) = 1 in 5e8 Gaussian
#: readings are; where the sigma is estimated, by the size of the t variable that is as rare.
WRONG = 6.0
#: At most so many of the readings are wrong singly, and every pair is tried where there are no more than these: bound
#: of work (`bounds_of_work poses`).
_MOST_SHARE, _ALL_PAIRS = 0.1, 200
#: Readings that the rest must have beyond its parameters: of five the sigma is known to 1 / sqrt(10), a third.
_LEAST_FREEDOM = 5
#: One reading that the others hardly predict cannot be called wrong: from this share of itself that its own residual
#: keeps, where the others predict it to sqrt(0.95 / 0.05) = 4.4 sigma: a choice, half and twice of which change nothing
#: of the poses of an accelerometer (`bounds_of_work poses`).
_LEAST_OWN_SHARE = 0.05


@dataclass(frozen=True)
class Deleted:
    """Readings to leave out.

    Attributes
    ----------
    rows : (n,) which
    gain : drop of the sum of squares, in units of the noise that the rest shows, at least of the declared one
    log_p : of that drop, times the number of sets of as many readings
    """

    rows: BoolArray
    gain: float
    log_p: float


def wrong_poses(residual: FloatArray, fitted: FloatArray, measured: BoolArray, known: bool) -> Deleted:
    """The readings that are wrong by `WRONG` sigma, each about the fit without all of them.

    They are taken out one by one, the one that brings most first; where one alone brings little, two may together. The
    sigma is that of what the rest leaves; heavy tails and structure make it as large as its ninth decile has it.

    Parameters
    ----------
    residual, fitted : (n,), (n, p) at one point of linearisation, whitened; rows that state priors among them
    measured : (n,) rows that are readings
    known : whether the noise is declared, so that a residual of one is one sigma
    """
    n = int(np.sum(measured))
    most = min(max(int(_MOST_SHARE * n), 2), 20)
    fit = _LeftOut(residual, fitted)
    none = Deleted(np.zeros(len(residual), dtype=bool), 0.0, 0.0)
    sets: list[list[int]] = [[]]
    if 8 <= n <= _ALL_PAIRS:
        sets.append(_best_pair(fit, measured))
    best = none
    for begin in sets:
        chosen = list(begin)
        while True:
            found = _judged(fit, measured, chosen, n, known) if chosen else none
            if found is not None and found.log_p < best.log_p:
                best = found
            if len(chosen) >= most or (len(chosen) > 1 and found is None):
                break
            more = _next(fit, measured, chosen)
            if more is None:
                break
            chosen.append(more)
    return best


class _LeftOut:
    """A linear fit from which rows D are taken out: with H = Q Q' and e = (I - H) r of all rows, W = (I - H_DD)^-1,

    residual e + H_D W e_D, variance 1 - (h + diag H_D W H_D') of those that stay; W e_D and diag W of those in D.
    """

    def __init__(self, residual: FloatArray, fitted: FloatArray) -> None:
        scaled = fitted / np.maximum(np.linalg.norm(fitted, axis=0), 1e-300)
        values, vectors = np.linalg.eigh(scaled.T @ scaled)
        seen = values > 1e-12 * max(float(values[-1]), 1e-300)
        self.Q = np.linalg.qr(scaled @ vectors[:, seen])[0]
        self.e = residual - self.Q @ (self.Q.T @ residual)
        self._own = 1.0 - np.einsum("np,np->n", self.Q, self.Q)

    def without(self, out: list[int]) -> tuple[FloatArray, FloatArray]:
        """Residual of every row about the fit to the rows that stay, and its variance: 1 - h there, 1 + h elsewhere."""
        if not out:
            return self.e, self._own
        cross, W = self.Q @ self.Q[out].T, self.weight(out)
        left = self.e + cross @ (W @ self.e[out])
        variance = self._own - np.einsum("nd,de,ne->n", cross, W, cross)
        left[out], variance[out] = W @ self.e[out], np.diag(W)
        return left, variance

    def weight(self, out: list[int]) -> FloatArray:
        """(d, d) W, the covariance of what the rest leaves of the rows taken out."""
        return np.asarray(np.linalg.pinv(np.eye(len(out)) - self.Q[out] @ self.Q[out].T, hermitian=True))

    def gain(self, out: list[int]) -> float:
        """Drop of the sum of squares when the rows go: e_D' W e_D."""
        return float(self.e[out] @ self.weight(out) @ self.e[out])


def _next(fit: _LeftOut, measured: BoolArray, out: list[int]) -> int | None:
    """The reading whose deletion would bring most."""
    left, variance = fit.without(out)
    able = measured & (variance > _LEAST_OWN_SHARE)
    able[out] = False
    gain = np.where(able, left**2 / np.maximum(variance, 1e-12), -1.0)
    k = int(np.argmax(gain))
    return k if gain[k] > 0.0 else None


def _best_pair(fit: _LeftOut, measured: BoolArray) -> list[int]:
    """The two readings whose deletion together brings most."""
    index = np.flatnonzero(measured)
    r, H = fit.e[index], fit.Q[index] @ fit.Q[index].T
    own = 1.0 - np.diag(H)
    det = own[:, None] * own[None, :] - H**2
    gain = (r[:, None] ** 2 * own[None, :] + r[None, :] ** 2 * own[:, None] + 2.0 * H * np.outer(r, r)) / np.where(
        det > _LEAST_OWN_SHARE**2, det, np.inf
    )
    np.fill_diagonal(gain, -1.0)
    i, j = np.unravel_index(int(np.argmax(gain)), gain.shape)
    return [int(index[i]), int(index[j])]


def _judged(fit: _LeftOut, measured: BoolArray, out: list[int], n: int, known: bool) -> Deleted | None:
    """The set with its evidence; None where one of it is not wrong about the rest."""
    left, variance = fit.without(out)
    stay = measured.copy()
    stay[out] = False
    usual = np.abs(left[stay]) / np.sqrt(np.maximum(variance[stay], _LEAST_OWN_SHARE))
    freedom = float(np.sum(variance[stay]))
    if freedom < _LEAST_FREEDOM:
        return None
    sigma = float(np.sqrt(np.sum(left[stay] ** 2) / freedom))
    sigma = max(sigma, float(np.quantile(usual, 0.9)) / float(stats.norm.isf(0.05)))
    sigma = max(sigma, 1.0) if known else max(sigma, np.finfo(float).tiny)
    size = np.abs(left[out]) / np.sqrt(np.maximum(variance[out], 1.0)) / sigma
    rare = WRONG if known else float(stats.t.isf(stats.norm.sf(WRONG), freedom))
    if np.any(size < rare):
        return None
    gain, k = fit.gain(out) / sigma**2, len(out)
    sets = float(special.gammaln(n + 1) - special.gammaln(k + 1) - special.gammaln(n - k + 1))
    share = (freedom + k) / (freedom + gain)  # of the noise that the rest has in that of all
    log_p = log_p_value(gain, k) if known else log_p_value(share * gain, k, freedom + k)
    rows = np.zeros(len(measured), dtype=bool)
    rows[out] = True
    return Deleted(rows, gain, min(log_p + sets, 0.0))
