"""The benchmark: make recordings, trace each without its answer, then open the answers and count."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, fields
from functools import partial
from pathlib import Path
from typing import Any

from sinan.experiments.blind.examine import examine, index_of
from sinan.experiments.blind.grade import REFUSED, Grade, grade
from sinan.experiments.blind.maker.make import ANSWER_FILE, answers_folder, make
from sinan.experiments.workers.processes import in_processes
from sinan.experiments.workers.stopping import going_on
from sinan.sensors.errors import InputError
from sinan.sensors.files import write_text

REPORTS = "reports"


def run(
    out: Path,
    runs: int,
    seed: int,
    world: str = "mixed",
    classes: Sequence[str] | None = None,
    kinds: Sequence[str] | None = None,
    workers: int = 1,
    tell: Callable[[str, int, int], None] | None = None,
) -> list[Grade]:
    """Recordings into `out`/recordings, sealed answers beside them, reports and grades into `out`/reports.

    A recording whose grade is there already is not traced again: a run that was stopped goes on. A grade of another
    recording of that name, of another seed, is not taken for it.

    Parameters
    ----------
    runs, seed : number of recordings, and the seed that draws them
    world : "declared", "rough" or "mixed"
    classes, kinds : see `maker.make`
    workers : processes; the result does not depend on it
    tell : progress: (what, done, of how many)
    """
    recordings = out / "recordings"
    found: dict[str, Grade] = {}

    def done(name: str, grade: Grade) -> None:
        found[name] = grade
        if tell:
            tell("traced", len(found), runs)

    with going_on(lambda: f" after {len(found)} of {runs} recordings: the same command goes on"):
        make(recordings, seed, runs, kinds, world, classes)
        names = sorted(index_of(recordings))[:runs]
        if workers == 1:
            for name in names:
                done(name, one(out, name))
        else:
            in_processes(partial(one, out), names, workers, done)
    return [found[name] for name in names]


def one(out: Path, name: str) -> Grade:
    """Trace one recording and grade the report; what is there already is read."""
    recordings, path = out / "recordings", out / REPORTS / f"{name}.json"
    answer = hashlib.sha256((answers_folder(recordings) / name / ANSWER_FILE).read_bytes()).hexdigest()
    kept = kept_in(path)
    if kept.get("answer") == answer:
        return graded(kept["grade"])
    try:
        document = examine(recordings / name, index_of(recordings)[name])
    except InputError as error:  # a recording that the tracer refuses is one that it has not explained
        document = refused(str(error))
    result = grade(recordings, name, document)
    kept = {"answer": answer, "report": document, "grade": asdict(result)}
    write_text(path, json.dumps(kept, indent=1))
    return result


def kept_in(path: Path) -> dict[str, Any]:
    """What an earlier run has left in a file; nothing where it was stopped while it wrote."""
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return {}
    return kept if isinstance(kept, dict) else {}


def refused(why: str) -> dict[str, Any]:
    """The report of a recording that could not be read."""
    return {"verdict": REFUSED, "why": why, "effects": [], "remaining": [], "cpu_seconds": 0.0,
            "error": {"stream": "", "after": {"rms": float("nan")}}}  # fmt: skip


def graded(row: dict[str, Any]) -> Grade:
    """A grade from its JSON."""
    values: dict[str, Any] = {}
    for name in (field.name for field in fields(Grade)):
        values[name] = tuple(row[name]) if isinstance(row[name], list) else row[name]
    return Grade(**values)
