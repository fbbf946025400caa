"""Search for the interval of a time-localised effect among the rows of a linear problem."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from sinan.estimator.evidence.score import gain_of, likelihood_ratio, log_p_value
from sinan.estimator.evidence.whiteness import whiteness
from sinan.sensors.arrays import FloatArray, IntArray

#: Boundaries of the coarse grid, which is refined to a row: bound of work (`bounds_of_work poses`).
_GRID = 96
#: A disturbance from the first row on is a start-up transient up to this share of the rows, the bias before a step
#: above: a choice of words, since that bias is free. Twice calls a step after 16 % a transient, half changes no word
#: (`bounds_of_work start`).
_START_UP = 0.1
#: An interval's evidence is compared with that of its peers, other intervals of about its length, so many at least: a
#: choice, half and twice of which change nothing of the poses of an accelerometer (`bounds_of_work poses`).
_LEAST_PEERS = 6


@dataclass(frozen=True)
class Interval:
    """The best interval and the evidence for a constant offset in it.

    Attributes
    ----------
    first, last : first row, and one past the last row
    gain : drop of the sum of squares in units of the noise variance
    statistic : the same as a likelihood ratio
    dof : directions of the offset that are seen
    log_p : corrected for the search and for the colour of the residual
    searched : logarithm of the number of intervals searched, which is in `log_p`
    beta : (size,) offset
    """

    first: int
    last: int
    gain: float
    statistic: float
    dof: int
    log_p: float
    searched: float
    beta: FloatArray


class OffsetScan:
    """Evidence for a constant offset within any interval of rows, in constant time an interval.

    With residual r, derivative A (rows, k) by the offset, and Q an orthonormal basis of all columns that are fitted
    besides, an interval I has Lambda_I = A_I'A_I - (Q_I'A_I)'(Q_I'A_I) and b_I = A_I' r, all from running sums.

    Parameters
    ----------
    residual : (rows,) whitened, in time order; what the fitted columns explain of it is taken off
    offset : (rows, k) derivative by a constant offset
    fitted : (rows, m) columns that are fitted besides
    """

    def __init__(self, residual: FloatArray, offset: FloatArray, fitted: FloatArray) -> None:
        Q = np.linalg.qr(fitted)[0] if fitted.shape[1] else np.zeros((len(residual), 0))
        residual = residual - Q @ (Q.T @ residual)
        self._parts = residual, offset, fitted
        self.rows, self.size = offset.shape
        self._AA = _running(np.einsum("ri,rj->rij", offset, offset))
        self._QA = _running(np.einsum("rq,ri->rqi", Q, offset))
        self._Ar = _running(offset * residual[:, None])
        self._floor = 1e-2 * np.trace(self._AA[-1]) / max(self.size * self.rows, 1)  # a hundredth of a row's worth

    def gain(self, first: IntArray, last: IntArray) -> tuple[FloatArray, IntArray, FloatArray]:
        """Gain, dof and offset of each interval; (m,), (m,), (m, k)."""
        qa = self._QA[last] - self._QA[first]
        L = self._AA[last] - self._AA[first] - np.einsum("mqi,mqj->mij", qa, qa)
        b = self._Ar[last] - self._Ar[first]
        return gain_of(L, b, lambda values: np.maximum(1e-2 * values[:, -1:], self._floor))

    def is_coloured(self, rows: int) -> bool:
        """Whether the first `rows` rows of the residual fail the test of whiteness (at one in a thousand)."""
        result = whiteness(self._parts[0][:rows, None])
        return result is not None and result[1] < 1e-3

    @property
    def sum_of_squares(self) -> float:
        """Of the residual, as the fitted columns leave it."""
        return float(np.sum(self._parts[0] ** 2))

    def without(self, first: int, last: int) -> OffsetScan:
        """The scan of what is left once an offset in this interval is fitted too."""
        residual, offset, fitted = self._parts
        inside = np.zeros_like(offset)
        inside[first:last] = offset[first:last]
        inside = inside[:, np.linalg.norm(inside, axis=0) > 0]
        return OffsetScan(residual, offset, np.hstack([fitted, inside]))


def find_interval(scan: OffsetScan, to_the_end: bool, noise_dof: float, shortest: int, rows: int) -> Interval | None:
    """The interval with the strongest evidence for an offset.

    A coarse search runs over a grid, length by length; a refinement moves either end row by row. The p-value is
    multiplied by the number of intervals searched (Bonferroni). A coloured residual has offsets everywhere, a
    disturbance stands out: there the evidence is compared with that of the interval's peers, other intervals of its
    length, looked at once the interval itself is explained.

    Parameters
    ----------
    to_the_end : only intervals that reach the last row: a step
    noise_dof : degrees of freedom of the noise estimate; infinite where the noise is declared
    shortest : rows of the shortest interval
    rows : the first so many rows of the scan are measurements; the rest states priors
    """
    edges = np.unique(np.linspace(0, rows, min(rows, _GRID) + 1).astype(np.int64))
    peers = _transients(edges, shortest)
    groups = [_steps(edges, shortest, rows)] if to_the_end else peers
    step = int(np.max(np.diff(edges)))
    best: Interval | None = None
    finer = max(rows / (len(edges) - 1), 1.0)
    searched = sum(len(first) for first, _ in groups) * finer ** (1 if to_the_end else 2)
    for first, last in groups:
        if len(first) == 0:
            continue
        gain, dof, _ = scan.gain(first, last)
        k = int(np.argmax(gain))
        if best is not None and _log_p(gain[k], dof[k], noise_dof) + np.log(searched) > best.log_p:
            continue  # not even without the colour
        a, b = refine(scan, int(first[k]), int(last[k]), to_the_end, shortest, step, rows)
        one_gain, one_dof, beta = scan.gain(np.array([a]), np.array([b]))
        log_p = _log_p(one_gain[0], one_dof[0], noise_dof)
        left = scan.without(a, b)
        if left.is_coloured(rows):
            log_p = max(log_p, _log_p_among_peers(left, float(one_gain[0]), int(one_dof[0]), a, b, peers, rows))
        log_p = min(log_p + float(np.log(searched)), 0.0)
        if best is None or log_p < best.log_p:
            statistic = likelihood_ratio(float(one_gain[0]), noise_dof)
            best = Interval(
                a, b, float(one_gain[0]), statistic, int(one_dof[0]), log_p, float(np.log(searched)), beta[0]
            )
    return best


def _running(values: FloatArray) -> FloatArray:
    return np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])


def _steps(edges: IntArray, shortest: int, rows: int) -> tuple[IntArray, IntArray]:
    """Onsets of a step. With a free bias a step right after the start is a transient at the start, and is called so."""
    inner = edges[(edges >= _START_UP * rows) & (edges <= rows - shortest)]
    return inner, np.full(len(inner), rows, dtype=np.int64)


def _transients(edges: IntArray, shortest: int) -> list[tuple[IntArray, IntArray]]:
    """Intervals grouped by length; lengths grow by a quarter up to half the rows, beyond that the rest is disturbed.

    An interval that reaches the last row is a step, as is a long one from the first row on.
    """
    groups = []
    lengths = np.unique(np.round(1.25 ** np.arange(0, 40)).astype(np.int64))
    for length in lengths[lengths <= max((len(edges) - 1) // 2, 1)]:
        starts = np.arange(0, len(edges) - length, max(int(length) // 4, 1))
        first, last = edges[starts], edges[starts + length]
        keep = (last - first >= shortest) & (last < edges[-1]) & ((first > 0) | (last < _START_UP * edges[-1]))
        groups.append((first[keep], last[keep]))
    return groups


def _log_p(gain: float, dof: int, noise_dof: float) -> float:
    return log_p_value(float(gain), int(dof), noise_dof)


def _log_p_among_peers(
    left: OffsetScan, gain: float, dof: int, a: int, b: int, peers: list[tuple[IntArray, IntArray]], rows: int
) -> float:
    """Log p of an offset in a coloured residual, by comparison with other intervals of about its length.

    Peers that do not overlap the interval, where there are enough of them, else all; the longest intervals that have
    enough peers stand for longer ones. About rows / length - 1 of them are independent: F with that many times `dof`.
    """
    factor = 1.0
    for first, last in peers:
        apart = (last <= a) | (first >= b)
        if np.sum(apart) < _LEAST_PEERS:
            apart = np.ones(len(first), dtype=bool)
        if np.sum(apart) >= _LEAST_PEERS:
            peer_gain, peer_dof, _ = left.gain(first[apart], last[apart])
            if np.any(peer_dof > 0):
                factor = float(np.median(peer_gain[peer_dof > 0] / stats.chi2.median(peer_dof[peer_dof > 0])))
            if np.median(last - first) >= b - a:
                break
    independent = max(rows / min(b - a, rows - (b - a)) - 1.0, 1.0)
    return float(stats.f.logsf(gain / dof / max(factor, 1.0), dof, dof * independent)) if dof else 0.0


def refine(scan: OffsetScan, a: int, b: int, to_the_end: bool, shortest: int, step: int, rows: int) -> tuple[int, int]:
    """Move both ends row by row to where the gain is largest, but not so far that the interval gets another name."""
    start_up = _START_UP * rows
    for _ in range(2):
        starts = np.arange(max(a - step, 0), min(a + step, b - shortest) + 1)
        starts = starts[(starts >= start_up) if to_the_end else (starts > 0) | (b < start_up)]
        if len(starts):
            gain, _, _ = scan.gain(starts, np.full(len(starts), b))
            a = int(starts[np.argmax(gain)])
        if not to_the_end:
            ends = np.arange(max(b - step, a + shortest), min(b + step, rows - 1) + 1)
            ends = ends[(a > 0) | (ends < start_up)]
            if len(ends):
                gain, _, _ = scan.gain(np.full(len(ends), a), ends)
                b = int(ends[np.argmax(gain)])
    return a, b
