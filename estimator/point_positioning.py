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

from sensors.arrays import BoolArray, FloatArray, IntArray
from sensors.errors import InputError

EARTH_RADIUS = 6371.0e3  # m, mean
CONVERGED = 1e-4  # m: the last step's error is the square of this over the distance
MOST_ITERATIONS = 30


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
    start : (3,) or (epochs, 3) ECEF [m]; the Earth's centre if not given
    known_position : (epochs, 3): solve the clocks alone
    field : (n, k) common errors [m], one column each
    """
    shape = rectangle(epoch, epochs)
    group = np.zeros(len(epoch), dtype=np.int64) if clock_group is None else clock_group
    weight = 1.0 / (np.ones(len(epoch)) if variance is None else variance)
    taken = np.ones(len(epoch), dtype=bool) if used is None else used.copy()
    W = shape.spread(np.where(taken, weight, 0.0))
    satellites = shape.spread(satellite_e, 1e7)
    z = shape.spread(ranges)
    one_hot = shape.spread(np.eye(clocks)[group])
    present = np.any((one_hot > 0.0) & (W > 0.0)[..., None], axis=1)
    common = np.zeros((len(epoch), 0)) if field is None else field
    linear = np.concatenate([one_hot, shape.spread(common)], axis=2)
    satellites_used = (W > 0.0).sum(axis=1)
    unknowns = (0 if known_position is not None else 3) + present.sum(axis=1)
    redundancy = np.where(present.any(axis=1), satellites_used - unknowns, -1)
    p = np.zeros((epochs, 3)) if start is None else np.broadcast_to(start, (epochs, 3)).copy()
    if known_position is not None:
        p = known_position.copy()
    b = np.zeros((epochs, linear.shape[2]))
    possible = redundancy >= 0
    farthest = 0.95 * np.min(np.where(W > 0.0, np.linalg.norm(satellites, axis=2), np.inf), axis=1)
    iterations, N = _iterate(satellites, z, W, linear, present, p, b, possible, known_position is None)
    lost = possible & ~((np.linalg.norm(p, axis=1) < farthest) & np.isfinite(b).all(axis=1))
    if lost.any() and known_position is None:
        p[lost], b[lost] = 0.0, 0.0
        iterations, N = _iterate(satellites, z, W, linear, present, p, b, possible, True)
        lost = possible & ~((np.linalg.norm(p, axis=1) < farthest) & np.isfinite(b).all(axis=1))
    solved = possible & ~lost & np.isfinite(p).all(axis=1)
    return _fixes(shape, satellites, z, W, linear, present, p, b, N, solved, redundancy, taken, iterations)


def _iterate(
    satellites: FloatArray,
    z: FloatArray,
    W: FloatArray,
    linear: FloatArray,
    present: BoolArray,
    p: FloatArray,
    b: FloatArray,
    active: BoolArray,
    free: bool,
) -> tuple[int, FloatArray]:
    """Gauss-Newton steps on p and b in place, until the largest step of the active epochs is below `CONVERGED`.

    Clocks and field enter linearly, so each step solves for their whole values. What an epoch does not see or knows
    beforehand gets a unit on the diagonal instead of a singular matrix; the field's is its prior. Also the normal
    matrix of the last step.
    """
    size = 3 + linear.shape[2]
    N = np.zeros((len(p), size, size))
    known = np.full((len(p), 3), not free)
    prior = np.ones((len(p), linear.shape[2] - present.shape[1]))
    diagonal = np.concatenate([known, ~present, prior], axis=1)[..., None] * np.eye(size)
    settled = ~active
    for count in range(1, MOST_ITERATIONS + 1):
        rows = np.flatnonzero(~settled)
        if not len(rows):
            return count - 1, N
        distance, A = _design(satellites[rows], p[rows], linear[rows], free)
        WA = W[rows][..., None] * A
        N[rows] = np.swapaxes(A, 1, 2) @ WA
        right = np.swapaxes(WA, 1, 2) @ (z[rows] - distance)[..., None]
        N[rows] += diagonal[rows]
        step = _solve(N[rows], right[..., 0])
        p[rows] += step[:, :3]
        b[rows] = step[:, 3:]
        length = np.linalg.norm(step[:, :3], axis=1)
        settled[rows] = (length < CONVERGED) | ~np.isfinite(length) | (length > 1e12)
    b[~settled] = np.nan
    return MOST_ITERATIONS, N


def _design(satellites: FloatArray, p: FloatArray, linear: FloatArray, free: bool) -> tuple[FloatArray, FloatArray]:
    """(epochs, slots) distances and (epochs, slots, unknowns) their derivatives by position, clocks and field."""
    d = satellites - p[:, None]
    distance = np.sqrt(np.sum(d**2, axis=2))
    A = np.concatenate([-d / distance[..., None] * free, linear], axis=2)
    return distance, A


def _solve(N: FloatArray, right: FloatArray) -> FloatArray:
    """Solve a stack of symmetric systems; NaN for the singular ones."""
    try:
        return np.asarray(np.linalg.solve(N, right[..., None])[..., 0], dtype=np.float64)
    except np.linalg.LinAlgError:
        regular = np.linalg.matrix_rank(N, hermitian=True) == N.shape[1]
        out = np.full(right.shape, np.nan)
        out[regular] = np.linalg.solve(N[regular], right[regular][..., None])[..., 0]
        return out


def _fixes(
    shape: Rectangle,
    satellites: FloatArray,
    z: FloatArray,
    W: FloatArray,
    linear: FloatArray,
    present: BoolArray,
    p: FloatArray,
    b: FloatArray,
    N: FloatArray,
    solved: BoolArray,
    redundancy: IntArray,
    used: BoolArray,
    iterations: int,
) -> Fixes:
    """Covariance and residuals at the solution."""
    clocks = present.shape[1]
    unseen = np.concatenate(
        [np.zeros((len(p), 3), dtype=bool), ~present, np.zeros((len(p), b.shape[1] - clocks), dtype=bool)], 1
    )
    covariance, regular = _inverse(np.where(solved[:, None, None], N, np.eye(N.shape[1])))
    solved = solved & regular
    covariance[unseen[:, :, None] | unseen[:, None, :] | ~solved[:, None, None]] = 0.0
    b = np.where(solved[:, None] & ~unseen[:, 3:], b, np.nan)
    distance = np.sqrt(np.sum((satellites - p[:, None]) ** 2, axis=2))
    clock_part = np.sum(np.where(linear[..., :clocks] > 0.0, b[:, None, :clocks], 0.0), axis=2)
    field_part = np.sum(linear[..., clocks:] * b[:, None, clocks:], axis=2)
    residual = z - distance - clock_part - field_part
    sse = np.where(solved, np.sum(W * np.where(W > 0.0, residual, 0.0) ** 2, axis=1), np.nan)
    row_solved = solved[shape.epoch]
    return Fixes(
        np.where(solved[:, None], p, np.nan),
        b[:, :clocks],
        covariance,
        used & row_solved,
        np.where(row_solved, shape.rows(residual), np.nan),
        np.where(row_solved, shape.rows(field_part), np.nan),
        np.where(solved, redundancy, -1),
        sse,
        iterations,
    )


def _inverse(N: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Inverse of a stack of matrices and which of them are regular: those whose inverse is one to a millionth."""
    identity = np.eye(N.shape[1])
    try:
        inverse = np.linalg.inv(N)
    except np.linalg.LinAlgError:
        singular = np.linalg.matrix_rank(N, hermitian=True) < N.shape[1]
        inverse = np.linalg.inv(np.where(singular[:, None, None], identity, N))
    error = np.abs(N @ inverse - identity).max(axis=(1, 2)) if len(N) else np.zeros(0)
    return np.asarray(inverse, dtype=np.float64), np.asarray(error < 1e-6)
