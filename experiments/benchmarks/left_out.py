"""Attitude of logs after a trace of others of the same instrument: do the effects that those name hold here too?

    python -m sinan.experiments.benchmarks.left_out [--folds N] [--longest S] [--table FILE] [NAME ...]

The logs (default: all of BROAD, one board) are dealt into folds. The logs outside a fold are traced together, the
liveliest S seconds of each; the lasting effects that predict there are declared in every log of the fold, whose
attitude is then scored against its cameras, before and after, beside VQF. No log has a part in what is declared in it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from sinan.estimator.evidence.flights.source import FlightSource
from sinan.experiments.benchmarks.attitude import (
    FILTER,
    SMOOTHER,
    TRUTHS,
    VQF,
    VQF_OFFLINE,
    Score,
    ours,
    ratios,
    score,
    target_of,
    vqf,
)
from sinan.experiments.benchmarks.halves import liveliest
from sinan.experiments.datasets import resolve
from sinan.experiments.measured.arguments import usage
from sinan.experiments.measured.logs import FLIGHTS
from sinan.experiments.report.words import number
from sinan.experiments.residual_loop.run import trace_recording
from sinan.sensors.files import write_text
from sinan.sensors.joining import joined
from sinan.sensors.recording import Recording
from sinan.sensors.window import between

HEAD = """# Attitude after a trace of other logs of the same instrument

Written by `python -m sinan.experiments.benchmarks.left_out`. RMS of the whole log in degrees (heading, tilt) against
the cameras, as in [attitude](attitude_benchmark.md). "After": with the lasting effects declared that the logs outside
the fold, traced together, name and that predict there.
"""
FILTER_AFTER, SMOOTHER_AFTER = "filter, after", "smoother, after"
COLUMNS = (VQF, VQF_OFFLINE, FILTER, FILTER_AFTER, SMOOTHER, SMOOTHER_AFTER)

Effects = Mapping[str, tuple[float, ...]]


@dataclass(frozen=True)
class Shared:
    """What logs of one instrument share.

    Attributes
    ----------
    effects : lasting effects that a trace of them together names and that predict, with their sizes
    averaged : whether samples of the IMU are means over their step in the model about which those were found: a
        lateness counts from their instants
    """

    effects: Effects
    averaged: bool

    @classmethod
    def of(cls, recordings: Sequence[Recording]) -> Shared:
        """Of logs, traced together."""
        traced = trace_recording(joined(recordings))
        source, found = traced.parts[0].source, traced.verdict.reported
        assert isinstance(source, FlightSource)
        effects = {f.term.name: tuple(f.beta.tolist()) for f in found if f.term.interval is None and f.term.in_mean}
        return cls(effects, source.model.averaged)

    def declared_in(self, recording: Recording) -> Recording:
        """A recording that declares it."""
        accel = recording.spec("accel")
        accel = replace(accel, imu_samples="average") if self.averaged else accel
        effects = {**recording.effects, **self.effects}
        return recording.replace(effects=effects, sensors={**recording.sensors, "accel": accel})


def compare(name: str, shared: Shared) -> dict[str, Score]:
    """Every estimator on one log, by its name; after: with what other logs share declared."""
    recording = resolve(FLIGHTS[name].input)
    target = target_of(name, recording)
    scores = {label: score(t, q, target) for label, (t, q) in {**vqf(recording), **ours(recording)}.items()}
    after = ours(shared.declared_in(recording))
    for before, label in ((FILTER, FILTER_AFTER), (SMOOTHER, SMOOTHER_AFTER)):
        scores[label] = score(*after[before], target)
    return scores


def folds_of(names: Sequence[str], folds: int) -> list[list[str]]:
    """The names dealt out, one after the other."""
    return [list(names[k::folds]) for k in range(folds)]


def text_of(scores: Mapping[str, Mapping[str, Score]], found: Sequence[tuple[Sequence[str], Shared]]) -> str:
    """The page."""
    lines = [HEAD]
    for fold, shared in found:
        sizes = "; ".join(f"{name} {', '.join(map(number, beta))}" for name, beta in shared.effects.items()) or "none"
        samples = "; samples are means over their step" if shared.averaged else ""
        lines.append(f"- Declared in {', '.join(fold)}: {sizes}{samples}.")
    lines += ["", "| log | " + " | ".join(COLUMNS) + " |", "| --- " * (len(COLUMNS) + 1) + "|"]
    for name, row in scores.items():
        cells = (f"{row[c].total:.2f} ({row[c].heading:.2f}, {row[c].tilt:.2f})" for c in COLUMNS)
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    lines += ["", "| | mean of the ratios | ratio of the means | worst |", "| --- | --- | --- | --- |"]
    for mine, other in (
        (FILTER, VQF), (FILTER_AFTER, VQF), (SMOOTHER, VQF_OFFLINE), (SMOOTHER_AFTER, VQF_OFFLINE),
    ):  # fmt: skip
        of_means, worst, log = ratios(scores, mine, other)
        mean = sum(row[mine].total / row[other].total for row in scores.values()) / len(scores)
        lines.append(f"| {mine} over {other} | {mean:.2f} | {of_means:.2f} | {worst:.2f} ({log}) |")
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str]) -> int:
    """Print the page, and write it where that is asked for; status 2 where a name is none."""
    parser = argparse.ArgumentParser(prog="python -m sinan.experiments.benchmarks.left_out")
    parser.add_argument("--folds", type=int, default=2, help="parts that the logs are dealt into")
    parser.add_argument("--longest", type=float, default=60.0, help="seconds of each log that are traced")
    parser.add_argument("--table", type=Path, help="file for the page")
    parser.add_argument("names", nargs="*")
    given = parser.parse_args(arguments)
    names = given.names or [name for name in TRUTHS if name.startswith("BROAD")]
    if not set(names) <= set(TRUTHS) or not 2 <= given.folds <= len(names):
        return usage(TRUTHS, "[--folds N] [--longest S] [--table FILE] ")
    scores: dict[str, dict[str, Score]] = {}
    found: list[tuple[Sequence[str], Shared]] = []
    for fold in folds_of(names, given.folds):
        others = [resolve(FLIGHTS[name].input) for name in names if name not in fold]
        shared = Shared.of([between(one, *liveliest(one, given.longest)) for one in others])
        sys.stderr.write(f"{', '.join(fold)}: {shared}\n")
        found.append((fold, shared))
        scores |= {name: compare(name, shared) for name in fold}
    text = text_of({name: scores[name] for name in names}, found)
    print(text)
    if given.table is not None:
        write_text(given.table, text)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
