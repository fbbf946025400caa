"""All logs, each in a task of its own; what is finished is kept as it comes, and is not done again."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from sinan.experiments.fleet.logs import Log
from sinan.experiments.fleet.one_log import Answer, answer, failed, is_of
from sinan.experiments.report.files import write_json
from sinan.experiments.workers.cluster import cluster
from sinan.experiments.workers.processes import in_processes
from sinan.experiments.workers.stopping import going_on
from sinan.sensors.errors import InputError
from sinan.sensors.files import write_text

#: What `in_processes` names where its workers die again and again.
_DIED = "--workers"
_KILLED = "the process that traced it was killed: for want of memory, perhaps"

Done = Callable[[Log, Answer], None]


def run(
    logs: Sequence[Log],
    out: Path,
    workers: int | None = None,
    dask: str | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[dict[str, Any]]:
    """The reports of all logs, in their order: `out/reports/NAME.json`, with pages in `out/pages/NAME.html`.

    Parameters
    ----------
    workers : processes; None: one a core
    dask : address of the scheduler of a running Dask cluster, whose workers see the logs at the same paths
    progress : called with (logs done, logs in all)
    """
    found = {log: document for log in logs if (document := _kept(out, log)) is not None}
    missing = [log for log in logs if log not in found]

    def done(log: Log, result: Answer) -> None:
        if result.page:
            write_text(page_of(out, log), result.page)
        write_json(_report_of(out, log), result.document)  # last: what has a report is finished
        found[log] = result.document
        progress(len(found), len(logs))

    progress(len(found), len(logs))
    with going_on(lambda: f" after {len(found)} of {len(logs)} logs: the same command goes on"):
        if dask is not None and missing:
            _on_cluster(missing, dask, done)
        else:
            _here(missing, min(workers or os.cpu_count() or 1, len(missing)), found, done)
    return [found[log] for log in logs]


def page_of(out: Path, log: Log) -> Path:
    """Where the page of a log is."""
    return out / "pages" / f"{log.name}.html"


def _report_of(out: Path, log: Log) -> Path:
    return out / "reports" / f"{log.name}.json"


def _kept(out: Path, log: Log) -> dict[str, Any] | None:
    """The report of an earlier run, with its page; None: there is none that is whole."""
    try:
        document = json.loads(_report_of(out, log).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    whole = isinstance(document, dict) and is_of(document, log) and page_of(out, log).is_file()
    return document if whole else None


def _answer(log: Log) -> Answer:
    return answer(log, os.path.abspath(log.path))


def _here(missing: Sequence[Log], workers: int, found: dict[Log, dict[str, Any]], done: Done) -> None:
    """In processes of this machine. A log that kills the process that reads it is found by asking each alone."""
    if not missing:
        return
    try:
        in_processes(_answer, missing, workers, done)
    except InputError as error:
        if error.where != _DIED:
            raise
        for log in [log for log in missing if log not in found]:
            try:
                in_processes(_answer, [log], 1, done)
            except InputError as died:
                if died.where != _DIED:
                    raise
                done(log, failed(log, _KILLED))


def _on_cluster(missing: Sequence[Log], address: str, done: Done) -> None:
    """On a cluster; a task that kills several of its workers is given up, and the others go on."""
    with cluster(address) as client:
        from distributed import KilledWorker, as_completed

        ask = partial(client.submit, answer, pure=False)
        tasks = {ask(log, os.path.abspath(log.path)): log for log in missing}
        for task in as_completed(tasks):
            try:
                result = task.result()
            except KilledWorker:
                result = failed(tasks[task], _KILLED)
            done(tasks[task], result)
