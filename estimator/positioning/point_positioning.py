"""Position and clock from pseudoranges: Bancroft's closed form, weighted least squares over all epochs at once.

Everything works on rows (one pseudorange each, sorted by epoch) that are laid out as a rectangle of epochs and slots,
so that no loop runs over the epochs. Ranges here are pseudoranges plus c times the satellite clock, with the modelled
delays taken off: what remains is distance plus the receiver's clock.

Sources: S. Bancroft, IEEE Trans. AES 21 (1985) 56; B. Hofmann-Wellenhof et al., GNSS (2008), ch. 7;
W. Baarda, NGC Publications on Geodesy 2-5 (1968), for the w-test and the minimal detectable bias.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.estimator.positioning.small_systems import cholesky, inverse, substitute
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.errors import InputError

EARTH_RADIUS = 6371.0e3  # m, mean radius R_1 of GRS 80 (Moritz, Journal of Geodesy 74, 2000) to a kilometre
CONVERGED = 1e-4  # m: the last step's error is the square of this over the distance, (1e-4)^2 / 2e7 = 5e-16
MOST_ITERATIONS = 30  # from the Earth's centre five or six do: bound of work (`bounds_of_work ranges`)


@dataclass(frozen=True)
class Roots:
    """Both solutions of Bancroft's equation.

    Attributes
    ----------
    position : (2, 3) ECEF [m], the chosen one first
    clock : (2,) receiver clock times c [m]
    misfit : (2,) RMS of range minus distance minus clock [m]
    reason : why the first one was chosen
    """

    position: FloatArray
    clock: FloatArray
    misfit: FloatArray
    reason: str


def bancroft(satellite_e: FloatArray, ranges: FloatArray) -> Roots:
    """Solve four (or, in least squares, more) pseudorange equations in closed form.

    With the Lorentz product <u, v> = u1 v1 + u2 v2 + u3 v3 - u4 v4, a_i = (p_i, rho_i) and r = (p, b), squaring
    rho_i - b = |p_i - p| gives <a_i, a_i> / 2 - <a_i, r> + <r, r> / 2 = 0. So r = M B^+ (L 1 + alpha) with
    L = <r, r> / 2, M = diag(1, 1, 1, -1), and L from a quadratic equation: two roots. Squaring has made rho - b = -|d|
    a solution too, so the root must fit the unsquared equations; where both do (satellites on one side of a receiver in
    space), the one nearer the Earth's surface is taken.

    Parameters
    ----------
    satellite_e : (n, 3), n >= 4, ECEF [m]
    ranges : (n,) pseudoranges with the satellite clock and all delays taken off [m]

    Raises
    ------
    InputError : fewer than four satellites, their positions do not determine a solution, or no real one exists
    """
    if len(ranges) < 4:
        raise InputError("bancroft", f"{len(ranges)} satellites", "at least four")
    scale = 1e7  # m, so that all numbers are near one
    B = np.column_stack([satellite_e, ranges]) / scale
    M = np.array([1.0, 1.0, 1.0, -1.0])
    alpha = 0.5 * np.sum(B**2 * M, axis=1)
    if np.linalg.matrix_rank(B, tol=1e-9) < 4:
        raise InputError("bancroft", "satellites and ranges that lie in one hyperplane", "four independent satellites")
    inverse = np.linalg.pinv(B)
    u, v = inverse @ np.ones(len(B)), inverse @ alpha
    a, b, c = np.sum(u * u * M), np.sum(u * v * M) - 1.0, np.sum(v * v * M)
    discriminant = b**2 - a * c
    if discriminant < 0.0:
        raise InputError("bancroft", "ranges that no point satisfies", "pseudoranges of one instant")
    q = -(b + np.copysign(np.sqrt(discriminant), b))
    solutions = [M * (L * u + v) * scale for L in (q / a if a != 0.0 else np.inf, c / q if q != 0.0 else 0.0)]
    position = np.array([solution[:3] for solution in solutions])
    clock = np.array([solution[3] for solution in solutions])
    return choose_root(satellite_e, ranges, position, clock)


def choose_root(satellite_e: FloatArray, ranges: FloatArray, position: FloatArray, clock: FloatArray) -> Roots:
    """Put the root first that solves the unsquared equations, or the one nearer the Earth's surface if both do."""
    distance = np.linalg.norm(satellite_e[None] - position[:, None], axis=2)
    misfit = np.sqrt(np.mean((ranges - clock[:, None] - distance) ** 2, axis=1))
    misfit = np.where(np.isfinite(misfit), misfit, np.inf)
    height = np.abs(np.linalg.norm(position, axis=1) - EARTH_RADIUS)
    fits = misfit <= 10.0 * np.min(misfit) + 1.0
    if fits.all():
        first, reason = int(np.argmin(height)), "both roots fit; taken is the one nearer the Earth's surface"
    else:
        first, reason = int(np.argmin(misfit)), "only this root fits; the other one belongs to ranges of reversed sign"
    order = [first, 1 - first]
    return Roots(position[order], clock[order], misfit[order], reason)


@dataclass(frozen=True)
class Fixes:
    """Position and clocks of every epoch.

    Attributes
    ----------
    position : (epochs, 3) ECEF [m], NaN where there is no solution
    clock : (epochs, clocks) receiver clock errors times c [m], NaN where the epoch has no satellite of that clock
    covariance : (epochs, unknowns, unknowns) of position, clocks and field, from the stated variances
    used : (n,) rows that took part
    residual : (n,) range minus model [m], also of rows that did not take part; NaN without a solution
    common : (n,) the field's part of the range at the solution [m], taken off in `residual`
    redundancy : (epochs,) satellites minus position and clocks, -1 without a solution
    sse : (epochs,) weighted sum of squared residuals
    iterations : of the last call
    """

    position: FloatArray
    clock: FloatArray
    covariance: FloatArray
    used: BoolArray
    residual: FloatArray
    common: FloatArray
    redundancy: IntArray
    sse: FloatArray
    iterations: int

    @property
    def solved(self) -> BoolArray:
        """(epochs,) whether there is a solution."""
        return self.redundancy >= 0


@dataclass(frozen=True)
class Rectangle:
    """Rows laid out as (epochs, slots); the rows keep their order."""

    epoch: IntArray
    slot: IntArray
    epochs: int
    slots: int

    def spread(self, value: FloatArray, fill: float = 0.0) -> FloatArray:
        """(n, ...) rows to (epochs, slots, ...)."""
        out = np.full((self.epochs, self.slots, *value.shape[1:]), fill)
        out[self.epoch, self.slot] = value
        return out

    def rows(self, value: FloatArray) -> FloatArray:
        """(epochs, slots, ...) back to (n, ...)."""
        return value[self.epoch, self.slot]


def rectangle(epoch: IntArray, epochs: int) -> Rectangle:
    """Number the rows of each epoch; `epoch` must not decrease."""
    count = np.bincount(epoch, minlength=epochs) if len(epoch) else np.zeros(epochs, dtype=np.int64)
    first = np.concatenate([[0], np.cumsum(count)[:-1]]) if epochs else count
    return Rectangle(epoch, np.arange(len(epoch)) - first[epoch], epochs, int(count.max(initial=1)))


def solve(
    satellite_e: FloatArray,
    ranges: FloatArray,
    epoch: IntArray,
    epochs: int,
    *,
    clock_group: IntArray | None = None,
    clocks: int = 1,
    variance: FloatArray | None = None,
    used: BoolArray | None = None,
    start: FloatArray | None = None,
    known_position: FloatArray | None = None,
    field: FloatArray | None = None,
) -> Fixes:
    """Iterated weighted least squares (Gauss-Newton) for all epochs at once.

    range_i = |p_i - p| + clock_g(i) + field_i x + e_i,  Var(e_i) = variance_i,  x ~ N(0, 1)

    The field is what errors have in common that are no unknowns of interest: x has prior variance one, so that this is
    least squares with the covariance variance_i delta_ij + field_i field_j'.

    From any start: an epoch that has not come to rest, or has come to rest farther out than its satellites, where the
    mirror root lies, starts again from the Earth's centre, from which the step always leads to the near root.

    Parameters
    ----------
    satellite_e : (n, 3) ECEF [m]
    ranges : (n,) [m], satellite clock and delays taken off
    epoch : (n,) index of the epoch, not decreasing
    epochs : their number
    clock_group : (n,) number of the receiver clock of each row, 0 to clocks - 1
    clocks : number of receiver clocks
    variance : (n,) [m^2]; 1 if not given
    used : (n,) rows that take part; all if not given
    start : (3,) or (epochs, 3) ECEF [m]; if not given, the fix of one epoch, found from the Earth's centre
    known_position : (epochs, 3): solve the clocks alone
    field : (n, k) common errors [m], one column each
    """
    shape = rectangle(epoch, epochs)
    group = np.zeros(len(epoch), dtype=np.int64) if clock_group is None else clock_group
    taken = np.ones(len(epoch), dtype=bool) if used is None else used.copy()
    problem = _problem(shape, satellite_e, ranges, group, clocks, variance, taken, field, known_position is None)
    p = np.zeros((3, epochs)) if start is None else np.broadcast_to(start, (epochs, 3)).T.copy()
    if known_position is not None:
        p = known_position.T.copy()
    elif start is None and problem.possible.any():
        _from_one(problem, p)
    b = np.zeros((len(problem.linear), epochs))
    N, iterations = _iterate(problem, p, b, problem.possible)
    lost = problem.possible & ~_arrived(problem, p, b)
    if lost.any() and problem.free:
        p[:, lost], b[:, lost] = 0.0, 0.0
        again, iterations = _iterate(problem, p, b, lost)
        N[..., lost] = again[..., lost]
        lost = problem.possible & ~_arrived(problem, p, b)
    return _fixes(problem, p, b, N, problem.possible & ~lost, taken, iterations)


@dataclass(frozen=True)
class _Problem:
    """All epochs as a rectangle, unknowns first: 3 positions, then clocks and field, which enter linearly.

    Attributes
    ----------
    satellites : (3, epochs, slots)
    z, W : (epochs, slots) ranges and weights, zero weight where nothing is or takes part
    linear : (clocks + k, epochs, slots)
    present : (clocks, epochs) whether the epoch sees the clock
    possible : (epochs,) whether there are as many satellites as unknowns
    redundancy : (epochs,) satellites minus unknowns, -1 where nothing is
    free : whether the position is unknown
    """

    shape: Rectangle
    satellites: FloatArray
    z: FloatArray
    W: FloatArray
    linear: FloatArray
    present: BoolArray
    possible: BoolArray
    redundancy: IntArray
    free: bool


def _problem(
    shape: Rectangle,
    satellite_e: FloatArray,
    ranges: FloatArray,
    group: IntArray,
    clocks: int,
    variance: FloatArray | None,
    taken: BoolArray,
    field: FloatArray | None,
    free: bool,
) -> _Problem:
    weight = np.ones(len(ranges)) if variance is None else 1.0 / variance
    W = shape.spread(np.where(taken, weight, 0.0))
    columns = [(group == k).astype(np.float64) for k in range(clocks)]
    columns += [] if field is None else list(field.T)
    linear = np.stack([shape.spread(column) for column in columns])
    present = np.any((linear[:clocks] > 0.0) & (W > 0.0), axis=2)
    redundancy = (W > 0.0).sum(axis=1) - present.sum(axis=0) - (3 if free else 0)
    redundancy = np.where(present.any(axis=0), redundancy, -1)
    satellites = np.stack([shape.spread(axis, 1e7) for axis in satellite_e.T])
    return _Problem(shape, satellites, shape.spread(ranges), W, linear, present, redundancy >= 0, redundancy, free)


def _from_one(problem: _Problem, p: FloatArray) -> None:
    """Begin every epoch at the fix of one of them, which begins at the Earth's centre."""
    first = np.zeros(len(problem.possible), dtype=bool)
    first[int(np.argmax(problem.redundancy))] = True
    b = np.zeros((len(problem.linear), len(first)))
    _iterate(problem, p, b, first)
    p[:] = np.where(_arrived(problem, p, b) & first, p, 0.0)[:, first]


def _arrived(problem: _Problem, p: FloatArray, b: FloatArray) -> BoolArray:
    """(epochs,) whether the iteration has come to rest nearer the Earth's centre than the satellites."""
    r2 = np.where(problem.W > 0.0, np.sum(problem.satellites**2, axis=0), np.inf).min(axis=1)
    return np.asarray((np.sum(p**2, axis=0) < 0.9 * r2) & np.isfinite(b).all(axis=0))


def _iterate(problem: _Problem, p: FloatArray, b: FloatArray, active: BoolArray) -> tuple[FloatArray, int]:
    """Gauss-Newton steps on p and b in place, until the step of every active epoch is below `CONVERGED`.

    Clocks and field enter linearly, so each step solves for their whole values. What an epoch does not see or knows
    beforehand gets a unit on the diagonal instead of a singular matrix; the field's is its prior. Also the normal
    matrices (unknowns, unknowns, epochs) of the last step, and the number of steps.
    """
    size = 3 + len(problem.linear)
    N = np.zeros((size, size, len(active)))
    N[np.arange(size), np.arange(size)] = 1.0
    settled = ~active
    for count in range(MOST_ITERATIONS):
        if settled.all():
            return N, count
        rows = np.flatnonzero(~settled) if settled.any() else slice(None)
        distance, A = _design(problem, p, rows)
        normal, right = _normal(problem, A, problem.z[rows] - distance, rows)
        step = substitute(cholesky(normal), right[:, None])[:, 0]
        N[..., rows] = normal
        p[:, rows] += step[:3]
        b[:, rows] = step[3:]
        length = np.sqrt(np.sum(step[:3] ** 2, axis=0))
        settled[rows] = (length < CONVERGED) | ~np.isfinite(length) | (length > 1e12)
    b[:, ~settled] = np.nan
    return N, MOST_ITERATIONS


def _design(problem: _Problem, p: FloatArray, rows: IntArray | slice) -> tuple[FloatArray, FloatArray]:
    """(epochs, slots) distances and (unknowns, epochs, slots) derivatives by position, clocks and field."""
    d = problem.satellites[:, rows] - p[:, rows, None]
    distance = np.sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)
    direction = -d / distance if problem.free else np.zeros_like(d)
    return distance, np.concatenate([direction, problem.linear[:, rows]])


def _normal(problem: _Problem, A: FloatArray, y: FloatArray, rows: IntArray | slice) -> tuple[FloatArray, FloatArray]:
    """(unknowns, unknowns, epochs) A' W A with the unit diagonals, lower triangle and mirror, and A' W y."""
    size, clocks = len(A), len(problem.present)
    N = np.zeros((size, size, len(y)))
    right = np.empty((size, len(y)))
    for i in range(size):
        WA = problem.W[rows] * A[i]
        right[i] = np.einsum("es,es->e", WA, y)
        for j in range(i + 1):
            if 3 <= j < i < 3 + clocks:  # a satellite has one clock
                continue
            N[i, j] = np.einsum("es,es->e", WA, A[j])
            N[j, i] = N[i, j]
    for i in range(3 if problem.free else 0, size):
        N[i, i] += 1.0 if not 3 <= i < 3 + clocks else ~problem.present[i - 3, rows]
    return N, right


def _fixes(
    problem: _Problem,
    p: FloatArray,
    b: FloatArray,
    N: FloatArray,
    solved: BoolArray,
    used: BoolArray,
    iterations: int,
) -> Fixes:
    """Covariance and residuals at the solution."""
    clocks, shape = len(problem.present), problem.shape
    covariance, regular = inverse(N)
    solved = solved & regular
    seen = np.concatenate(
        [np.full((3, len(solved)), problem.free), problem.present, np.ones_like(b[clocks:], dtype=bool)]
    )
    covariance = covariance * (seen[:, None] & seen[None] & solved)
    b = np.where(solved & seen[3:], b, np.nan)
    distance = np.sqrt(np.sum((problem.satellites - p[..., None]) ** 2, axis=0))
    residual = problem.z - distance
    for k in range(clocks):
        residual = residual - np.where(problem.linear[k] > 0.0, b[k][:, None], 0.0)
    common = np.zeros_like(residual)
    for k in range(clocks, len(b)):
        common += problem.linear[k] * b[k][:, None]
    residual = residual - common
    sse = np.where(solved, np.sum(problem.W * np.where(problem.W > 0.0, residual, 0.0) ** 2, axis=1), np.nan)
    row_solved = solved[shape.epoch]
    return Fixes(
        np.where(solved, p, np.nan).T,
        b[:clocks].T,
        np.moveaxis(covariance, 2, 0),
        used & row_solved,
        np.where(row_solved, shape.rows(residual), np.nan),
        np.where(row_solved, shape.rows(common), np.nan),
        np.where(solved, problem.redundancy, -1),
        sse,
        iterations,
    )
