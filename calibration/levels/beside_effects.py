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
from dataclasses import dataclass, replace

import numpy as np

from sinan.calibration.levels.levels import Levels
from sinan.calibration.levels.problem import SETTLED, Problem
from sinan.estimator.filter.flight import Flight
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError

#: Steps of the search, and trials of each, halved after one, at most: bound of work (`bounds_of_work beside`).
_MOST_STEPS, _MOST_TRIALS = 2, 4

#: What all effects at once add to the log-likelihood of a flight, their sizes integrated over.
Explained = Callable[[Flight], float]


def beside_effects(levels: Levels, flight: Flight, explained: Explained) -> Levels:
    """The likeliest sizes of the noise of a flight with all effects open, near those found without any. Times stay as
    they are, and how well sizes are known is said as it was.

    Parameters
    ----------
    levels : found without effects
    flight : with these levels
    explained : of the same readings, with the noise of another flight

    Raises
    ------
    InputError : as `explained` does, of the flight as it is
    """
    free = [k for k, size in enumerate(levels.found) if not size.linear]
    if not free or levels.covariance is None:
        return levels
    search = _Search(levels, flight, free, explained)
    best = search.first
    for _ in range(_MOST_STEPS):
        higher = search.uphill(best)
        if higher is None:
            break
        best, gained = higher, higher.value - best.value
        if gained < SETTLED:
            break
    found = search.problem.levels(best.theta)
    return replace(found, found=levels.found, covariance=levels.covariance, log_posterior=levels.log_posterior)


@dataclass(frozen=True, eq=False)
class _Point:
    """Sizes, in spreads of their priors, the logarithm of their posterior without effects, and what all effects add."""

    theta: FloatArray
    alone: float
    explained: float

    @property
    def value(self) -> float:
        """Logarithm of the posterior with all effects open."""
        return self.alone + self.explained


class _Search:
    """Newton's method along the axes of the scatter that sizes have without effects, with the exact slope of their
    posterior and differences of one sigma to either side.
    """

    def __init__(self, levels: Levels, flight: Flight, free: list[int], explained: Explained) -> None:
        sizes = [levels.found[k] for k in free]
        self.problem, self._flight, self._explained = Problem(flight.recording, sizes, levels), flight, explained
        self._least, self._most = np.array([size.bounds for size in sizes]).T
        assert levels.covariance is not None
        values, vectors = np.linalg.eigh(levels.covariance[np.ix_(free, free)])
        self._axes = vectors.T * np.sqrt(np.maximum(values, 0.0))[:, None]
        self.first = self._at(self.problem.theta(levels))

    def _at(self, theta: FloatArray) -> _Point:
        theta = np.clip(theta, self._least, self._most)
        noisy = self.problem.levels(theta).flight(self._flight.recording)
        return _Point(theta, self.problem.value(theta), self._explained(noisy))

    def uphill(self, there: _Point) -> _Point | None:
        """The point after a step, halved until it leads up; None: hardly more is to be gained.

        The step is Newton's, of no more than the slope along axes that are flat or bent upwards.
        """
        sides = [[self._beside(there, sign * axis) for sign in (-1.0, 1.0)] for axis in self._axes]
        slope = self._axes @ self.problem.value_and_gradient(there.theta)[1]
        slope += [0.5 * (more.explained - less.explained) for less, more in sides]
        bend = np.array([less.value + more.value - 2.0 * there.value for less, more in sides])
        move = slope / np.maximum(-bend, 1.0)
        if 0.5 * float(slope @ move) < SETTLED:
            return None
        tried = (self._beside(there, 0.5**k * move @ self._axes) for k in range(_MOST_TRIALS))
        return next((one for one in tried if one.value > there.value), None)

    def _beside(self, there: _Point, move: FloatArray) -> _Point:
        """The point after a move, no further than the sizes' bounds; itself where no model follows from that."""
        try:
            return self._at(there.theta + move)
        except (InputError, np.linalg.LinAlgError):
            return there
