"""A satellite whose ranges are off all the time: evidence against a law of errors that the same ranges have to tell.

A test with a fixed law has to allow for the worst errors that orbits, air and multipath leave, and takes 3.5 m for one
of them. But the other satellites tell how large these errors are in this log. Two explanations are compared, each with
the sizes of the law that suit it best under their priors: no satellite is off, or satellite j is, by b ~ N(0, tau^2):

    log B_j = log mean_tau max_theta p(y | theta, tau) p(theta) - log max_theta p(y | theta) p(theta)

Each satellite is as likely beforehand, and all together as likely as none, so that the posterior probability of j is
B_j / (n + sum B). It is named where that of no fault falls below alpha; B is a ratio of densities with mean one where
there is no fault, so that this happens in less than a share alpha of good logs (Markov's inequality).

Source: R. E. Kass, A. E. Raftery, J. Am. Stat. Assoc. 90 (1995) 773; J. Ville, Etude critique de la notion de collectif
(1939), for the bound.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.estimator.positioning.location import Location
from sinan.estimator.positioning.noise_fit import Problem, fit, problem_of, projected, telling
from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.range_noise import RangeNoise

#: tau [m]: a choice, each as likely; half and twice move the evidence by 1.6 % (`bounds_of_work steady`).
SIZES = (3.0, 10.0, 30.0)
SHORTLIST = 3  # satellites whose evidence has sizes of its own: bound of work (`bounds_of_work ranges`)


@dataclass(frozen=True)
class SteadyFault:
    """A satellite that is off.

    Attributes
    ----------
    satellite : name
    offset, std : of its ranges [m]
    log_bayes : evidence against no fault
    confident : posterior probability that there is a fault
    others : satellites that explain it nearly as well (a tenth of the evidence or more)
    """

    satellite: str
    offset: float
    std: float
    log_bayes: float
    confident: float
    others: tuple[str, ...]


def steady_fault(location: Location, keep: BoolArray, prior: RangeNoise | None = None) -> SteadyFault | None:
    """The satellite that is most probably off, however improbable; None where nothing can tell.

    Parameters
    ----------
    location : fixes with every effect
    keep : (n,) rows that take part
    prior : of the law
    """
    keep = keep & location.fixes.solved[location.ranges.epoch]
    if not len(telling(location, keep)):
        return None
    problem, prior = problem_of(location, keep), RangeNoise() if prior is None else prior
    law, nothing = fit([problem], prior)
    offsets, information = offsets_of(problem, law)
    score = offsets**2 * information
    candidates = np.argsort(-score)[:SHORTLIST].tolist()
    evidence = {k: log_evidence(problem, prior, k) - nothing for k in candidates}
    best = max(evidence, key=lambda k: evidence[k])
    mean = np.logaddexp.reduce(list(evidence.values())) - np.log(len(problem.names))
    own, _ = fit([problem], prior, faults=[SIZES[-1] * (problem.number == best)])
    offset, known = (x[best] for x in offsets_of(problem, own))
    others = tuple(problem.names[k] for k in candidates if k != best and evidence[k] > evidence[best] - np.log(10.0))
    return SteadyFault(
        problem.names[best],
        float(offset),
        float(1.0 / np.sqrt(known)),
        float(evidence[best]),
        float(1.0 / (1.0 + np.exp(-mean))),
        others,
    )


def log_evidence(problem: Problem, prior: RangeNoise, satellite: int) -> float:
    """Logarithm of the mean over tau of the posterior density at the sizes that suit a fault of the satellite best."""
    column = (problem.number == satellite).astype(np.float64)
    values = [fit([problem], prior, faults=[tau * column])[1] for tau in SIZES]
    return float(np.logaddexp.reduce(values) - np.log(len(values)))


def offsets_of(problem: Problem, law: RangeNoise) -> tuple[FloatArray, FloatArray]:
    """(satellites,) least-squares offset of each alone [m], and its tempered information [1/m^2]."""
    P, Py = projected(problem, law.sizes)
    columns = (problem.number[..., None] == np.arange(len(problem.names))).astype(np.float64)
    score = np.einsum("esj,es->j", columns, Py)
    information = np.einsum("esj,esj->j", columns, P @ columns)
    share = problem.repeats / len(problem.y)
    return score / np.maximum(information, 1e-12), np.maximum(information, 1e-12) * share
