"""Gauss-Newton over the nuisance parameters and the effects of a linear problem, with halved steps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sinan.calibration.poses.evidence.linear_problem import LinearProblem, Rows
from sinan.estimator.evidence.term import Term
from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.errors import InputError


def minimise(
    problem: LinearProblem, x: FloatArray, beta: dict[Term, FloatArray], active: BoolArray
) -> tuple[FloatArray, dict[Term, FloatArray], FloatArray]:
    """Minimum over nuisance and beta, and the information matrix there (scaled columns are used inside).

    Raises
    ------
    InputError : the parameters have gone where the model has no number
    """
    try:
        with np.errstate(all="ignore"):  # a step too far is halved; where the start is, that is an error
            return _gauss_newton(problem, x, beta, active)
    except np.linalg.LinAlgError:
        raise _astray(problem) from None


def _gauss_newton(
    problem: LinearProblem, x: FloatArray, beta: dict[Term, FloatArray], active: BoolArray
) -> tuple[FloatArray, dict[Term, FloatArray], FloatArray]:
    moving = [term for term in beta if term.in_mean]
    rows = problem.rows(x, beta, ())
    cost = float(np.sum(rows.residual[active] ** 2))
    for _ in range(50):
        J = _slopes(problem, rows, moving, active)
        scale = np.maximum(np.linalg.norm(J, axis=0), np.finfo(float).tiny)
        step = np.linalg.lstsq(J / scale, rows.residual[active], rcond=1e-10)[0] / scale
        size = float(np.linalg.norm(J @ step))
        for _ in range(12):
            x_new, beta_new = x + step[: len(x)], dict(beta)
            column = len(x)
            for term in moving:
                beta_new[term] = beta[term] + step[column : column + len(beta[term])]
                column += len(beta[term])
            try:
                rows_new = problem.rows(x_new, beta_new, ())
                cost_new = float(np.sum(rows_new.residual[active] ** 2))
            except np.linalg.LinAlgError:
                cost_new = np.inf
            if np.isfinite(cost_new) and cost_new <= cost * (1 + 1e-12) + 1e-300:
                break
            step = 0.5 * step
        else:
            break
        x, beta, rows, done = x_new, beta_new, rows_new, cost - cost_new <= 1e-10 * max(cost_new, 1e-300)
        cost = cost_new
        if done or size**2 <= 1e-10 * max(cost, 1e-300):
            break
    J = _slopes(problem, rows, moving, active)
    return x, beta, J.T @ J


def _slopes(problem: LinearProblem, rows: Rows, moving: Sequence[Term], active: BoolArray) -> FloatArray:
    """The rows in use by nuisance and beta."""
    J = np.hstack([rows.nuisance, *[rows.effects[term.key] for term in moving]])[active]
    if not np.all(np.isfinite(J)):
        raise _astray(problem)
    return np.asarray(J)


def _astray(problem: LinearProblem) -> InputError:
    expected = "readings that the sensor's model can explain"
    return InputError(problem.where, "a fit that does not converge", expected)
