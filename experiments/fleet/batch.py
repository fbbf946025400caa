"""All logs, each in a task of its own; what is finished is kept as it comes, and is not done again."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from sinan.experiments.fleet.logs import Log
from sinan.experiments.fleet.one_log import Answer, answer, died, is_of, late
from sinan.experiments.report.files import write_json
from sinan.experiments.workers.alone import Ended, Limits, each_alone
from sinan.experiments.workers.cluster import cluster
from sinan.experiments.workers.stopping import going_on
from sinan.sensors.files import write_text

_LOADED = f"{__package__}.warm"

Done = Callable[[Log, Answer], None]


def run(
    logs: Sequence[Log],
    out: Path,
    workers: int | None = None,
    dask: str | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
    limits: Limits | None = None,
) -> list[dict[str, Any]]:
    """The reports of all logs, in their order: `out/reports/NAME.json`, with pages in `out/pages/NAME.html`.

    Parameters
    ----------
    workers : processes; None: one a core
    dask : address of the scheduler of a running Dask cluster, whose workers see the logs at the same paths
    progress : called with (logs done, logs in all)
    limits : of each log; what was stopped by one is done again where it may take more
    """
    limits = limits or Limits()
    found = {log: document for log in logs if (document := _kept(out, log, limits)) is not None}
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
            _on_cluster(missing, dask, limits, done)
        else:
            _here(missing, workers or os.cpu_count() or 1, limits, done)
    return [found[log] for log in logs]


def page_of(out: Path, log: Log) -> Path:
    """Where the page of a log is."""
    return out / "pages" / f"{log.name}.html"


def _report_of(out: Path, log: Log) -> Path:
    return out / "reports" / f"{log.name}.json"


def _kept(out: Path, log: Log, limits: Limits) -> dict[str, Any] | None:
    """The report of an earlier run, with its page; None: there is none that is whole."""
    try:
        document = json.loads(_report_of(out, log).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(document, dict) or not is_of(document, log, limits):
        return None
    return document if document["why_not"] is not None or page_of(out, log).is_file() else None


def _here(missing: Sequence[Log], workers: int, limits: Limits, done: Done) -> None:
    """In processes of this machine."""

    def ended(log: Log, result: Answer | Ended) -> None:
        done(log, _as_answer(log, result, limits))

    each_alone(partial(_answer, limits), missing, workers, limits, ended, _LOADED)


def _answer(limits: Limits, log: Log) -> Answer:
    return answer(log, os.path.abspath(log.path), limits)


def _as_answer(log: Log, result: Answer | Ended, limits: Limits) -> Answer:
    """What is said of a log whose process has none."""
    if isinstance(result, Answer):
        return result
    return late(log, limits) if result is Ended.LATE else died(log)


def _by_itself(log: Log, path: str, limits: Limits) -> Answer:
    """In a worker of a cluster: in a process of its own, so that its end is not the worker's."""
    found: list[Answer] = []
    work = partial(answer, log, limits=limits)

    def ended(path: str, result: Answer | Ended) -> None:
        found.append(_as_answer(log, result, limits))

    each_alone(work, [path], 1, limits, ended, _LOADED)
    return found[0]


def _on_cluster(missing: Sequence[Log], address: str, limits: Limits, done: Done) -> None:
    """On a cluster; a task that kills several of its workers is given up, and the others go on."""
    with cluster(address) as client:
        from distributed import KilledWorker, as_completed

        ask = partial(client.submit, _by_itself, pure=False)
        tasks = {ask(log, os.path.abspath(log.path), limits): log for log in missing}
        for task in as_completed(tasks):
            try:
                result = task.result()
            except KilledWorker:
                result = died(tasks[task])
            done(tasks[task], result)
