"""Search for the interval of a step or a transient where an offset lives on in a state: flights, poses with a wandering
bias, and ranges, whose satellites' errors last.

The sensitivity of the innovations to a step at each of a grid of onsets comes from one pass; a transient is the
difference of two steps, so all intervals follow from the steps' joint information. A step may have parameters besides
its offset: a satellite's has a drift.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from sinan.estimator.evidence.intervals.doubted import Doubted, explained
from sinan.estimator.evidence.intervals.sudden import doubts, jumps
from sinan.estimator.evidence.score import CONFUSED, gain_of, log_p_among, log_p_value
from sinan.estimator.evidence.source import LocalFinding
from sinan.estimator.evidence.term import Term
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.effects import Effect, effect

#: Onsets that are tried, and how much finer they are tried about the best: bound of work; half and twice move an
#: interval by 1 % of its length at most (`bounds_of_work flight`).
_ONSETS, _FINER = 25, 5
#: By how much `refined` knows an end of an interval better than it was told: two grids, of which each is `_FINER`
#: times finer.
REFINED = _FINER**2
#: Ends on the grid may lose most of a strong step's gain, which a finer grid gives back, but from this share of the
#: strongest of all streams on nothing would come first: bound of work (`bounds_of_work flight`).
_WORTH_REFINING = 0.05
#: An offset direction is seen where its information exceeds this share of that of the best seen one: its sigma is
#: 1 / sqrt(0.001) = 32 times as large.
_FLOOR = 1e-3
#: An onset this long before a reading includes it [s]: the step of the finest stamps, of a ULog, 1 us = 1e-6 s.
_JUST_BEFORE = 1e-6
#: Intervals whose gains of -2 log L differ by less than 1^2 = 1, one sigma of an end, are not told apart: of those the
#: smallest offset is taken.
_ALIKE = 1.0
#: A combination of columns of unit length that has less than this share of the largest one's square is none: rounding
#: leaves 1e-16 of that a row, of which there are some thousands.
_DEPENDENT = 1e-12
#: With a wandering bias a step in the first or last part of the log is no step, by this share of it: a choice of words,
#: as `localise._START_UP`. Half and twice change nothing of a hover whose GPS is off for a while (`bounds_of_work
#: flight`).
_EDGE = 0.1
#: Logarithm of the p-value above which intervals explain what they would of white innovations: a stated risk.
_AS_WHITE = np.log(1e-3)
#: Further intervals that may be effects too: bound of work (`bounds_of_work flight`).
_FURTHER = 3


@dataclass(frozen=True)
class Rows:
    """Sensitivities of the whitened innovations, one row a component, in the order of time.

    Attributes
    ----------
    own, wanted : (r, .) by the parameters of the model's own terms, and by those asked for
    white : (r,) whitened innovations
    sensor, t : (r,) name of the sensor of each, and its stamp [s]
    doubted : of these, the readings that the filter doubts; None: there are none
    """

    own: FloatArray
    wanted: FloatArray
    white: FloatArray
    sensor: npt.NDArray[np.str_]
    t: FloatArray
    doubted: Doubted | None = None

    def without(self, mine: BoolArray, beta: FloatArray) -> Rows:
        """The rows without one of the own terms: `mine` are its parameters, `beta` their estimate."""
        return replace(self, own=self.own[:, ~mine], white=self.white + self.own[:, mine] @ beta)


#: A stream or a satellite, and the time from which on it is off [s].
Step = tuple[str, float]
#: steps -> sensitivities to them
Pass = Callable[[Sequence[Step]], Rows]
#: Innovations times columns that one pass may keep in memory: 8 bytes each = 240 MB.
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
    joints = _joints(streams, start, end, rows_of, readings)
    coarse = [(stream, *best) for stream, joint in joints.items() for best in _best_of(joint, len(streams[stream]))]
    strongest = max((best.gain for _, _, best, _ in coarse), default=0.0)
    spacing = (end - start) / _ONSETS
    found: list[LocalFinding] = []
    for stream, family, best, searched in coarse:
        worth = log_p_value(best.gain, best.dof) + searched < refine_below
        refine = worth and best.gain > _WORTH_REFINING * strongest
        if refine:
            best = refined(rows_of, stream, best.interval, spacing, streams[stream], start, end)
        if family == "transient" and _begins_with_stream(best.interval, streams[stream], start, end):
            after = _step_after(rows_of, stream, best.interval[1], end)
            if best.gain - after.gain < CONFUSED:
                family, best = "step", after
        log_p = log_p_value(best.gain, best.dof)
        short = refine and best.interval[1] - best.interval[0] < spacing
        if short and log_p + searched < refine_below:
            log_p = max(log_p, _log_p_among_peers(rows_of, stream, best, streams[stream], (start, end)))
        term = Term(f"{stream}.{family}", best.interval)
        found.append(LocalFinding(term, best.gain, best.dof, min(log_p + searched, 0.0), best.beta, searched))
    return found


def _begins_with_stream(interval: tuple[float, float], stamps: FloatArray, start: float, end: float) -> bool:
    """Whether a transient has no reading before it and is no short one: where the bias is free, a step begins with its
    end, and nothing else is there.
    """
    inside = stamps[(stamps >= start) & (stamps <= end)]
    first, last = (inside[0], inside[-1]) if len(inside) else (start, end)
    return bool(interval[0] <= first and interval[1] > first + _EDGE * (last - first))


def _step_after(rows_of: Pass, stream: str, onset: float, end: float) -> _Best:
    """The step that begins at an onset."""
    size = effect(f"{stream}.step").size
    joint = _Joint(rows_of([(stream, onset)]), size, np.array([onset]), span=(-np.inf, end))
    pair = _to_the_end(np.arange(1))
    (gain,), (dof,), (beta,) = joint.gain(pair)
    return _Best((onset, end), float(gain), int(dof), beta, joint.columns(pair[0]))


def _joints(
    streams: Mapping[str, FloatArray], start: float, end: float, rows_of: Pass, readings: int
) -> dict[str, _Joint]:
    """By stream, steps from each onset of a grid on, and from each reading at which the stream jumps."""
    grid = grid_of((start, end))
    joints: dict[str, _Joint] = {}
    for group in _groups(streams, readings):
        sizes = {stream: effect(f"{stream}.step").size for stream in group}
        rows = rows_of([step for stream in group for step in _steps(stream, grid)])
        parts = dict(zip(group, _columns(rows, [len(grid) * sizes[s] for s in group]), strict=True))
        sudden = {s: np.union1d(_jumps(parts[s], s, grid, sizes[s]), _doubts(rows, s)) for s in group}
        columns = [step for stream in group for step in _steps(stream, sudden[stream])]
        more = rows_of(columns) if columns else replace(rows, wanted=np.zeros((len(rows.white), 0)))
        besides = _columns(more, [len(sudden[s]) * sizes[s] for s in group])
        for stream, added in zip(group, besides, strict=True):
            wanted = np.hstack([parts[stream].wanted, added.wanted])
            onsets = np.concatenate([grid, sudden[stream]])
            both = replace(rows, wanted=wanted)
            joints[stream] = _Joint(both, sizes[stream], onsets, len(grid), (start, end))
    return joints


def _steps(stream: str, onsets: FloatArray) -> list[Step]:
    return [(stream, float(t)) for t in onsets]


def strongest_onset(
    rows_of: Pass, stamps: Mapping[str, FloatArray], size: int, end: float
) -> tuple[dict[str, float], Step]:
    """Which of several streams is off from when on to the end of the data, if one of them is.

    Parameters
    ----------
    rows_of : the sensitivity pass
    stamps : by stream, those of its readings [s], from 0 on
    size : parameters of a step, of which the first is its offset
    end : of the data [s]

    Returns
    -------
    The largest drop of -2 log L by a step of each on the grid; the strongest, its onset on a stamp
    """
    grid = np.unique(grid_of((0.0, end)))
    rows = rows_of([step for stream in stamps for step in _steps(stream, grid)])
    parts = _columns(rows, [len(grid) * size] * len(stamps))
    gain = {
        stream: _Joint(part, size, grid, span=(0.0, end)).gain(_to_the_end(np.arange(len(grid))))[0]
        for stream, part in zip(stamps, parts, strict=True)
    }
    best = max(gain, key=lambda stream: float(np.max(gain[stream])))
    onset = float(grid[np.argmax(gain[best])])
    if len(stamps[best]) > 1 and len(grid) > 1:
        interval = onset, end
        onset = refined(rows_of, best, interval, end / _ONSETS, stamps[best], 0.0, end, size, 1).interval[0]
    return {stream: float(np.max(gain[stream])) for stream in gain}, (best, onset)


#: Onsets among which `strongest_onset` takes the best.
SEARCHED = _ONSETS * _FINER


def declared_step(step: Step) -> Effect:
    """The declaration of a step."""
    return effect(f"{step[0]}.step").over(step[1], np.inf)


def grid_of(span: tuple[float, float]) -> FloatArray:
    """Onsets over a span [s] among which intervals are searched first."""
    return np.linspace(*span, _ONSETS + 1)[:-1]


def _columns(rows: Rows, widths: Sequence[int]) -> list[Rows]:
    """The rows with so many of the wanted columns each."""
    parts = np.split(rows.wanted, np.cumsum(widths)[:-1], axis=1)
    return [replace(rows, wanted=part) for part in parts]


def _jumps(rows: Rows, stream: str, grid: FloatArray, size: int) -> FloatArray:
    """Just before the readings at which a stream with readings of its own jumps."""
    mine = rows.sensor == stream
    if not np.any(mine):
        return np.zeros(0)
    t = rows.t[mine]
    n = len(np.unique(t))
    if len(t) % n:  # two readings with one stamp
        return np.zeros(0)
    answers = rows.wanted[mine].reshape(n, len(t) // n, len(grid), size)
    return jumps(answers, rows.white[mine].reshape(n, -1), t[:: len(t) // n], grid) - _JUST_BEFORE


def _doubts(rows: Rows, stream: str) -> FloatArray:
    """Just before the readings from which on the filter doubts a stream."""
    if rows.doubted is None:
        return np.zeros(0)
    first = rows.doubted.row[rows.doubted.first]
    mine = rows.sensor[first] == stream
    t = np.unique(rows.t[rows.sensor == stream])
    doubt = np.zeros(len(t))
    doubt[np.searchsorted(t, rows.t[first[mine]])] = -np.log(rows.doubted.weight[mine])
    return doubts(t, doubt) - _JUST_BEFORE


def _log_p_among_peers(rows_of: Pass, stream: str, best: _Best, stamps: FloatArray, span: tuple[float, float]) -> float:
    """Logarithm of the p-value of an offset for a shorter time than the grid's spacing, by comparison with its peers:
    as many as the grid has onsets, of its length, elsewhere, looked at once the offset itself is explained.
    -inf where they explain what they would of white innovations, perhaps once some others, which are effects then, are
    explained too.
    """
    begin, end = span
    length = best.interval[1] - best.interval[0]
    onsets = np.linspace(begin, end - length, _ONSETS)
    onsets = onsets[(onsets + length <= best.interval[0]) | (onsets >= best.interval[1])]
    m, size = len(onsets), effect(f"{stream}.step").size
    plain = rows_of([*_steps(stream, onsets), *_steps(stream, onsets + length)])
    explained = [best.column]

    def jointly(rows: Rows) -> Rows:
        return replace(rows, own=np.hstack([rows.own, *explained]))

    peers = np.zeros(0)
    for _ in range(_FURTHER + 1):
        joint = _Joint(jointly(plain), size, np.arange(2.0 * m))  # numbered: an end may be the onset of another
        gain, dof, _ = joint.gain(np.stack([np.arange(m), np.arange(m) + m], axis=1))
        seen = dof > 0
        if not np.any(seen) or log_p_value(float(np.sum(gain[seen])), int(np.sum(dof[seen]))) > _AS_WHITE:
            return -np.inf
        if not len(peers):
            peers = gain[seen] / dof[seen]
        t = float(onsets[int(np.argmax(gain))])
        spacing = (end - begin) / _ONSETS
        explained.append(refined(lambda s: jointly(rows_of(s)), stream, (t, t + length), spacing, stamps, *span).column)
    return log_p_among(best.gain / best.dof, peers, best.dof)


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


def _best_of(joint: _Joint, readings: int) -> list[tuple[str, _Best, float]]:
    """By family, the best interval and the logarithm of the number searched: of the grid's, or of the readings where an
    end is at a jump.
    """
    found = []
    for family, pairs in (("step", joint.steps()), ("transient", joint.transients())):
        if len(pairs):
            gain, dof, beta = joint.gain(pairs)
            at_jumps = joint.sudden[pairs[:, 0]].astype(int) + joint.sudden[pairs[:, 1]] * (pairs[:, 1] >= 0)
            searched = np.log(np.sum(at_jumps == 0) * _FINER) + at_jumps * np.log(max(readings / _ONSETS, 1.0))
            k = int(np.argmax(gain - 2.0 * dof - 2.0 * searched))
            best = _Best(joint.times(pairs[k]), float(gain[k]), int(dof[k]), beta[k], joint.columns(pairs[k]))
            found.append((family, best, float(searched[k])))
    return found


@dataclass(frozen=True)
class _Best:
    """An interval: its gain, the directions that are seen, the offset, and (r, size) sensitivities to steps at its
    onset and, unless it lasts to the end of the data, at its end.
    """

    interval: tuple[float, float]
    gain: float
    dof: int
    beta: FloatArray
    steps: tuple[FloatArray, ...]

    @property
    def column(self) -> FloatArray:
        """(r, size) sensitivities to the offset in the interval."""
        return self.steps[0] - self.steps[1] if len(self.steps) > 1 else self.steps[0]


def projected_out(columns: FloatArray, values: FloatArray) -> FloatArray:
    """What of `values` (r, k) no combination of the columns (r, m) is; columns of any unit."""
    if not columns.shape[1]:
        return values
    unit = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    power, directions = np.linalg.eigh(unit.T @ unit)
    there = power > _DEPENDENT * max(float(np.max(power, initial=0.0)), 1e-300)
    Q = unit @ (directions[:, there] / np.sqrt(power[there]))
    return np.asarray(values - Q @ (Q.T @ values))


class _Joint:
    """Joint information and score of steps at a number of onsets, what the model has already projected out.

    Parameters
    ----------
    onsets : [s], in any order
    on_grid : how many of them, the first, are a grid; the others are at jumps
    span : begin and end of the data [s]
    """

    def __init__(
        self, rows: Rows, size: int, onsets: FloatArray, on_grid: int | None = None,
        span: tuple[float, float] = (-np.inf, np.inf),
    ) -> None:  # fmt: skip
        W = projected_out(rows.own, rows.wanted)
        white = projected_out(rows.own, rows.white[:, None])[:, 0]
        m = len(onsets)
        order = np.argsort(onsets, kind="stable")
        W = W.reshape(-1, m, size)[:, order].reshape(-1, m * size)
        self.onsets, self.size, self.span = onsets[order], size, span
        self.sudden = order >= (m if on_grid is None else on_grid)
        self.W, self.white, self.doubted = W, white, rows.doubted

    @cached_property
    def L(self) -> FloatArray:
        """(m, m, size, size) information by onsets."""
        m, size = len(self.onsets), self.size
        return np.asarray((self.W.T @ self.W).reshape(m, size, m, size).transpose(0, 2, 1, 3))

    @cached_property
    def b(self) -> FloatArray:
        """(m, size) score."""
        return np.asarray((self.W.T @ self.white).reshape(len(self.onsets), self.size))

    def times(self, pair: IntArray) -> tuple[float, float]:
        """Interval of a pair."""
        return _times(self.onsets, pair, self.span[1])

    def columns(self, pair: IntArray) -> tuple[FloatArray, ...]:
        """(r, size) sensitivities to steps at the ends of an interval."""
        n = self.size
        return tuple(self.W[:, k * n : (k + 1) * n] for k in pair if k >= 0)

    def steps(self) -> IntArray:
        """(k, 2) onsets after the first part; the second number -1 stands for "to the end"."""
        begin, end = self.span
        return _to_the_end(np.flatnonzero(self.onsets > begin + _EDGE * (end - begin)))

    def transients(self) -> IntArray:
        """(pairs, 2) onset and end."""
        i, j = np.triu_indices(len(self.onsets), 1)
        begin, end = self.span
        edge = _EDGE * (end - begin)
        # what goes on to the end is a step, and so is a long one from the start on: the bias before it is free
        ended = (self.onsets[j] < end - edge) & ((self.onsets[i] > begin) | (self.onsets[j] <= begin + edge))
        i, j = i[ended], j[ended]
        return np.stack([i, j], axis=1)

    def gain(self, pairs: IntArray) -> tuple[FloatArray, IntArray, FloatArray]:
        """Gain, dof and offset of each interval, of doubted readings by their law."""
        i, j = pairs[:, 0], pairs[:, 1]
        ends = j >= 0
        L, b = self.L[i, i].copy(), self.b[i].copy()
        k = np.where(ends, j, 0)
        cross = self.L[i, k]
        L += np.where(ends[:, None, None], self.L[k, k] - cross - np.swapaxes(cross, 1, 2), 0.0)
        b -= np.where(ends[:, None], self.b[k], 0.0)
        seen_from = float(_FLOOR * np.max(np.linalg.eigvalsh(L)))
        gain, dof, beta = gain_of(L, b, lambda _: seen_from)
        if self.doubted is not None:
            W = self.W[self.doubted.row].reshape(-1, len(self.onsets), self.size).transpose(1, 0, 2)
            inside = W[i] - np.where(ends[:, None, None], W[k], 0.0)
            gain, dof, beta = explained(L, b, inside, self.white[self.doubted.row], self.doubted, seen_from)
        return gain, dof, beta


def _to_the_end(first: IntArray) -> IntArray:
    """(k, 2) pairs of onsets that stand for intervals to the end of the data."""
    return np.stack([first, np.full(len(first), -1)], axis=1)


def _times(grid: FloatArray, pair: IntArray, end: float) -> tuple[float, float]:
    return float(grid[pair[0]]), float(grid[pair[1]]) if pair[1] >= 0 else end


def refined(
    rows_of: Pass,
    stream: str,
    interval: tuple[float, float],
    spacing: float,
    stamps: FloatArray,
    start: float,
    end: float,
    size: int | None = None,
    offsets: int | None = None,
) -> _Best:
    """The interval on finer and finer grids, at last on the stamps of the readings themselves.

    Where nothing is measured for a while, or only what an offset adds up to, many intervals explain the same: that with
    the smallest offset is taken.

    Parameters
    ----------
    rows_of : the sensitivity pass
    stream : of the step
    interval : to begin with [s]; to the end of the data: only the onset is searched
    spacing : how far the ends may be off [s]
    stamps : of the stream's readings [s]
    start, end : of the data [s]
    size : parameters of a step; default: those of the stream's
    offsets : how many of them, the first, are its offset; default: all
    """
    a, b = interval
    size = size or effect(f"{stream}.step").size
    to_the_end = b >= end
    for last_round in (False, False, True):
        near = _stamps_near if last_round else _grid_near
        first = near(a, spacing, stamps, start, end)
        last = np.array([]) if to_the_end else near(b, spacing, stamps, start, end)
        onsets = np.unique(np.concatenate([first, last]))
        joint = _Joint(rows_of(_steps(stream, onsets)), size, onsets)
        i = np.searchsorted(onsets, first)
        if to_the_end:
            pairs = _to_the_end(i)
        else:
            j = np.searchsorted(onsets, last)
            pairs = np.array([(p, q) for p in i for q in j if q > p])
        gain, dof, beta = joint.gain(pairs)
        alike = np.flatnonzero(gain > np.max(gain) - _ALIKE)
        k = int(alike[np.argmin(np.linalg.norm(beta[alike, :offsets], axis=1))])
        a, b = _times(onsets, pairs[k], end)
        best = _Best((a, b), float(gain[k]), int(dof[k]), beta[k], joint.columns(pairs[k]))
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
