"""A bias that wanders during a calibration, as nuisance parameters with a prior: knots of a random walk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray

#: Knots of a bias that walks: bound of work (`bounds_of_work poses`).
_MOST_KNOTS = 40
#: Root of the variance that a walk adds over the whole time, in units of the white noise, as it is tried:
#: bound of work (`bounds_of_work walk`).
_WALKS = np.concatenate([[0.0], np.geomspace(0.1, 300.0, 36)])


@dataclass(frozen=True)
class BiasWalk:
    """Piecewise linear bias about its value at the first knot; increments are N(0, walk^2 dt).

    Attributes
    ----------
    t : (knots,) s; one knot: the bias is constant
    walk : random-walk density [unit/sqrt(s)]
    """

    t: FloatArray
    walk: float

    @property
    def size(self) -> int:
        """Number of nuisance parameters: three axes at every knot but the first."""
        return 3 * (len(self.t) - 1)

    def weights(self, t: FloatArray) -> FloatArray:
        """(n, knots - 1) share of each knot's value in the bias at the instants t."""
        W = np.stack([np.interp(t, self.t, row) for row in np.eye(len(self.t))], axis=1)
        return W[:, 1:]

    def value(self, t: FloatArray, x: FloatArray) -> FloatArray:
        """(n, 3) bias at the instants t, of the parameters x (knots - 1, 3) flattened."""
        if len(self.t) == 1:
            return np.zeros((len(t), 3))
        values = np.vstack([np.zeros(3), x.reshape(-1, 3)])
        return np.stack([np.interp(t, self.t, column) for column in values.T], axis=1)

    def derivative(self, t: FloatArray, by_bias: FloatArray) -> FloatArray:
        """(n, ..., 3 (knots - 1)) of something whose derivative by the bias at its own instant is (n, ..., 3)."""
        W = self.weights(t)
        shape = (len(t), *([1] * (by_bias.ndim - 2)), W.shape[1], 1)
        return (W.reshape(shape) * by_bias[..., None, :]).reshape(*by_bias.shape[:-1], self.size)

    def prior(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rows that state the prior of the increments: residual (size,), derivative (size, size), time (size,)."""
        knots = len(self.t) - 1
        if knots == 0:
            return np.zeros(0), np.zeros((0, 0)), np.zeros(0)
        D = (np.eye(knots) - np.eye(knots, k=-1)) / (self.walk * np.sqrt(np.diff(self.t)))[:, None]
        rows: FloatArray = np.asarray(np.kron(D, np.eye(3)), dtype=np.float64)
        return -rows @ x, rows, np.repeat(0.5 * (self.t[1:] + self.t[:-1]), 3)


def bias_walk(t: FloatArray, walk: float | None) -> BiasWalk:
    """Knots at the instants of the readings, at most `_MOST_KNOTS`; one knot where no walk is declared."""
    if not walk:
        return BiasWalk(t[:1], 0.0)
    if len(t) <= _MOST_KNOTS:
        return BiasWalk(t, walk)
    return BiasWalk(np.linspace(t[0], t[-1], _MOST_KNOTS), walk)


def walk_covariance(t: FloatArray, lasting: FloatArray | float = 0.0) -> FloatArray:
    """(n, n) covariance of the means of a unit random walk over windows about the instants t, from the first one on.

    Parameters
    ----------
    lasting : (n,) length of the windows [s], which do not overlap: a mean's variance is that of its middle less T / 6
    """
    start = float(np.min(t - 0.5 * np.asarray(lasting)))
    return np.asarray(np.minimum.outer(t - start, t - start) - np.diag(np.zeros(len(t)) + lasting) / 6.0)


def estimated_walk(residual: FloatArray, fitted: FloatArray, offset: FloatArray, t: FloatArray) -> tuple[float, float]:
    """Size of the white noise, in units of the one stated, and random-walk density of a bias that nobody declared.

    residual = fitted @ x + sum_t offset b(t) + noise, by restricted maximum likelihood over the ratio of the two.

    Parameters
    ----------
    residual : (n,) divided by the stated white noise
    fitted : (n, p) what is fitted besides
    offset : (n, 3) derivative by a constant bias, in the residual's unit per unit of the bias
    t : (n,) s

    Source: H. D. Patterson, R. Thompson, Biometrika 58 (1971) 545.
    """
    K = (offset @ offset.T) * walk_covariance(t)
    size = float(np.trace(K)) / max(len(t), 1)
    if size <= 0.0 or len(t) <= fitted.shape[1] + 2:
        return 1.0, 0.0
    # contrasts without the fitted columns have a likelihood of their own
    left, values, _ = np.linalg.svd(fitted, full_matrices=True)
    free = left[:, int(np.sum(values > 1e-10 * values[0])) :]
    spectrum, vectors = np.linalg.eigh(free.T @ K @ free / size)
    power = (vectors.T @ (free.T @ residual)) ** 2
    variances = 1.0 + _WALKS[:, None] ** 2 * np.maximum(spectrum, 0.0)
    white = np.mean(power / variances, axis=1)
    best = int(np.argmin(np.sum(np.log(variances), axis=1) + len(power) * np.log(np.maximum(white, 1e-300))))
    sigma = float(np.sqrt(white[best]))
    return sigma, float(sigma * _WALKS[best] / np.sqrt(size))
