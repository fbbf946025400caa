"""Minutes of measured logs with effects in them, traced; what is done already is not done again."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sinan.experiments.blind.benchmark import kept_in, refused
from sinan.experiments.blind.examine import examined
from sinan.experiments.blind.grade import REFUSED
from sinan.experiments.blind.maker.catalogue import Hidden
from sinan.experiments.blind.measured.draw import PUT, draw, sized
from sinan.experiments.blind.measured.grade import grade
from sinan.experiments.blind.measured.knowing import gain, told
from sinan.experiments.blind.measured.minute import Minute, minute_of, put, rng_of
from sinan.experiments.datasets import resolve
from sinan.experiments.measured.flights import LOGS
from sinan.experiments.report.files import write_json
from sinan.experiments.workers.processes import in_processes
from sinan.experiments.workers.stopping import going_on
from sinan.sensors.errors import InputError
from sinan.sensors.recording import Recording

CONTROLS, RUNS = "controls", "runs"
#: What a tracer may say instead of a report.
FAILURES = (InputError, ArithmeticError, ValueError, np.linalg.LinAlgError)
Document = Mapping[str, Any]


def run(
    out: Path,
    logs: Sequence[str],
    runs: int,
    seed: int,
    workers: int = 1,
    tell: Callable[[str, int, int], None] | None = None,
) -> None:
    """Reports of controls and of minutes with an effect into `out`, one JSON each, written as they come.

    Draw k is of log k modulo their number: the logs come in turn. A log's minute goes with the seed.

    Parameters
    ----------
    logs : keys of `flights.LOGS`
    runs, seed : number of effects that are put in, and the seed that draws them
    workers : processes; each takes whole logs
    tell : progress: (what, done, of how many)
    """
    for part in (CONTROLS, RUNS):
        (out / part).mkdir(parents=True, exist_ok=True)
    jobs = {name: range(k, runs, len(logs)) for k, name in enumerate(logs[:runs])}
    done = 0

    def finished(count: int) -> None:
        nonlocal done
        done += count
        if tell:
            tell("traced", done, runs)

    with going_on(lambda: f" after {done} of {runs} minutes: the same command goes on"):
        if workers == 1:
            for name, numbers in jobs.items():
                of_log(out, seed, name, numbers, partial(finished, 1))
        else:
            of_one = partial(_of_one, out, seed)
            in_processes(of_one, list(jobs.items()), workers, lambda job, _: finished(len(job[1])))


def _of_one(out: Path, seed: int, job: tuple[str, Sequence[int]]) -> None:
    of_log(out, seed, *job)


def of_log(out: Path, seed: int, name: str, numbers: Sequence[int], finished: Callable[[], None] | None = None) -> None:
    """The control of one log and its draws; the log is not even read where all of it is there."""
    paths = {number: out / RUNS / f"{seed}-{number:05d}.json" for number in numbers}
    left = [number for number in numbers if kept_in(paths[number]).get("log") != name]
    minute = opened(name, seed) if left else ""
    for number in numbers:
        if number in left:
            entry = {"log": name, "seed": seed, "run": number, "status": REFUSED, "why": minute}
            if isinstance(minute, Minute):
                entry |= one(seed, number, minute, control_of(out, seed, name, minute))
            write_json(paths[number], entry)
        if finished:
            finished()


def opened(name: str, seed: int) -> Minute | str:
    """The minute of a log, or why there is none."""
    try:
        return minute_of(resolve(LOGS[name]), rng_of(seed, name))
    except FAILURES as error:
        return words(error)


def control_of(out: Path, seed: int, name: str, minute: Minute) -> Document:
    """The trace of a log's untouched minute: of its kept JSON, else made now and kept."""
    path = out / CONTROLS / f"{seed}-{slug(name)}.json"
    found = kept_in(path)
    if found.get("log") != name:
        times = {"begin": minute.begin, "end": minute.end}
        found = {"log": name, "seed": seed, **times, "drawn": list(minute.drawn), "report": traced(minute.control)}
        write_json(path, found)
    report: Document = found["report"]
    return report


def one(seed: int, number: int, minute: Minute, control: Document) -> dict[str, Any]:
    """One draw: put in, traced; where it cannot be put in, why not."""
    order = draw(seed, number, minute)
    hidden, status = sized(order, minute, control)
    entry: dict[str, Any] = {"name": order.name, "size": order.size, "lasting": order.is_lasting,
                             "status": status, "why": ""}  # fmt: skip
    if hidden is None:
        return entry
    document = traced(put(minute, hidden, np.random.default_rng([seed, number, 1])))
    answer = {"beta": hidden.beta.tolist(), "interval": None if hidden.interval is None else list(hidden.interval)}
    known = {"gain": gain(minute, hidden), "told": told(minute, hidden)}
    return {**entry, **answer, **known, "report": document}


def traced(recording: Recording) -> dict[str, Any]:
    """The report of a trace; one that cannot be made has explained nothing, and says why."""
    try:
        document = examined(recording)
        json.dumps(document, allow_nan=False)  # a number that is none is a failure too
        return document
    except FAILURES as error:
        return {**refused(words(error)), "error": None}


def words(error: Exception) -> str:
    """What went wrong."""
    return f"{type(error).__name__}: {error}"


def slug(name: str) -> str:
    """A log's name as a file's."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def collected(out: Path) -> tuple[list[Document], list[Document]]:
    """The controls and the draws that a folder holds, in order; those that were put in with their grade."""
    controls, runs = (found_in(out / part) for part in (CONTROLS, RUNS))
    of_minute = {(control["seed"], control["log"]): control for control in controls}
    return controls, [{**r, **graded(r, of_minute.get((r["seed"], r["log"]), {}))} for r in runs]


def found_in(folder: Path) -> list[Document]:
    """The JSON of a folder, in order, of what was written to its end."""
    return [found for found in map(kept_in, sorted(folder.glob("*.json"))) if found]


def graded(run: Document, control: Document) -> dict[str, Any]:
    """The grade of a draw that was put in, from what the reports say; of any other nothing."""
    if run["status"] != PUT:
        return {}
    interval = None if run["interval"] is None else (run["interval"][0], run["interval"][1])
    seconds = run["report"]["cpu_seconds"] * 60.0 / (control["end"] - control["begin"])
    hidden = Hidden(run["name"], np.array(run["beta"]), interval)
    return {"grade": asdict(grade(hidden, run["report"], control["report"], seconds))}
