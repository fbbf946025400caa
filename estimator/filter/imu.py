"""The IMU as the filter integrates it: a table of samples, the noise of every interval, and its gaps.

Between two samples specific force and rate are taken as linear (or, for averaged samples, as constant over the interval
before the stamp). With linear interpolation sample k enters the integral with the weight w_k = (h_{k-1} + h_k) / 2, so
the noise that its sigma adds to the integral is sigma^2 w_k^2. Shared out over the two intervals that meet in
k, interval k has the variance rate

    q_k = sigma^2 (w_k + w_{k+1}) / 2            (sigma^2 h = N^2 for even sampling),

whose sum over all intervals is exactly the accumulated noise, whatever the spacing, and which does not change when a
measurement cuts an interval in two. What the sharing neglects is the correlation of neighbouring intervals: at most the
noise of half a sample at any instant, which does not grow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from sinan.estimator.filter.faults import Note, frozen_runs, saturated_runs, stuck_runs
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import FlightModel, InStep, Upset
from sinan.estimator.filter.low_pass import low_passed_imu
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray, integral, runs_of
from sinan.sensors.recording import ACCEL, GYRO, Stream

#: An interval longer than this many nominal ones is a gap, since what happened inside is not known: 2 < 2.5 < 3. One
#: sample that is lost makes two of them, and is bridged; two make three.
GAP = 2.5
#: Windows from which the unseen motion inside a gap is estimated, at least this many: its sigma is known to
#: 1 / sqrt(2 * 8), a quarter.
GAP_WINDOWS = 8
#: Turn that may have gone unseen, 1-sigma, beyond which nothing that was known is of use [rad]: a filter is linear no
#: longer, since 1 - cos(0.5) = 12 %, and the first readings after the gap tell the attitude better. A choice: half ends
#: the stretch at a gap of 6 s in a figure of eight too, which twice bridges (`bounds_of_work gap`).
UNBRIDGED = 0.5
#: Samples between two gaps that nothing bridges are used where they last so long, since a first state takes 1 s
#: (`alignment.WINDOW`) [s].
SHORTEST_STRETCH = 1.0
#: Length over which roughness is averaged [s], as vibration changes with the throttle: a choice, half and
#: twice of which move no size of a flight without a GPS (`bounds_of_work hand`).
ROUGH = 0.1
_ACCEL, _GYRO = slice(0, 3), slice(3, 6)
#: Samples over which the slope into and out of a saturated stretch is taken: a choice, half and twice of which move no
#: state at the end of a flight that is cut off by 1 % of its sigma (`bounds_of_work clipped`).
_SLOPE = 3
#: A saturated stretch is noted where it lacks this many of the usual steps between samples, as a coarse converter also
#: stays at its largest value, and a step so many times the one before is a jump: a choice, half and twice of which move
#: no state of a flight that is cut off (`bounds_of_work clipped`).
_SEEN = 3.0


@dataclass(frozen=True)
class ImuTable:
    """IMU samples and intervals.

    Attributes
    ----------
    t : (n,) s
    u : (n, 6) specific force [m/s^2] and rate [rad/s] as read
    q_accel, q_gyro : (n - 1,) variance rate of the integral of the noise over the interval [(m/s^2)^2 s, (rad/s)^2 s]
    row : (n,) row of the recording's stream; -1 for a sample that was put into a gap
    notes : gaps, frozen and saturated stretches
    starts : first sample of each stretch: a gap that nothing bridges ends one
    """

    t: FloatArray
    u: FloatArray
    q_accel: FloatArray
    q_gyro: FloatArray
    row: IntArray
    notes: tuple[Note, ...] = ()
    starts: tuple[int, ...] = (0,)

    def __len__(self) -> int:
        return len(self.t)

    @property
    def stretches(self) -> list[tuple[int, int]]:
        """First and last sample of each stretch."""
        return [(first, after - 1) for first, after in pairwise((*self.starts, len(self)))]

    @property
    def spans(self) -> list[tuple[float, float]]:
        """Begin and end of each stretch [s]."""
        return [(float(self.t[first]), float(self.t[last])) for first, last in self.stretches]

    def last_of(self, i: int) -> bool:
        """Whether a sample is the last of a stretch."""
        return i == len(self) - 1 or i + 1 in self.starts


@dataclass(frozen=True)
class ImuSamples:
    """What an IMU measured, whatever its noise: the samples of a table before gaps are bridged.

    Attributes
    ----------
    t, u, row : as in `ImuTable`
    excess : (n, 6) what saturated samples lack, which is in `u`
    notes : frozen and saturated stretches
    """

    t: FloatArray
    u: FloatArray
    row: IntArray
    excess: FloatArray
    notes: tuple[Note, ...]

    @classmethod
    def of(cls, stream: Stream) -> ImuSamples:
        """Of the stream `imu`, frozen stretches taken out."""
        t, u = stream.t, stream.array((*ACCEL, *GYRO))
        keep, excess, notes = _measured(t, u)
        row = np.flatnonzero(keep)
        return cls(t[row], u[row] + excess[row], row, excess[row], tuple(notes))


def imu_table(flight: Flight, samples: ImuSamples | None = None) -> ImuTable:
    """The table of a flight: frozen stretches taken out, gaps filled by interpolation with honest noise.

    Parameters
    ----------
    samples : of its IMU, where they are known
    """
    nominal = 1.0 / flight.model.rate
    samples = ImuSamples.of(flight.recording.streams["imu"]) if samples is None else samples
    t, notes = samples.t, list(samples.notes)
    u = low_passed_imu(t, samples.u, flight.model, flight.recording.breaks)
    h = np.diff(t)
    unseen = {int(k): unseen_motion(t, samples.u, float(h[k]), nominal) for k in np.flatnonzero(h > GAP * nominal)}
    ends = [k for k, (_, turn) in unseen.items() if t[k + 1] in flight.recording.breaks or turn > UNBRIDGED**2]
    q_accel, q_gyro = _noise(t, u, samples.excess, flight.model, ends)
    for k, (velocity, turn) in unseen.items():
        action = "nothing bridges it: a new stretch begins"
        if k not in ends:
            action = "interpolated, with the noise of the unseen motion"
            q_accel[k] = max(q_accel[k], velocity / h[k])
            q_gyro[k] = max(q_gyro[k], turn / h[k])
        notes.append(Note("imu", "gap", float(t[k]), float(t[k + 1]), action))
    table = ImuTable(t, u, q_accel, q_gyro, samples.row, tuple(notes), (0, *(k + 1 for k in ends)))
    bridged = t[[k for k in unseen if k not in ends]]
    return _upset(_filled(_without_short_stretches(table), bridged, nominal), flight.model.upsets)


def _upset(table: ImuTable, upsets: Sequence[Upset]) -> ImuTable:
    """The table with what the motion is open by at some instants, in the intervals that these are in, if any."""
    if not upsets:
        return table
    t, q_accel, q_gyro = table.t, table.q_accel.copy(), table.q_gyro.copy()
    for one in upsets:
        k = int(np.searchsorted(t, one.t, side="right")) - 1
        if not 0 <= k < len(t) - 1:
            continue
        q_accel[k] += one.velocity**2 / (t[k + 1] - t[k])
        q_gyro[k] += one.attitude**2 / (t[k + 1] - t[k])
    return replace(table, q_accel=q_accel, q_gyro=q_gyro)


def _measured(t: FloatArray, u: FloatArray) -> tuple[BoolArray, FloatArray, list[Note]]:
    """(n,) which samples are no frozen ones, (n, 6) what saturated ones lack, and notes on both."""
    notes: list[Note] = []
    keep = np.ones(len(t), dtype=np.bool_)
    for start, stop in frozen_runs(u):
        keep[_lost_from(u, start) : stop] = False
        notes.append(Note("imu", "frozen", float(t[start]), float(t[stop - 1]), "taken as a gap"))
    excess, found = beyond_the_range(t, u)
    for name, part in (("accel", _ACCEL), ("gyro", _GYRO)):
        for start, stop in stuck_runs(u[:, part]):
            if np.any(np.all(excess[start:stop, part] != 0.0, axis=0)):
                continue  # it stays at its limit: saturated
            keep[_lost_from(u[:, part], start) : stop] = False
            notes.append(Note(name, "frozen", float(t[start]), float(t[stop - 1]), "taken as a gap"))
    keep[[0, -1]] = True  # readings are asked for between the first and the last stamp
    return keep, excess, [*notes, *found]


def _noise(
    t: FloatArray, u: FloatArray, excess: FloatArray, model: FlightModel, ends: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """(n - 1,) variance rates of accelerometer and gyroscope: of the samples, of the motion that goes with them, and of
    what saturated ones lack.
    """
    q_accel, q_gyro = _sample_noise(t, 1.0 / model.rate, model, ends)
    if model.in_step != InStep():
        q_accel, q_gyro = q_accel + in_step_accel(t, u, model.in_step), q_gyro + in_step_gyro(t, u, model.in_step)
    if np.any(excess):
        q_accel = q_accel + _unseen(np.max(np.abs(excess[:, _ACCEL]), axis=1), t)
        q_gyro = q_gyro + _unseen(np.max(np.abs(excess[:, _GYRO]), axis=1), t)
    return q_accel, q_gyro


def _without_short_stretches(table: ImuTable) -> ImuTable:
    """The table without stretches in which no first state can be found; the longest stays."""
    first, last = np.array(table.stretches).T
    lasting = table.t[last] - table.t[first]
    short = lasting < SHORTEST_STRETCH
    short[np.argmax(lasting)] = False
    if not np.any(short):
        return table
    left_out = "too short to find a first state in: left out"
    notes = [
        Note("imu", "stretch", float(table.t[i0]), float(table.t[i1]), left_out)
        for i0, i1 in zip(first[short], last[short], strict=True)
    ]
    length = last - first + 1
    kept = np.repeat(~short, length)
    starts = np.cumsum([0, *length[~short][:-1]])
    within, n = kept[:-1], int(np.sum(kept))
    return ImuTable(
        table.t[kept], table.u[kept], table.q_accel[within][: n - 1], table.q_gyro[within][: n - 1], table.row[kept],
        (*table.notes, *notes), tuple(starts.tolist()),
    )  # fmt: skip


def beyond_the_range(t: FloatArray, u: FloatArray) -> tuple[FloatArray, list[Note]]:
    """(n, 6) what a saturated sample lacks on average, and a note on each stretch where that is more than its steps.

    While a reading stays at its limit for a time T, the true value goes on with the slope s that it came with and comes
    back: an arc over the limit of mean height s T / 6, as a parabola has it. A reading that jumps to its extreme, or
    that stands while all others do, has lost the signal: it is no arc, and nothing is added.
    """
    excess, notes = np.zeros_like(u), []
    for name, part in (("accel", _ACCEL), ("gyro", _GYRO)):
        for k in range(part.start, part.stop):
            column = u[:, k]
            usual = float(np.median(np.abs(np.diff(column)))) if len(t) > 1 else 0.0
            for start, stop in saturated_runs(column[:, None]):
                if np.all(u[start:stop] == u[start]):
                    continue
                slopes = [_slope(t[: start + 1], column[: start + 1], usual),
                          _slope(t[stop - 1 :][::-1], column[stop - 1 :][::-1], usual)]  # fmt: skip
                height = max(slopes) * (t[stop - 1] - t[start]) / 6.0
                excess[start:stop, k] = np.copysign(height, column[start] - np.median(column))
                if height > _SEEN * usual:
                    action = "taken as an arc over the limit"
                    notes.append(Note(name, "saturated", float(t[start]), float(t[stop - 1]), action))
    return excess, notes


def _lost_from(u: FloatArray, start: int) -> int:
    """First row of a frozen stretch that says nothing: the second, or the first where the readings jump to it."""
    steps = np.abs(np.diff(u[max(start - 1 - _SLOPE, 0) : start + 1], axis=0))
    usual = np.median(np.abs(np.diff(u, axis=0)), axis=0)
    if len(steps) < 2 or not np.any(steps[-1] > _SEEN * np.maximum(usual, np.max(steps[:-1], axis=0))):
        return start + 1
    return start


def _slope(t: FloatArray, column: FloatArray, usual: float) -> float:
    """Mean slope over the last samples; zero where the last step is a jump: far more than the steps before it."""
    steps = np.abs(np.diff(column[-2 - _SLOPE :]))
    if len(steps) < 2 or steps[-1] > _SEEN * max(usual, float(np.max(steps[:-1]))):
        return 0.0
    n = min(_SLOPE, len(steps))
    return float(abs(column[-1] - column[-1 - n]) / abs(t[-1] - t[-1 - n]))


def _unseen(height: FloatArray, t: FloatArray) -> FloatArray:
    """(n - 1,) variance rate whose integral over each stretch of heights e is (e T)^2: e as uncertain as itself."""
    rate = np.zeros(len(t) - 1)
    for start, stop in runs_of(height > 0.0):
        last = min(stop, len(t) - 1)
        rate[start:last] = float(np.max(height[start:stop])) ** 2 * (t[last] - t[start])
    return rate


def _sample_noise(
    t: FloatArray, nominal: float, model: FlightModel, ends: Sequence[int] = ()
) -> tuple[FloatArray, FloatArray]:
    """(n - 1,) variance rates of accelerometer and gyroscope noise; see the module's derivation.

    Parameters
    ----------
    ends : samples after which nothing is integrated: the last of each stretch but the last
    """
    h = np.diff(t)
    last = np.array(ends, dtype=np.int64)
    if model.averaged:
        width = np.maximum(h, nominal)
    else:
        w = 0.5 * (np.concatenate([[0.0], h]) + np.concatenate([h, [0.0]]))
        w[0], w[-1] = h[0], h[-1]  # the first and the last sample: half an interval each, rounded up
        w[last], w[last + 1] = h[np.maximum(last - 1, 0)], h[np.minimum(last + 1, len(h) - 1)]
        width = 0.5 * (w[:-1] + w[1:])
    return model.accel.sigma**2 * width, model.gyro.sigma**2 * width


def in_step_accel(t: FloatArray, u: FloatArray, share: InStep) -> FloatArray:
    """(n - 1,) variance rate that goes with the accelerometer's second differences [(m/s^2)^2 s]."""
    return share.accel * np.diff(t) * roughness(t, u[:, _ACCEL])


def in_step_gyro(t: FloatArray, u: FloatArray, share: InStep) -> FloatArray:
    """(n - 1,) variance rate that goes with the gyroscope's second differences, and with its rate [(rad/s)^2 s]."""
    square = np.sum(u[:, _GYRO] ** 2, axis=1)
    return share.gyro * np.diff(t) * roughness(t, u[:, _GYRO]) + share.rate**2 * 0.5 * (square[:-1] + square[1:])


def roughness(t: FloatArray, u: FloatArray) -> FloatArray:
    """(n - 1,) mean square of the second differences of (n, 3), of the axes together and over `ROUGH` around."""
    if len(t) < 3:
        return np.zeros(len(t) - 1)
    square = np.mean(np.diff(u, n=2, axis=0) ** 2, axis=1)
    width = max(1, round(ROUGH / float(np.median(np.diff(t)))))
    sums = np.concatenate([[0.0], np.cumsum(square)])
    middle = np.arange(len(t) - 1)
    low, high = np.clip(middle - width // 2 - 1, 0, len(square) - 1), np.clip(middle + width // 2, 1, len(square))
    return np.asarray((sums[high] - sums[low]) / np.maximum(high - low, 1))


def unseen_motion(t: FloatArray, u: FloatArray, length: float, nominal: float) -> tuple[float, float]:
    """Variance of what a straight line across a gap misses, per axis, measured on the log itself.

    Over windows as long as the gap: integral of the samples minus length times the mean of the two ends. Where the log
    has too few such windows, shorter ones are taken and the miss is scaled with the length (a constant error in rate).

    Returns
    -------
    variance of the velocity [(m/s)^2] and of the angle [rad^2]
    """
    h = np.diff(t)
    total = integral(t, u)
    broken = np.concatenate([[0], np.cumsum(h > GAP * nominal)])
    steps = max(2, round(length / nominal))
    while steps > 2:
        starts = np.arange(0, max(len(t) - steps, 0), max(steps // 4, 1))
        starts = starts[broken[starts + steps] == broken[starts]]
        if len(starts) >= GAP_WINDOWS:
            break
        steps //= 2
    else:
        return 0.0, 0.0
    ends = starts + steps
    span = (t[ends] - t[starts])[:, None]
    miss = total[ends] - total[starts] - 0.5 * span * (u[starts] + u[ends])
    variance = np.mean(miss**2, axis=0) * (length / float(np.mean(span))) ** 2
    return float(np.max(variance[:3])), float(np.max(variance[3:]))


def _filled(table: ImuTable, before: FloatArray, nominal: float) -> ImuTable:
    """The table with interpolated samples in the gaps after some instants, so that no step is longer than two nominal
    ones.
    """
    t, u = table.t, table.u
    gaps = np.flatnonzero(np.isin(t, before))
    if not len(gaps):
        return table
    counts = np.ones(len(t), dtype=np.int64)
    counts[gaps] = np.ceil((t[gaps + 1] - t[gaps]) / (2.0 * nominal)).astype(np.int64)
    parent = np.repeat(np.arange(len(t)), counts)
    first = np.cumsum(counts) - counts
    fraction = (np.arange(len(parent)) - np.repeat(first, counts)) / np.repeat(counts, counts)
    after = np.minimum(parent + 1, len(t) - 1)
    return replace(
        table,
        t=t[parent] + fraction * (t[after] - t[parent]),
        u=u[parent] + fraction[:, None] * (u[after] - u[parent]),
        q_accel=table.q_accel[parent[:-1]],
        q_gyro=table.q_gyro[parent[:-1]],
        row=np.where(fraction == 0.0, table.row[parent], -1),
        starts=tuple(first[list(table.starts)].tolist()),
    )
