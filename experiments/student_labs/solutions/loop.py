"""Solutions of the lab `loop`."""

from __future__ import annotations

import numpy as np

from sinan.experiments.student_labs.lab import Data, Solution
from sinan.experiments.student_labs.loop import CANDIDATES, NOISE, TRAINED
from sinan.sensors.arrays import FloatArray


def rows(data: Data, late: bool, every: bool = False) -> tuple[FloatArray, FloatArray]:
    """(n, 3) covariates and (n,) residual of the rows that the fit sees, of those held out (late), or of all."""
    use = (data["t"] >= TRAINED) == late if not every else np.full(len(data["t"]), True)
    return np.column_stack([data[c] for c in CANDIDATES])[use], data["residual"][use]


def statistics(data: Data, every: bool = False) -> FloatArray:
    """(3,) by how many variances of the noise the sum of squares falls with each covariate alone."""
    x, r = rows(data, False, every)
    return (x.T @ r) ** 2 / np.sum(x**2, axis=0) / NOISE**2


def effect(data: Data) -> int:
    """Number, from 0, of the covariate that explains most."""
    return int(np.argmax(statistics(data)))


def beta(data: Data, every: bool = False) -> FloatArray:
    """Size of the effect, per unit of its covariate."""
    x, r = rows(data, False, every)
    return np.array([x[:, effect(data)] @ r / np.sum(x[:, effect(data)] ** 2)])


def sigma(data: Data) -> FloatArray:
    """1 sigma of beta."""
    x, _ = rows(data, False)
    return np.array([NOISE / np.linalg.norm(x[:, effect(data)])])


def errors(data: Data, late: bool = True) -> FloatArray:
    """RMS [m] of the residual before and after the effect is taken off."""
    x, r = rows(data, late)
    return np.array([np.sqrt(np.mean(e**2)) for e in (r, r - beta(data) * x[:, effect(data)])])


def remaining(data: Data, projected: bool = True) -> FloatArray:
    """Largest statistic of the other covariates once the effect is there."""
    x, r = rows(data, False)
    known = x[:, effect(data)] / np.linalg.norm(x[:, effect(data)])
    others = np.delete(x, effect(data), axis=1)
    if projected:
        others = others - np.outer(known, known @ others)
    left = r - known * (known @ r)
    return np.array([np.max((others.T @ left) ** 2 / np.sum(others**2, axis=0) / NOISE**2)])


def seconds(data: Data) -> FloatArray:
    """Length [s] of a log in which a tenth of the effect is five sigma."""
    return TRAINED * (50.0 * sigma(data) / beta(data)) ** 2


SOLUTIONS = {
    "statistics": Solution(statistics, (lambda d: statistics(d, True), lambda d: statistics(d) * NOISE**2)),
    "effect": Solution(
        lambda d: np.array([effect(d) + 1.0]),
        (lambda d: np.array([np.argsort(statistics(d))[1] + 1.0]),),
    ),
    "beta": Solution(beta, (lambda d: beta(d, True), lambda d: -beta(d))),
    "sigma": Solution(sigma, (lambda d: sigma(d) ** 2,)),
    "held_out": Solution(errors, (lambda d: errors(d, False),)),
    "remaining": Solution(remaining, (lambda d: remaining(d, False),)),
    "seconds": Solution(seconds, (lambda d: TRAINED * 50.0 * sigma(d) / np.abs(beta(d)),)),
}
