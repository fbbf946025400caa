"""Everything about a flight that its recording does not declare, as parameters with priors: the likeliest of them.

What is declared stays.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from sinan.calibration.levels.declared_effects import Readings
from sinan.calibration.levels.levels import Levels, first_levels
from sinan.calibration.levels.problem import Problem
from sinan.calibration.levels.sizes import LITTLE, Iron, Size, is_told_without_position, sizes_of, slow_error_of_gps
from sinan.estimator.filter.engine import run
from sinan.sensors.arrays import FloatArray
from sinan.sensors.bounds import Bounds
from sinan.sensors.recording import Recording


def fit_levels(
    recording: Recording,
    m_n: FloatArray | None = None,
    field: FloatArray | None = None,
    iron: Iron = LITTLE,
    imu_samples: str = "instant",
) -> Levels:
    """The likeliest sizes of what a flight does not declare; see `problem_of`."""
    return likeliest(problem_of(recording, m_n, field, iron, imu_samples))


def problem_of(
    recording: Recording,
    m_n: FloatArray | None = None,
    field: FloatArray | None = None,
    iron: Iron = LITTLE,
    imu_samples: str = "instant",
) -> Problem:
    """The sizes of what a flight does not declare, to be sought.

    Parameters
    ----------
    m_n, field : (3,), (3, 3) magnetic field and its covariance, where the recording declares none
    iron, imu_samples : see `Iron`, `first_levels`
    """
    sizes = sizes_of(recording, iron)
    first = replace(first_levels(recording, sizes, m_n, field, imu_samples), iron=iron.taken)
    if "gps" not in recording.streams:
        first = widest_bounds_needed(recording, first)
        sizes = [size for size in sizes if is_told_without_position(size)]
    return Problem(recording, sizes, first)


def likeliest(problem: Problem, near: Levels | None = None) -> Levels:
    """The likeliest sizes of a problem, sought from those of `near` on; default: the medians."""
    if not problem.sizes:
        return problem.first
    return problem.fitted(np.zeros(len(problem.sizes)) if near is None else problem.theta(near))


#: How far declared white noise of a receiver is off, in the logarithm: a choice, 1.6 times as much at one sigma. Half
#: calls white noise slow that is 8 times as declared, twice calls none (`bounds_of_work slow`).
AS_DECLARED = 0.5
#: A slow error that is tried first, its size over the white noise and its time constant [s]: bound of work
#: (`bounds_of_work slow`).
TRIED = tuple(product((0.3, 1.0), (3.0, 10.0)))
_WHITE_OF = {"colour_std": "noise_std", "velocity_colour_std": "velocity_noise_std"}


def with_slow_gps(recording: Recording) -> Levels:
    """The levels of a recording that declares its noise, and what its receiver errs by for seconds besides, or its
    white noise as the log has it: the likeliest of the three; before the log they are as likely.

    The evidence of sizes is Laplace's, which neglects how they go together.
    """
    plain = first_levels(recording, (), None, None)
    slow = [replace(s, median=5.0) if s.key == "colour_time" else s for s in slow_error_of_gps(recording)]
    gps = plain.specs["gps"]
    keys = [_WHITE_OF[s.key] for s in slow if s.key in _WHITE_OF]
    white = [Size("gps", key, getattr(gps, key), AS_DECLARED) for key in keys if getattr(gps, key)]
    first = plain
    for size in slow:
        first = first.with_size(size, size.median)
    problem = Problem(recording, [*slow, *white], first)

    def theta(share: float, time: float) -> FloatArray:
        values = [
            time if s.key == "colour_time" else share * (getattr(gps, _WHITE_OF[s.key]) or s.median) for s in slow
        ]
        sought = [np.log(value / s.median) / s.spread for value, s in zip(values, slow, strict=True)]
        return np.array([*sought, *(0.0 for _ in white)])

    _, _, start = max((problem.value(tried), k, tried) for k, tried in enumerate(theta(*one) for one in TRIED))
    without = Problem(recording, (), plain).value(np.zeros(0))
    found = [(without, plain)]
    for one, begin in ((Problem(recording, white, plain), np.zeros(len(white))), (problem, start)):
        levels = one.fitted(begin)
        found.append((_evidence(levels), levels))
    return max(found, key=lambda one: one[0])[1]


def _evidence(levels: Levels) -> float:
    """Logarithm of the probability of the log, the sizes that were found integrated over."""
    narrower = (np.log(sigma / size.spread) for sigma, size in zip(levels.sigmas, levels.found, strict=True))
    return levels.log_posterior + float(sum(narrower))


#: Bounds that are tried, those of a hand, a swing or a robot arm, and so many times as wide: a choice. Of half and
#: twice a hover takes the narrowest, a figure of eight 7.5 and 10 m for 5 m (`bounds_of_work hand`).
HAND, WIDER = Bounds(0.5, 1.0), (1.0, 3.0, 10.0, 30.0, 100.0)


def widest_bounds_needed(recording: Recording, levels: Levels) -> Levels:
    """With the likeliest of the bounds on place and speed: each alone may be so wide that it says nothing."""
    tried = []
    readings = Readings.of(levels.flight(recording))
    for place in WIDER:
        for speed in WIDER[:3]:
            assert levels.bounds is not None
            bounds = replace(levels.bounds, place=HAND.place * place, speed=HAND.speed * speed)
            one = replace(levels, bounds=bounds)
            tried.append((run(readings.inputs(one.flight(recording)), "numba", 0).log_likelihood, one))
    return max(tried, key=lambda pair: pair[0])[1]
