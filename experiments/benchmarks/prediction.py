"""Do the effects that a trace accepts predict better?

    python -m experiments.benchmarks.prediction [LOG ...] [--longest S] [--keep DIR] [--table FILE]

A smaller one-step residual proves nothing where the residual is coloured; prediction over seconds does. The lasting
effects are those of the first half of a log, with the parameters that they have there. In the second half, a log of
its own with its own levels, fixes are withheld for 2, 5 and 10 s, compass and barometer are not; where there is no GPS,
one stream at a time. Three runs move the windows so that every reading is withheld in one. The model with the effects
against the one without, else the same: distance of the withheld readings from the predicted ones, and their log
density, with intervals of 95 % from a bootstrap of whole windows.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from experiments.benchmarks.halves import Halves, parsed, tell, told
from experiments.benchmarks.replication import lasting
from experiments.measured.flights import FIRST
from experiments.measured.preparation import Prepared, prepared
from experiments.measured.withheld import Predicted, Window, predicted
from experiments.report.words import number
from sensors.arrays import FloatArray, IntArray

#: Readings are withheld for so long [s], once in three times that.
LENGTHS, PERIOD = (2.0, 5.0, 10.0), 3
#: Ages of the last reading that was given, from one to the next [s].
AGES = (0.0, 1.0, 2.0, 5.0, 10.0)
#: The length by which a log is judged [s].
JUDGED = 5.0
#: Streams that may be withheld; the first that is there stands for all where it is `gps`.
STREAMS = ("gps", "mag", "baro", "sonar", "laser")
DRAWS, LEVEL = 2000, 0.95
HEAD = f"""# Prediction of withheld readings

Written by `python -m experiments.benchmarks.prediction`. Lasting effects that the trace of a log's first half accepts,
held fixed on the second half, where readings of one stream are withheld; all else, levels of noise too, is the same
before and after. RMS distance of withheld from predicted readings (of GPS in m), before and after; ratio of both, and
log density of a reading after less before, each with its interval of 95 % (bootstrap of windows).
**worse**: an interval of {JUDGED:g} s that lies wholly on the wrong side.
"""


#: from [s], to [s], RMS before, RMS after, log density after less before
Age = tuple[float, float, float, float, float]


@dataclass(frozen=True)
class Interval:
    """An estimate and its interval of 95 %."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Comparison:
    """Predictions of one stream withheld for one length, without and with effects.

    Attributes
    ----------
    log, stream : whose readings are withheld
    length : for how long [s]
    effects : names that the first half has accepted
    readings, windows : how many were predicted, in how many windows
    before, after : RMS distance
    ratio : of after to before
    density : mean log density of a reading, after less before
    by_age : for each age that occurs
    """

    log: str
    stream: str
    length: float
    effects: tuple[str, ...]
    readings: int
    windows: int
    before: float
    after: float
    ratio: Interval
    density: Interval
    by_age: tuple[Age, ...]

    @property
    def worse(self) -> tuple[str, ...]:
        """By which measure the effects make prediction worse, beyond its interval."""
        found = {"distance": self.ratio.low > 1.0, "density": self.density.high < 0.0}
        return tuple(name for name, holds in found.items() if holds)


def asked_streams(ready: Prepared) -> tuple[str, ...]:
    """GPS where there is one; else every stream in turn."""
    there = tuple(name for name in STREAMS if name in ready.model.sensors)
    return ("gps",) if "gps" in there else there


def tiled(begin: float, end: float, length: float) -> list[list[Window]]:
    """Windows [s] of three runs that together withhold everything from `begin` to `end` once."""
    starts = np.arange(begin, end - length + 1e-9, length)
    return [[(float(t), float(t) + length) for t in starts[phase::PERIOD]] for phase in range(PERIOD)]


def withheld_in_turn(
    ready: Prepared, stream: str, length: float, betas: Mapping[str, FloatArray]
) -> tuple[Predicted, IntArray]:
    """What is predicted of every reading of a stream from `FIRST` seconds on, and the window of each."""
    t = ready.recording.streams["imu"].t
    runs = [w for w in tiled(t[0] + FIRST, t[-1], length) if w]
    found = [predicted(ready.recording, ready.model, stream, windows, betas) for windows in runs]
    if not found:
        return Predicted(np.empty(0), np.empty(0), np.empty((0, 1)), np.empty(0)), np.empty(0, dtype=np.int64)
    parts = ([getattr(one, name) for one in found] for name in ("t", "age", "nu", "log_density"))
    whole = Predicted(*(np.concatenate(part) for part in parts))
    return whole, np.floor((whole.t - t[0] - FIRST) / length + 1e-9).astype(np.int64)


def compare(
    log: str, ready: Prepared, stream: str, length: float, betas: Mapping[str, FloatArray], rng: np.random.Generator
) -> Comparison | None:
    """Predictions of a stream without effects and with them; None where there is nothing to predict."""
    plain, window = withheld_in_turn(ready, stream, length, {})
    after, _ = withheld_in_turn(ready, stream, length, betas)
    _, rows, same = np.intersect1d(plain.t, after.t, return_indices=True)  # a lateness moves some beyond the IMU's time
    if not len(rows):
        return None
    plain, after, block = plain.rows(rows), after.rows(same), np.unique(window[rows], return_inverse=True)[1]
    gain = after.log_density - plain.log_density
    columns = np.stack([plain.distance**2, after.distance**2, gain, np.ones(len(rows))], axis=-1)
    sums = np.stack([np.bincount(block, column) for column in columns.T], axis=-1).astype(np.float64)
    ratio = interval_of(sums, lambda s: np.sqrt(s[..., 1] / s[..., 0]), rng)
    density = interval_of(sums, lambda s: s[..., 2] / s[..., 3], rng)
    before_rms, after_rms = np.sqrt(columns[:, :2].mean(axis=0)).tolist()
    by_age = [_of_age(plain.age, columns, low, high) for low, high in pairwise(AGES)]
    return Comparison(
        log, stream, length, tuple(betas), len(rows), len(sums), before_rms, after_rms, ratio, density,
        tuple(part for part in by_age if part is not None),
    )  # fmt: skip


def _of_age(age: FloatArray, columns: FloatArray, low: float, high: float) -> Age | None:
    """Of the readings whose age is in a range; None where there are none."""
    inside = (age > low) & (age <= high)
    if not np.any(inside):
        return None
    mean = columns[inside].mean(axis=0)
    return low, high, float(np.sqrt(mean[0])), float(np.sqrt(mean[1])), float(mean[2])


def interval_of(sums: FloatArray, statistic: Callable[[FloatArray], FloatArray], rng: np.random.Generator) -> Interval:
    """A statistic of sums over windows (w, k), with its interval from resampled windows.

    Source: H. R. Kunsch, Ann. Statist. 17 (1989) 1217; blocks side by side.
    """
    draws = rng.integers(0, len(sums), (DRAWS, len(sums)))
    low, high = np.quantile(statistic(sums[draws].sum(axis=1)), [0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL])
    return Interval(float(statistic(sums.sum(axis=0))), float(low), float(high))


def betas_of(report: Mapping[str, Any]) -> dict[str, FloatArray]:
    """The lasting effects of a report with their parameters."""
    return {name: one[2] for name, one in lasting(report).items()}


def of_log(halves: Halves, rng: np.random.Generator) -> Iterator[Comparison]:
    """Every stream and length; nothing where the first half has no lasting effect."""
    betas = betas_of(halves.report(0))
    if not betas:
        return
    ready = prepared(halves.parts[1])
    for stream in asked_streams(ready):
        for length in LENGTHS:
            found = compare(halves.log, ready, stream, length, betas, rng)
            if found is not None:
                yield found


def page(rows: Sequence[Comparison], logs: Sequence[str]) -> str:
    """The table, and how many logs are worse."""
    judged = [row for row in rows if row.length == JUDGED]
    of = {row.log for row in judged}
    without = ", ".join(log for log in logs if log not in of) or "none"
    lines = [HEAD, f"{len(logs)} logs asked; without lasting effects in their first half: {without}.", ""]
    for measure in ("distance", "density"):
        worse = sorted({row.log for row in judged if measure in row.worse})
        lines.append(f"- worse by {measure}: {len(worse)} of {len(of)} logs" + f" ({', '.join(worse)})" * bool(worse))
    lines += ["", "| log, effects | withheld | readings | before | after | ratio | log density |", "| --- " * 7 + "|"]
    lines += [_row(row) for row in rows]
    heads = ["log", "withheld", *(f"{low:g} to {high:g} s" for low, high in pairwise(AGES))]
    lines += ["", "By age of the last reading: RMS before and after, log density after less before.", ""]
    lines += ["| " + " | ".join(heads) + " |", "| --- " * len(heads) + "|"]
    return "\n".join([*lines, *(_age_row(row) for row in rows), ""])


def _row(row: Comparison) -> str:
    ratio, density = (f"{x.value:.3g} [{x.low:.3g}, {x.high:.3g}]" for x in (row.ratio, row.density))
    asked = f"{row.stream}, {row.length:g} s", f"{row.readings} in {row.windows} windows"
    cells = [f"{row.log}: {', '.join(row.effects)}", *asked, number(row.before), number(row.after), ratio, density]
    return "| " + " | ".join(cells) + " |"


def _age_row(row: Comparison) -> str:
    cells = {low: f"{number(before)}, {number(after)}, {gain:+.2g}" for low, _, before, after, gain in row.by_age}
    of_ages = [cells.get(low, "-") for low in AGES[:-1]]
    return "| " + " | ".join([row.log, f"{row.stream}, {row.length:g} s", *of_ages]) + " |"


def main(arguments: Sequence[str], seed: int = 0) -> str:
    """Trace the first halves, predict in the second, print; write the page where asked to."""
    asked, table = parsed(arguments, __doc__)
    rng, rows = np.random.default_rng(seed), list[Comparison]()
    for halves in asked:
        tell(halves.log)
        rows += of_log(halves, rng)
    return told(page(rows, [halves.log for halves in asked]), table)


if __name__ == "__main__":
    main(sys.argv[1:])
