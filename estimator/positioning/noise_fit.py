"""The noise of pseudoranges from the pseudoranges: restricted likelihood with log-normal priors.

About a fix, the prefit residuals of an epoch are y = A x + e with position and clocks x and

    V(theta) = diag(v_i(theta)) + theta_f^2 F F' + G G'

F what the rays have in common of the ionosphere, G a fault under trial. With P = V^-1 - V^-1 A (A' V^-1 A)^-1 A' V^-1,

    L = -1/2 (log |V| + log |A' V^-1 A| + y' P y),   dL/dlog theta_j = -1/2 (tr(P D_j) - y' P D_j P y)

with D_j = dV / dlog theta_j. The errors of a satellite hardly change within the life of its message, so the epochs of a
log are no repetitions: their mean counts 1 + span / 2 h times (a tempered composite likelihood). The prior of each size
is log-normal; what a log does not tell stays at it.

Source: H. D. Patterson, R. Thompson, Biometrika 58 (1971) 545; C. Varin et al., Statistica Sinica 21 (2011) 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from sinan.estimator.positioning.location import IONOSPHERE, Location
from sinan.estimator.positioning.point_positioning import rectangle
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.pseudorange import circumstances, ionosphere_left, line_of_sight, sum_of
from sinan.sensors.range_noise import RangeNoise, believed, squares

#: How long a satellite's error lasts: the life of a broadcast message [s]. Logs of known places are likelier by it than
#: by half an hour, by 75 to 457 of 2 log L (measured: `python -m sinan.experiments.benchmarks.range_noise`).
LASTING = 7200.0
MOST_EPOCHS = 40  # of a log, evenly spread, as neighbours repeat each other: bound of work (`bounds_of_work law`)
PRIOR_SPREAD = (
    0.5  # 1-sigma of the logarithm of a size: between the five sites of docs/notes/range_noise.md it is 0.24 to 0.66
)
NEAREST, FARTHEST = 0.01, 30.0  # bounds of a size over its prior: bound of work (`bounds_of_work law`)


@dataclass(frozen=True)
class Problem:
    """Some epochs of a log as rectangles (epochs, slots, ...); empty slots are zero but for `floor`, which is one.

    Attributes
    ----------
    y : prefit residuals [m]
    A : position and clocks
    basis : (.., 8) of `range_noise.squares`
    floor : variance that is known [m^2]
    field : (.., 3) of the ionosphere, for the size one
    absent : (epochs, unknowns) whether an epoch has nothing of the unknown
    number : (.., ) index of the satellite, -1 in an empty slot
    names : of the satellites
    repeats : how often the mean of the epochs counts
    """

    y: FloatArray
    A: FloatArray
    basis: FloatArray
    floor: FloatArray
    field: FloatArray
    absent: BoolArray
    number: FloatArray
    names: tuple[str, ...]
    repeats: float


def telling(location: Location, keep: BoolArray, during: BoolArray | None = None) -> IntArray:
    """Epochs that have more satellites than unknowns, thinned evenly: what `problem_of` takes."""
    epoch = location.ranges.epoch[keep]
    epochs = len(location.ranges.t)
    count = np.bincount(epoch, minlength=epochs)
    pairs = np.unique(epoch * len(location.clock_names) + location.clock_group[keep]) // max(
        len(location.clock_names), 1
    )
    usable = location.fixes.solved & (count > 3 + np.bincount(pairs, minlength=epochs))
    there = np.flatnonzero(usable if during is None else usable & during)
    return there[np.unique(np.linspace(0, len(there) - 1, min(MOST_EPOCHS, len(there))).astype(np.int64))]


def problem_of(location: Location, keep: BoolArray, during: BoolArray | None = None) -> Problem:
    """Lay out what the likelihood needs.

    Parameters
    ----------
    location : fixes with every effect
    keep : (n,) rows that take part
    during : (epochs,) epochs that may be taken, one of them at least with more satellites than unknowns; None: all
    """
    ranges, fixes = location.ranges, location.fixes
    chosen = telling(location, keep, during)
    place = np.full(len(ranges.t), -1)
    place[chosen] = np.arange(len(chosen))
    rows = np.flatnonzero(keep & (place[ranges.epoch] >= 0))
    part = ranges.rows(rows)
    position = np.where(np.isfinite(fixes.position), fixes.position, 1e7)
    motion = circumstances(part, position)
    distance, direction = line_of_sight(part.position, position[part.epoch])
    y = part.value - distance - sum_of(motion, location.effects)
    clocks = np.eye(len(location.clock_names))[location.clock_group[rows]]
    first = np.zeros((len(chosen), clocks.shape[1]))
    first[place[part.epoch], location.clock_group[rows]] = y  # near the clock's value, for the numbers' sake
    y = y - np.sum(first[place[part.epoch]] * clocks, axis=1)
    A = np.hstack([direction, clocks])
    delay = sum_of(motion, [IONOSPHERE])
    basis = squares(part.system, motion.covariates["elevation"], part.strength, delay)
    names, number = np.unique(part.satellite, return_inverse=True)
    shape = rectangle(place[part.epoch], len(chosen))
    A_k = shape.spread(A)
    return Problem(
        shape.spread(y), A_k, shape.spread(basis), shape.spread(believed(part.accuracy) - 1.0) + 1.0,
        shape.spread(ionosphere_left(motion, delay, 1.0)), np.all(A_k == 0.0, axis=1),
        shape.spread(number.astype(np.float64), -1.0), tuple(names.tolist()),
        1.0 + float(np.ptp(ranges.t[chosen])) / LASTING,
    )  # fmt: skip


def likelihood(problem: Problem, sizes: FloatArray, fault: FloatArray | None = None) -> tuple[float, FloatArray]:
    """Tempered log-likelihood and its (9,) derivative by the logarithms of the sizes.

    Parameters
    ----------
    problem : epochs
    sizes : (9,) of `RangeNoise.sizes`
    fault : (epochs, slots) column of a further common error [m], 1-sigma
    """
    parts = problem.basis * sizes[:8] ** 2
    v = parts.sum(axis=2) + problem.floor
    common = problem.field * sizes[8]
    U = common if fault is None else np.concatenate([common, fault[..., None]], axis=2)
    V = U @ np.swapaxes(U, 1, 2)
    n = v.shape[1]
    V[:, np.arange(n), np.arange(n)] += v
    P, N = _without_unknowns(problem, np.linalg.inv(V))
    Py = (P @ problem.y[..., None])[..., 0]
    value = np.linalg.slogdet(V)[1] + np.linalg.slogdet(N)[1] + np.sum(problem.y * Py, axis=1)
    diagonal = np.diagonal(P, axis1=1, axis2=2) - Py**2
    slope = np.append(
        np.einsum("es,esj->j", diagonal, 2.0 * parts),
        2.0 * (np.sum(common * (P @ common)) - np.sum(np.einsum("es,esf->ef", Py, common) ** 2)),
    )
    share = problem.repeats / len(problem.y)
    return float(-0.5 * share * value.sum()), -0.5 * share * slope


def projected(problem: Problem, sizes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(epochs, slots, slots) P of each epoch and (epochs, slots) P y, without a fault."""
    common = problem.field * sizes[8]
    V = common @ np.swapaxes(common, 1, 2)
    n = V.shape[1]
    V[:, np.arange(n), np.arange(n)] += (problem.basis * sizes[:8] ** 2).sum(axis=2) + problem.floor
    P = _without_unknowns(problem, np.linalg.inv(V))[0]
    return P, (P @ problem.y[..., None])[..., 0]


def _without_unknowns(problem: Problem, inverse: FloatArray) -> tuple[FloatArray, FloatArray]:
    """P, and A' V^-1 A with ones for what an epoch does not see."""
    VA = inverse @ problem.A
    N = np.swapaxes(problem.A, 1, 2) @ VA
    m = N.shape[1]
    N[:, np.arange(m), np.arange(m)] += problem.absent
    return inverse - VA @ np.linalg.solve(N, np.swapaxes(VA, 1, 2)), N


def fit(
    problems: Sequence[Problem],
    prior: RangeNoise,
    spread: float = PRIOR_SPREAD,
    faults: Sequence[FloatArray | None] | None = None,
) -> tuple[RangeNoise, float]:
    """The most probable sizes, and the logarithm of their posterior density up to a constant.

    Parameters
    ----------
    problems : logs that have one law in common
    prior : medians
    spread : 1-sigma of the logarithms
    faults : of each problem, as in `likelihood`
    """
    centre = np.log(prior.sizes)
    given = [None] * len(problems) if faults is None else faults

    def cost(x: FloatArray) -> tuple[float, FloatArray]:
        value, slope = 0.5 * np.sum(((x - centre) / spread) ** 2), (x - centre) / spread**2
        for problem, fault in zip(problems, given, strict=True):
            L, dL = likelihood(problem, np.exp(x), fault)
            value, slope = value - L, slope - dL
        return float(value), slope

    bounds = [(c + np.log(NEAREST), c + np.log(FARTHEST)) for c in centre]
    found = minimize(cost, centre, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 60})
    return RangeNoise.of(np.exp(found.x)), -float(found.fun)


def fitted(location: Location, prior: RangeNoise | None = None, during: BoolArray | None = None) -> RangeNoise:
    """The law of one log; the prior where it has no epoch to tell.

    Parameters
    ----------
    location : fixes with every effect
    prior : medians; None: those of the measured logs
    during : (epochs,) epochs that are used
    """
    prior = RangeNoise() if prior is None else prior
    if not len(telling(location, location.fixes.used, during)):
        return prior
    return fit([problem_of(location, location.fixes.used, during)], prior)[0]
