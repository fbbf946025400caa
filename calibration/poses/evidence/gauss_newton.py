"""The least squares of a linear problem over its nuisance parameters and the effects."""

from __future__ import annotations

import numpy as np

from sinan.calibration.poses.evidence.linear_problem import LinearProblem, Rows
from sinan.estimator.evidence.gauss_newton import least
from sinan.estimator.evidence.term import Term
from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.errors import InputError

#: Points, and halvings of a step, at most: bound of work (`bounds_of_work poses`).
_MOST_STEPS, _MOST_HALVINGS = 100, 11
#: Relative gain of a step at which the sum of squares is at its minimum: bound of work (`bounds_of_work poses`).
_SETTLED = 1e-10


def minimise(
    problem: LinearProblem, x: FloatArray, beta: dict[Term, FloatArray], active: BoolArray
) -> tuple[FloatArray, dict[Term, FloatArray], FloatArray]:
    """Minimum over nuisance and beta, and the information matrix there (scaled columns are used inside).

    Raises
    ------
    InputError : the parameters have gone where the model has no number
    """
    moving = [term for term in beta if term.in_mean]
    ends = np.cumsum([len(x), *(len(beta[term]) for term in moving)])[:-1]

    def parts(vector: FloatArray) -> tuple[FloatArray, dict[Term, FloatArray]]:
        x, *moved = np.split(vector, ends)
        return x, {**beta, **dict(zip(moving, moved, strict=True))}

    def at(vector: FloatArray) -> tuple[FloatArray, Rows]:
        return vector, problem.rows(*parts(vector), ())

    def slopes(rows: Rows) -> FloatArray:
        J = np.hstack([rows.nuisance, *[rows.effects[term.key] for term in moving]])[active]
        if not np.all(np.isfinite(J)):
            raise np.linalg.LinAlgError
        return np.asarray(J)

    def step(there: tuple[FloatArray, Rows]) -> tuple[FloatArray, int]:
        J = slopes(there[1])
        scale = np.maximum(np.linalg.norm(J, axis=0), np.finfo(float).tiny)
        return np.linalg.lstsq(J / scale, there[1].residual[active], rcond=1e-10)[0] / scale, _MOST_HALVINGS

    def cost(there: tuple[FloatArray, Rows]) -> float:
        return float(np.sum(there[1].residual[active] ** 2))

    try:
        with np.errstate(all="ignore"):  # a step too far is halved; where the start is, that is an error
            start = np.concatenate([x, *(beta[term] for term in moving)])
            vector, rows = least(at(start), cost, step, lambda there, step: at(there[0] + step), _MOST_STEPS, _SETTLED)
            J = slopes(rows)
    except np.linalg.LinAlgError:
        expected = "readings that the sensor's model can explain"
        raise InputError(problem.where, "a fit that does not converge", expected) from None
    return *parts(vector), J.T @ J
