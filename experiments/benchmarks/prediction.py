"""Do the effects that a trace accepts predict better?

    python -m sinan.experiments.benchmarks.prediction [LOG ...] [--longest S] [--keep DIR] [--table FILE]

A smaller one-step residual proves nothing where the residual is coloured; prediction over seconds does. The lasting
effects are those of the first half of a log, with the parameters that they have there. In the second half, a log of
its own with its own levels, fixes are withheld for 2, 5 and 10 s, compass and barometer are not; where there is no GPS,
one stream at a time. Three runs move the windows so that every reading is withheld in one. The model with the effects
against the one without, else the same: distance of the withheld readings from the predicted ones, and their log
density, with intervals of 95 % from a bootstrap of whole windows.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from types import MappingProxyType
from typing import Any

import numpy as np

from sinan.calibration.levels.preparation import Prepared, prepared
from sinan.estimator.evidence.flights.withheld import Predicted, Window, predicted
from sinan.estimator.filter.flight_model import aiding
from sinan.experiments.benchmarks.halves import Halves, logs_of, parsed, tell, written
from sinan.experiments.benchmarks.replication import lasting
from sinan.experiments.blind.measured.benchmark import FAILURES, words
from sinan.experiments.measured.flights import FIRST
from sinan.experiments.report.words import number
from sinan.sensors.arrays import FloatArray, IntArray
from sinan.sensors.registry import is_sensor, sensor

#: Readings are withheld for so long [s], once in three times that.
LENGTHS, PERIOD = (2.0, 5.0, 10.0), 3
#: Ages of the last reading that was given, from one to the next [s].
AGES = (0.0, 1.0, 2.0, 5.0, 10.0)
#: The length by which a log is judged [s].
JUDGED = 5.0


def withheld_streams() -> tuple[str, ...]:
    """Streams that may be withheld, in the order in which they stand for all."""
    return tuple(name for name in aiding() if is_sensor(name) and sensor(name).bias)


DRAWS, LEVEL = 2000, 0.95
HEAD = f"""# Prediction of withheld readings

Written by `python -m sinan.experiments.benchmarks.prediction`. Lasting effects that the trace of a log's first half
accepts, held fixed on the second half, where readings of one stream are withheld; all else, levels of noise too, is
the same before and after, but that a lateness is that of the effects alone. RMS distance of withheld from predicted
readings (of GPS in m), before and after; ratio of both, and log density of a reading after less before, each with its
interval of 95 % (bootstrap of windows).
**worse**: an interval of {JUDGED:g} s that lies wholly on the wrong side.
"""


@dataclass(frozen=True)
class Interval:
    """An estimate and its interval of 95 %."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.value:.3g} [{self.low:.3g}, {self.high:.3g}]"


@dataclass(frozen=True)
class Errors:
    """Withheld readings against their predictions, without and with effects.

    Attributes
    ----------
    readings, windows : how many were predicted, in how many windows
    before, after : RMS distance
    ratio : of after to before
    density : mean log density of a reading, after less before
    """

    readings: int
    windows: int
    before: float
    after: float
    ratio: Interval
    density: Interval


@dataclass(frozen=True)
class Comparison:
    """Predictions of one stream withheld for one length, without and with effects.

    Attributes
    ----------
    log, stream : whose readings are withheld
    length : for how long [s]
    effects : names that the first half has accepted
    errors : of all withheld readings
    by_age : by place in `AGES`, of those whose last reading is so old
    """

    log: str
    stream: str
    length: float
    effects: tuple[str, ...]
    errors: Errors
    by_age: Mapping[int, Errors]

    @property
    def worse(self) -> tuple[str, ...]:
        """By which measure the effects make prediction worse, beyond its interval."""
        found = {"distance": self.errors.ratio.low > 1.0, "density": self.errors.density.high < 0.0}
        return tuple(name for name, holds in found.items() if holds)


def asked_streams(ready: Prepared) -> tuple[str, ...]:
    """GPS where there is one; else every stream in turn."""
    there = tuple(name for name in withheld_streams() if name in ready.model.sensors)
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
    found = [predicted(ready.flight, stream, windows, betas) for windows in runs]
    if not found:
        return Predicted(np.empty(0), np.empty(0), np.empty((0, 1)), np.empty(0)), np.empty(0, dtype=np.int64)
    parts = ([getattr(one, name) for one in found] for name in ("t", "age", "nu", "log_density"))
    whole = Predicted(*(np.concatenate(part) for part in parts))
    return whole, np.floor((whole.t - t[0] - FIRST) / length + 1e-9).astype(np.int64)


def compare(
    log: str, ready: Prepared, stream: str, length: float, betas: Mapping[str, FloatArray], rng: np.random.Generator
) -> Comparison | None:
    """Predictions of a stream without effects, each being zero in the model, and with them; None where there is nothing
    to predict.
    """
    plain, window = withheld_in_turn(ready, stream, length, {name: np.zeros_like(b) for name, b in betas.items()})
    after, _ = withheld_in_turn(ready, stream, length, betas)
    _, rows, same = np.intersect1d(plain.t, after.t, return_indices=True)  # a lateness moves some beyond the IMU's time
    if not len(rows):
        return None
    plain, after, block = plain.rows(rows), after.rows(same), window[rows]
    gain = after.log_density - plain.log_density
    columns = np.stack([plain.distance**2, after.distance**2, gain, np.ones(len(rows))], axis=-1)
    inside = [(plain.age > low) & (plain.age <= high) for low, high in pairwise(AGES)]
    by_age = {k: errors_of(columns[now], block[now], rng) for k, now in enumerate(inside) if np.any(now)}
    return Comparison(log, stream, length, tuple(betas), errors_of(columns, block, rng), by_age)


def errors_of(columns: FloatArray, block: IntArray, rng: np.random.Generator) -> Errors:
    """Errors of readings.

    Parameters
    ----------
    columns : (k, 4) squared distance before and after, gain of log density, one
    block : (k,) window of each
    """
    block = np.unique(block, return_inverse=True)[1]
    sums = np.stack([np.bincount(block, column) for column in columns.T], axis=-1).astype(np.float64)
    before, after = np.sqrt(columns[:, :2].mean(axis=0)).tolist()
    ratio = interval_of(sums, lambda s: np.sqrt(s[..., 1] / s[..., 0]), rng)
    return Errors(
        len(columns), len(sums), before, after, ratio, interval_of(sums, lambda s: s[..., 2] / s[..., 3], rng)
    )


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


def of_log(halves: Halves, rng: np.random.Generator) -> list[Comparison]:
    """Every stream and length; nothing where the first half has no lasting effect."""
    betas = betas_of(halves.report(0))
    if not betas:
        return []
    ready = prepared(halves.parts[1], late=False)  # a lateness is that of the effects, once
    asked = product(asked_streams(ready), LENGTHS)
    found = [compare(halves.log, ready, stream, length, betas, rng) for stream, length in asked]
    return [one for one in found if one is not None]


def page(rows: Sequence[Comparison], asked: Sequence[Halves], failed: Mapping[str, str] = MappingProxyType({})) -> str:
    """The table, and how many logs are worse; `failed` says of some why they could not be run."""
    judged = [row for row in rows if row.length == JUDGED]
    of = {row.log for row in judged}
    without = "; ".join(one.log for one in asked if one.log not in {*of, *failed}) or "none"
    lines = [HEAD, f"{logs_of(asked)} Without lasting effects in their first half: {without}.", ""]
    for measure in ("distance", "density"):
        worse = sorted({row.log for row in judged if measure in row.worse})
        lines.append(f"- worse by {measure}: {len(worse)} of {len(of)} logs" + f" ({'; '.join(worse)})" * bool(worse))
    lines += [f"- could not be run: {log}: {why}" for log, why in failed.items()]
    lines += ["", "| log, effects | withheld | readings | before | after | ratio | log density |", "| --- " * 7 + "|"]
    lines += [_row(f"{row.log}: {', '.join(row.effects)}", row, row.errors) for row in rows]
    lines += ["", "The same by age of the last reading that was given.", ""]
    lines += ["| log, age | withheld | readings | before | after | ratio | log density |", "| --- " * 7 + "|"]
    for row in rows:
        ages = {k: f"{row.log}, {low:g} to {high:g} s" for k, (low, high) in enumerate(pairwise(AGES))}
        lines += [_row(ages[k], row, errors) for k, errors in row.by_age.items()]
    return "\n".join([*lines, ""])


def _row(head: str, row: Comparison, errors: Errors) -> str:
    asked = f"{row.stream}, {row.length:g} s", f"{errors.readings} in {errors.windows} windows"
    sizes = number(errors.before), number(errors.after), str(errors.ratio), str(errors.density)
    return "| " + " | ".join([head, *asked, *sizes]) + " |"


def main(arguments: Sequence[str], seed: int = 0) -> str:
    """Trace the first halves, predict in the second, print; write the page where asked to."""
    asked, table = parsed(arguments, __doc__)
    rng, rows, failed = np.random.default_rng(seed), list[Comparison](), dict[str, str]()
    for halves in asked:
        tell(halves.log)
        try:
            rows += of_log(halves, rng)
        except FAILURES as error:  # a filter that is lost with the effects is part of what is asked
            failed[halves.log] = words(error)
    return written(page(rows, asked, failed), table)


if __name__ == "__main__":
    main(sys.argv[1:])
