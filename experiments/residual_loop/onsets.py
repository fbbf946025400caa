"""Search for the interval of a step or a transient in a flight, where an offset lives on in the filter's state.

The sensitivity of the innovations to a step at each of a grid of onsets comes from one pass; a transient is the
difference of two steps, so all intervals follow from the steps' joint information.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import stats

from estimator.score import log_p_value
from estimator.whiteness import whiteness
from experiments.residual_loop.source import LocalFinding
from experiments.residual_loop.term import Term
from sensors.arrays import FloatArray, IntArray
from sensors.effects import Effect, effect

_ONSETS = 25
_FINER = 5
#: Ends on the grid may lose most of a strong step's gain, which a finer grid gives back; below this share of the
#: strongest of all streams nothing would come first.
_WORTH_REFINING = 0.05
_LEAST_PEERS = 6
#: An offset direction is seen where its information exceeds this share of that of the best seen one.
_FLOOR = 1e-3
#: An onset this long before a reading includes it [s].
_JUST_BEFORE = 1e-6
#: With a wandering bias a step in the first or last part of the log is no step: share of the log.
_EDGE = 0.1
#: p-value of the whiteness test below which innovations count as coloured.
_COLOURED = 1e-3


@dataclass(frozen=True)
class Rows:
    """Sensitivities of the whitened innovations, one row a component, in the order of time.

    Attributes
    ----------
    own, wanted : (r, .) by the parameters of the model's own terms, and by those asked for
    white : (r,) whitened innovations
    sensor : (r,) name of the sensor of each
    """

    own: FloatArray
    wanted: FloatArray
    white: FloatArray
    sensor: npt.NDArray[np.str_]


#: effects over their intervals -> sensitivities to them
Pass = Callable[[Sequence[Effect]], Rows]
#: Innovations times columns that one pass may keep in memory.
_MOST_ELEMENTS = 3e7


def best_onsets(
    streams: Mapping[str, FloatArray], start: float, end: float, rows_of: Pass, readings: int, refine_below: float
) -> list[LocalFinding]:
    """The best step and the best transient of every stream.

    Parameters
    ----------
    streams : by name, the stamps of its readings [s]
    start, end : of the data [s]
    rows_of : the sensitivity pass
    readings : components of all innovations, to keep memory bounded
    refine_below : logarithm of the p-value below which an interval is worth a finer grid
    """
    grid = np.linspace(start, end, _ONSETS + 1)[:-1]
    coarse: list[tuple[str, str, _Joint, _Best, float]] = []
    for group in _groups(streams, readings):
        steps = {stream: effect(f"{stream}.step") for stream in group}
        columns = [step.over(float(t), np.inf) for step in steps.values() for t in grid]
        rows = rows_of(columns)
        at = 0
        for stream, step in steps.items():
            width = step.size * len(grid)
            joint = _Joint(replace(rows, wanted=rows.wanted[:, at : at + width]), step.size, grid)
            at += width
            coarse += [(stream, family, joint, *best) for family, best in _on_the_grid(joint, end)]
    strongest = max((best.gain for _, _, _, best, _ in coarse), default=0.0)
    found: list[LocalFinding] = []
    for stream, family, joint, best, searched in coarse:
        worth = log_p_value(best.gain, best.dof) + searched < refine_below
        if worth and best.gain > _WORTH_REFINING * strongest:
            step, spacing = effect(f"{stream}.step"), float(grid[1] - grid[0])
            best = refined(rows_of, step, best.interval, spacing, streams[stream], start, end)
        log_p = log_p_value(best.gain, best.dof)
        if worth and joint.is_coloured_without(stream, best):
            log_p = _log_p_among_peers(joint, best, end)
        term = Term(f"{stream}.{family}", best.interval)
        found.append(LocalFinding(term, best.gain, best.dof, min(log_p + searched, 0.0), best.beta, searched))
    return found


def _groups(streams: Iterable[str], readings: int) -> list[list[str]]:
    """Streams that share a pass."""
    groups: list[list[str]] = [[]]
    columns = 0
    for stream in streams:
        width = effect(f"{stream}.step").size * _ONSETS
        if groups[-1] and (columns + width) * readings > _MOST_ELEMENTS:
            groups.append([])
            columns = 0
        groups[-1].append(stream)
        columns += width
    return groups


def _on_the_grid(joint: _Joint, end: float) -> list[tuple[str, tuple[_Best, float]]]:
    """By family, the best interval of the grid and the logarithm of the number searched."""
    found = []
    for family, pairs in (("step", joint.steps()), ("transient", joint.transients())):
        if len(pairs):
            gain, dof, beta = joint.gain(pairs)
            k = int(np.argmax(gain - 2.0 * dof))
            best = _Best(_times(joint.onsets, pairs[k], end), float(gain[k]), int(dof[k]), beta[k],
                         joint.column(pairs[k]))  # fmt: skip
            found.append((family, (best, float(np.log(len(pairs) * _FINER)))))
    return found


@dataclass(frozen=True)
class _Best:
    """An interval: its gain, the directions that are seen, the offset, and its (r, size) sensitivities."""

    interval: tuple[float, float]
    gain: float
    dof: int
    beta: FloatArray
    column: FloatArray


class _Joint:
    """Joint information and score of steps at a grid of onsets, what the model has already projected out."""

    def __init__(self, rows: Rows, size: int, onsets: FloatArray) -> None:
        own, W, white = rows.own, rows.wanted, rows.white
        if own.shape[1]:
            Q = np.linalg.qr(own / np.maximum(np.linalg.norm(own, axis=0), 1e-300))[0]
            W, white = W - Q @ (Q.T @ W), white - Q @ (Q.T @ white)
        m = len(onsets)
        self.onsets, self.size = onsets, size
        self.L = (W.T @ W).reshape(m, size, m, size).transpose(0, 2, 1, 3)
        self.b = (W.T @ white).reshape(m, size)
        self.W, self.white, self.sensor = W, white, rows.sensor

    def column(self, pair: IntArray) -> FloatArray:
        """(r, size) sensitivities to an offset in an interval."""
        n = self.size
        first = self.W[:, pair[0] * n : pair[0] * n + n]
        return first - self.W[:, pair[1] * n : pair[1] * n + n] if pair[1] >= 0 else first

    def is_coloured_without(self, stream: str, found: _Best) -> bool:
        """Whether the innovations stay coloured once the offset is taken off: those of the stream, of an IMU all."""
        left = self.white - found.column @ found.beta
        names = [stream] if stream in self.sensor else list(np.unique(self.sensor))
        results = [whiteness(left[self.sensor == name][:, None]) for name in names]
        return any(r is not None and r[1] < _COLOURED / len(names) for r in results)

    def steps(self) -> IntArray:
        """(m - 1, 2) onsets after the first; the second number -1 stands for "to the end"."""
        inner = np.arange(max(round(_EDGE * len(self.onsets)), 1), len(self.onsets))
        return np.stack([inner, np.full(len(inner), -1)], axis=1)

    def transients(self) -> IntArray:
        """(pairs, 2) onset and end."""
        i, j = np.triu_indices(len(self.onsets), 1)
        m = len(self.onsets)
        # what goes on to the end is a step, and so is a long one from the start on: the bias before it is free
        ended = (j < round((1.0 - _EDGE) * m)) & ((i > 0) | (j <= round(_EDGE * m)))
        i, j = i[ended], j[ended]
        return np.stack([i, j], axis=1)

    def gain(self, pairs: IntArray) -> tuple[FloatArray, IntArray, FloatArray]:
        """Gain, dof and offset of each interval."""
        i, j = pairs[:, 0], pairs[:, 1]
        ends = j >= 0
        L, b = self.L[i, i].copy(), self.b[i].copy()
        k = np.where(ends, j, 0)
        cross = self.L[i, k]
        L += np.where(ends[:, None, None], self.L[k, k] - cross - np.swapaxes(cross, 1, 2), 0.0)
        b -= np.where(ends[:, None], self.b[k], 0.0)
        values, vectors = np.linalg.eigh(L)
        floor = _FLOOR * np.max(values)
        seen = values > floor
        projected = np.einsum("mij,mi->mj", vectors, b)
        inverse = np.where(seen, 1.0 / np.where(seen, values, 1.0), 0.0)
        return (
            np.sum(projected**2 * inverse, axis=1),
            seen.sum(axis=1),
            np.einsum("mij,mj->mi", vectors, projected * inverse),
        )

    def without(self, column: FloatArray) -> _Joint:
        """What is left once an offset with these sensitivities is fitted."""
        other = object.__new__(_Joint)
        other.onsets, other.size = self.onsets, self.size
        other.W, other.white, other.sensor = self.W, self.white, self.sensor
        m, n = len(self.onsets), self.size
        flat = self.L.transpose(0, 2, 1, 3).reshape(m * n, m * n)
        cross = self.W.T @ column
        A = np.linalg.pinv(column.T @ column, rcond=1e-9, hermitian=True)
        other.L = (flat - cross @ A @ cross.T).reshape(m, n, m, n).transpose(0, 2, 1, 3)
        other.b = (self.b.reshape(-1) - cross @ (A @ (column.T @ self.white))).reshape(m, n)
        return other


def _log_p_among_peers(joint: _Joint, found: _Best, end: float) -> float:
    """Log p of one interval among coloured innovations, by comparison with others of about its length."""
    log_p = log_p_value(found.gain, found.dof)
    if found.dof == 0:
        return log_p
    m, spacing = len(joint.onsets), float(joint.onsets[1] - joint.onsets[0])
    length = (min(found.interval[1], end) - found.interval[0]) / spacing
    all_pairs = joint.transients()
    lengths = all_pairs[:, 1] - all_pairs[:, 0]
    near = np.abs(lengths - max(round(min(length, m // 3)), 1)) <= 1
    left, left_dof, _ = joint.without(found.column).gain(all_pairs[near])
    seen = left_dof > 0
    if np.sum(seen) < _LEAST_PEERS:
        return log_p
    factor = max(float(np.median(left[seen] / stats.chi2.median(left_dof[seen]))), 1.0)
    independent = max(m / max(min(length, m - length), 1.0) - 1.0, 1.0)
    F = found.gain / found.dof / factor
    return max(log_p, float(stats.f.logsf(F, found.dof, found.dof * independent)))


def _times(grid: FloatArray, pair: IntArray, end: float) -> tuple[float, float]:
    return float(grid[pair[0]]), float(grid[pair[1]]) if pair[1] >= 0 else end


def refined(
    rows_of: Pass,
    step: Effect,
    interval: tuple[float, float],
    spacing: float,
    stamps: FloatArray,
    start: float,
    end: float,
) -> _Best:
    """The interval on finer and finer grids, at last on the stamps of the readings themselves.

    Parameters
    ----------
    rows_of : the sensitivity pass
    step : the step of the stream
    interval : to begin with [s]; to the end of the data: only the onset is searched
    spacing : how far the ends may be off [s]
    stamps : of the stream's readings [s]
    start, end : of the data [s]
    """
    a, b = interval
    to_the_end = b >= end
    for last_round in (False, False, True):
        near = _stamps_near if last_round else _grid_near
        first = near(a, spacing, stamps, start, end)
        last = np.array([]) if to_the_end else near(b, spacing, stamps, start, end)
        onsets = np.unique(np.concatenate([first, last]))
        joint = _Joint(rows_of([step.over(float(t), np.inf) for t in onsets]), step.size, onsets)
        i = np.searchsorted(onsets, first)
        if to_the_end:
            pairs = np.stack([i, np.full(len(i), -1)], axis=1)
        else:
            j = np.searchsorted(onsets, last)
            pairs = np.array([(p, q) for p in i for q in j if q > p])
        gain, dof, beta = joint.gain(pairs)
        k = int(np.argmax(gain))
        a, b = _times(onsets, pairs[k], end)
        best = _Best((a, b), float(gain[k]), int(dof[k]), beta[k], joint.column(pairs[k]))
        spacing /= _FINER
    return best


def _grid_near(t: float, spacing: float, stamps: FloatArray, start: float, end: float) -> FloatArray:
    return np.unique(np.clip(t + np.linspace(-spacing, spacing, 2 * _FINER + 1), start, end))


def _stamps_near(t: float, spacing: float, stamps: FloatArray, start: float, end: float) -> FloatArray:
    """Just before each reading around t: an onset anywhere since the reading before it is the same."""
    k = int(np.searchsorted(stamps, t))
    around = stamps[max(k - _FINER, 0) : k + _FINER + 1]
    around = around[np.abs(around - t) <= 2.0 * spacing + np.median(np.diff(stamps))] - _JUST_BEFORE
    return np.unique(np.clip(np.append(around, t), start, end))
