"""Streams that stopped telling the truth without saying so: frozen and saturated stretches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray, edges_of_runs

#: False-alarm rate per stream of calling a run of equal readings frozen: a stated risk.
FROZEN_LEVEL = 1e-6
#: A saturated stretch has at least this many readings in a row at the stream's own extreme: two may be one and the same
#: peak, since samples on either side of it are equal by rounding.
SATURATED_RUN = 3


@dataclass(frozen=True)
class Note:
    """One thing that was noticed about a stream, and what was done about it."""

    stream: str
    kind: str
    start: float
    stop: float
    action: str

    def __str__(self) -> str:
        return self.told()

    def told(self, zero: float = 0.0) -> str:
        """In words; `zero` [s] is where they count from (`sensors.window.told_from`)."""
        start, stop = self.start - zero, self.stop - zero
        when = f"from {start:.3f} to {stop:.3f} s" if stop > start else f"at {start:.3f} s"
        return f"{self.stream}: {self.kind} {when}, {self.action}"


def _equal_runs(same: BoolArray, least: float) -> list[tuple[int, int]]:
    """[start, stop) of runs of more than `least` rows that equal their predecessor; `same` (n - 1,) bool."""
    runs = edges_of_runs(same)
    return [(start, stop + 1) for start, stop in runs[runs[:, 1] - runs[:, 0] > least].tolist()]


def frozen_runs(readings: FloatArray) -> list[tuple[int, int]]:
    """Rows [start, stop) in which a stream repeats one reading for longer than its own habit explains.

    A coarse converter repeats readings too: with a share r of repeats outside the run (`_unusual_runs`), a run of L
    repeats is expected r^L times a reading. It is called frozen where that is below `FROZEN_LEVEL` over the stream.

    Parameters
    ----------
    readings : (n, size)
    """
    n = len(readings)
    if n < 4:
        return []
    return _unusual_runs(np.all(readings[1:] == readings[:-1], axis=1))


def stuck_runs(readings: FloatArray) -> list[tuple[int, int]]:
    """Rows [start, stop) in which one component is frozen, as `frozen_runs` has it, while another moves as usual.

    At rest a coarse converter repeats all of them: there nothing is stuck. Nor is it where the component turns so
    slowly that it stays within one count (`_stays_within_a_count`).
    """
    n, size = readings.shape
    if n < 4 or size < 2:
        return []
    moves = np.abs(np.diff(readings, axis=0))
    usual = np.median(moves, axis=0)
    found = []
    for k in range(size):
        others = np.delete(np.arange(size), k)
        for start, stop in _unusual_runs(moves[:, k] == 0.0):
            here = np.median(moves[start : stop - 1][:, others], axis=0)
            if usual[k] > 0.0 and np.any((here >= 0.5 * usual[others]) & (usual[others] > 0.0)):
                if _stays_within_a_count(moves[:, k], start, stop):
                    continue
                found.append((start, stop))
    return sorted(found)


def _stays_within_a_count(moves: FloatArray, start: int, stop: int) -> bool:
    """Whether a run of equal readings [start, stop) ends by one count, beside readings of which half repeat too.

    A stuck converter is released by what its axis has turned meanwhile; if that is a count, it held a value that was
    right within a count. A log that ends with the run is judged by how the run begins.

    Parameters
    ----------
    moves : (n - 1,) absolute differences of the readings
    """
    half = (stop - start) // 2
    sides = [side for side in (moves[max(start - half, 0) : start], moves[stop - 1 : stop - 1 + half]) if len(side)]
    end = moves[stop - 1] if stop <= len(moves) else moves[max(start - 1, 0)]
    return bool(end < 1.5 * np.min(moves[moves > 0.0]) and min(np.median(side) for side in sides) == 0.0)


def _unusual_runs(same: BoolArray) -> list[tuple[int, int]]:
    """Rows [start, stop) of the runs of repeats longer than the habit of the stream explains; `same` (n - 1,).

    The habit is the largest share of repeats of three: of the log, and of half as many rows as the run has, before it
    and after it, since a coarse reading repeats while its axis rests or turns steadily. Beside a converter that is
    stuck the readings change as they do elsewhere. A share of few rows is drawn to that of the log by one row.
    """
    n = len(same) + 1
    runs = edges_of_runs(same)
    if not len(runs):
        return []
    longest = int(np.max(runs[:, 1] - runs[:, 0]))
    share = (np.count_nonzero(same) - longest + 1.0) / max(n - longest - 1, 1)
    found = []
    for start, stop in runs.tolist():
        half = (stop - start + 1) // 2
        sides = same[max(start - half, 0) : start], same[stop : stop + half]
        habit = max(share, *((np.count_nonzero(side) + share) / (len(side) + 1.0) for side in sides))
        # a stream that hardly ever changes has no habit to be judged by
        if habit < 0.9 and stop - start > max(np.log(FROZEN_LEVEL / n) / np.log(habit), 2.0):
            found.append((start, stop + 1))
    return found


def saturated_runs(readings: FloatArray) -> list[tuple[int, int]]:
    """Rows [start, stop) in which a component stays at the largest or smallest value that it ever reads.

    White noise meets its own maximum once; a converter at its limit meets it again and again.

    Parameters
    ----------
    readings : (n, size)
    """
    found: list[tuple[int, int]] = []
    for column in readings.T:
        pinned = (column == np.max(column)) | (column == np.min(column))
        runs = _equal_runs(pinned[1:] & pinned[:-1], SATURATED_RUN - 2)
        found += runs if runs and np.mean(column[1:] == column[:-1]) < 0.5 else []
    return sorted(found)
