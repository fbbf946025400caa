"""A bias that wanders during a calibration, as nuisance parameters with a prior: knots of a random walk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sensors.arrays import FloatArray

_MOST_KNOTS = 40


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
