"""Each half of a measured log traced by itself: what `replication` and `prediction` ask."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from sinan.experiments.blind.benchmark import kept_in
from sinan.experiments.blind.measured.benchmark import slug, traced
from sinan.experiments.blind.measured.command import named
from sinan.experiments.datasets import resolve
from sinan.experiments.measured.flights import LOGS
from sinan.experiments.measured.minutes import lively_starts
from sinan.experiments.report.files import write_json
from sinan.sensors.errors import InputError
from sinan.sensors.files import write_text
from sinan.sensors.recording import Recording
from sinan.sensors.window import between

#: The reports of both halves, the first one first.
Reports = tuple[Mapping[str, Any], Mapping[str, Any]]
#: Step of the possible starts of a part [s].
EVERY = 30.0


@dataclass(frozen=True)
class Halves:
    """A log, or its liveliest part of some length, in two halves.

    Attributes
    ----------
    log : its name
    longest : length of the part [s]; None: the whole log
    keep : folder of the reports; None: they are not kept
    """

    log: str
    longest: float | None = None
    keep: Path | None = None

    @cached_property
    def parts(self) -> tuple[Recording, Recording]:
        """Both halves, recordings of their own."""
        return halved(resolve(LOGS[self.log]), self.longest)

    def report(self, half: int) -> Mapping[str, Any]:
        """The report of the trace of half 0 or 1; one that is kept is not made again."""
        asked = {"log": self.log, "longest": self.longest, "half": half}
        path = None if self.keep is None else self.keep / f"{slug(self.log)}-{half}.json"
        found = {} if path is None else kept_in(path)
        if {key: found.get(key) for key in asked} == asked:
            report: Mapping[str, Any] = found["report"]
            return report
        report = traced(self.parts[half])
        if path is not None:
            write_json(path, {**asked, "report": report})
        return report

    @property
    def reports(self) -> Reports:
        """Of both halves."""
        return self.report(0), self.report(1)


def liveliest(recording: Recording, longest: float | None) -> tuple[float, float]:
    """Begin and end [s] of a recording, or of the part of some length in which it turns most."""
    t = recording.streams["imu"].t
    begin, end = float(t[0]), float(t[-1]) + 1e-9
    if longest is not None and longest < end - begin:
        begin = float(lively_starts(recording, longest, EVERY)[-1])
        end = begin + longest
    return begin, end


def halved(recording: Recording, longest: float | None = None) -> tuple[Recording, Recording]:
    """Both halves of a recording, or of the part of some length in which it turns most."""
    begin, end = liveliest(recording, longest)
    middle = 0.5 * (begin + end)
    return between(recording, begin, middle), between(recording, middle, end)


def parsed(arguments: Sequence[str], description: str | None) -> tuple[list[Halves], Path | None]:
    """The logs that a command names, all if it names none, and the file of its table."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "logs", nargs="*", metavar="LOG", help="name, or DATASET/FILE, of a measured flight or hand-held log"
    )
    parser.add_argument(
        "--longest", type=float, metavar="S", help="of a longer log its liveliest part of so many seconds"
    )
    parser.add_argument(
        "--keep", type=Path, metavar="DIR", help="folder of the halves' reports, which are not made again"
    )
    parser.add_argument("--table", type=Path, metavar="FILE", help="file for the page, Markdown")
    given = parser.parse_args(list(arguments))
    try:
        names = [named(log) for log in given.logs] or list(LOGS)
    except InputError as error:
        parser.error(str(error))
    return [Halves(name, given.longest, given.keep) for name in names], given.table


def logs_of(asked: Sequence[Halves]) -> str:
    """The logs that a page is about, in words."""
    longest = asked[0].longest
    part = "" if longest is None else f", of each at most its liveliest {longest:g} s"
    return f"{len(asked)} logs{part}: {'; '.join(one.log for one in asked)}."


def tell(log: str) -> None:
    """Progress, on the error output."""
    sys.stderr.write(f"{log}\n")


def written(text: str, table: Path | None) -> str:
    """The page on the terminal, and in a file where one is asked for."""
    if table is not None:
        write_text(table, text)
    print(text)
    return text
