"""Sizes of the noise beside effects that nobody has named yet.

Sizes that are found without an effect that is there make the noise larger by it: a gyroscope that drifts with its
temperature is one whose bias walks. So before a log is asked for effects, its sizes are found with all of them open,
each as large as it plausibly is: those of the largest

    log p(readings | sizes) + log prior + 1/2 b' (Lambda + P^-1)^-1 b - 1/2 log |1 + P Lambda|,

b and Lambda the score and the information of all candidates at once and P the squares of their plausible sizes. The
last two terms integrate over what effects do to readings. Without the last one, sizes would be too small by as much as
so many parameters explain of mere noise; with it they are what restricted maximum likelihood makes of them.

Source: H. D. Patterson, R. Thompson, Biometrika 58(3), 1971, 545; D. A. Harville, J. Am. Stat. Assoc. 72(358), 1977.
Neglects that effects are not linear, and intervals: steps at any time are a walk.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sinan.calibration.levels.levels import Levels
from sinan.calibration.levels.problem import SETTLING, Problem, units_of
from sinan.estimator.filter.flight import Flight
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.recording import Recording

#: Steps of the search at most, and what one gains at least: bound of work (`bounds_of_work beside`).
_MOST_STEPS, _GAINED = 6, 0.05
#: The part of a sigma of sizes over which what effects explain is followed for its slope: bound of work
#: (`bounds_of_work beside`).
_ON = 0.25

#: What all effects at once add to the log-likelihood of a flight, their sizes integrated over.
Explained = Callable[[Flight], float]


def beside_effects(levels: Levels, flight: Flight, effects: Callable[[Flight], Explained]) -> Levels:
    """The likeliest sizes of the noise of a flight with all effects open, near those found without any; these, where no
    model follows. Times stay as they are, and what is said of sizes besides (covariance, posterior) is as without.

    Neglects that a motion found with other noise is another one: effects act along that of the first.

    Parameters
    ----------
    levels : found without effects
    flight : with these levels
    effects : of a flight what they explain, of its readings with the noise of another one
    """
    sizes = [size for size in levels.found if not size.linear]
    if not sizes or levels.covariance is None:
        return levels
    problem = Problem(flight.recording, sizes, levels)
    try:
        search = _Search(problem, flight.recording, effects(flight))
        return problem.levels(search.likeliest(problem.theta(levels), SETTLING if levels.in_excerpts else _MOST_STEPS))
    except (InputError, np.linalg.LinAlgError):
        return levels


class _Search:
    """Quasi-Newton in units in which the log tells all sizes alike and each by itself, as without effects."""

    def __init__(self, problem: Problem, recording: Recording, explained: Explained) -> None:
        self._problem, self._recording, self._explained = problem, recording, explained
        self._low, self._high = np.array([size.bounds for size in problem.sizes]).T
        self._best, self._highest = np.zeros(0), -np.inf

    def likeliest(self, theta: FloatArray, steps: int) -> FloatArray:
        """The sizes of the largest posterior with all effects open that were seen on the way from some.

        Raises
        ------
        InputError, LinAlgError : no model follows from where a step ends, or the log tells sizes by no number
        """
        from scipy.optimize import LinearConstraint, minimize

        unit = units_of(self._problem.information(theta, times=False))
        self._best = theta

        def negative(x: FloatArray) -> float:
            return -self._value(self._inside(unit @ x))

        def slope(x: FloatArray) -> FloatArray:
            here = self._inside(unit @ x)
            return -(unit.T @ self._problem.value_and_gradient(here)[1]) - self._explains_more(here, unit)

        inside = LinearConstraint(unit, self._low, self._high)
        options = {"maxiter": steps, "ftol": _GAINED}
        start = np.linalg.solve(unit, theta)
        minimize(negative, start, jac=slope, method="SLSQP", constraints=inside, options=options)
        return self._best

    def _inside(self, theta: FloatArray) -> FloatArray:
        return np.asarray(np.clip(theta, self._low, self._high))

    def _value(self, theta: FloatArray) -> float:
        """Logarithm of the posterior with all effects open; of what cannot be, far below all."""
        value = self._problem.value(theta) + self._explained_at(theta, -np.inf)
        if value > self._highest:
            self._best, self._highest = theta, value
        return max(value, -1e12)

    def _explains_more(self, here: FloatArray, unit: FloatArray) -> FloatArray:
        """What effects explain more a unit on, by a part of it, also beyond a bound; nothing where no model follows."""
        now = self._explained_at(here, np.nan)
        more = np.array([self._explained_at(here + _ON * one, np.nan) - now for one in unit.T]) / _ON
        return np.nan_to_num(more)

    def _explained_at(self, theta: FloatArray, otherwise: float) -> float:
        try:
            return self._explained(self._problem.levels(theta).flight(self._recording))
        except (InputError, np.linalg.LinAlgError):
            return otherwise
