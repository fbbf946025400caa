"""One log of many: traced, with its page, or why it cannot be."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from sinan.experiments.fleet.logs import Log
from sinan.experiments.report.made import sinan_version
from sinan.experiments.workers.alone import Limits, end_memory_limit

FORMAT = 1


@dataclass(frozen=True)
class Answer:
    """What came of a log: plain data, which a worker can send.

    Attributes
    ----------
    document : the report of `sinan trace` with `log`, `sha256` and `vehicle`; or with `why_not`, and
        `stopped_by` where that is a limit
    page : HTML; empty: there is none
    """

    document: dict[str, Any]
    page: str = ""


def answer(log: Log, path: str, limits: Limits, tell: Callable[[str], None] = lambda what: None) -> Answer:
    """Trace a log. Whatever goes wrong is in the answer: no log stops the others.

    Parameters
    ----------
    path : where it is, for a worker that runs in another folder
    limits : under which this process runs
    tell : told what is being done
    """
    try:
        return _traced(log, path, tell)
    except Exception as error:  # of whatever a damaged log makes of a reader
        end_memory_limit()
        if _for_want_of_memory(error):
            most = limits.memory // 2**20
            return failed(log, f"it needs more than {most} MB of memory, the most that a log may take (--memory)",
                          {"limit": "memory", "most": limits.memory})  # fmt: skip
        kind = "" if type(error).__module__.startswith("sinan.sensors.") else f"{type(error).__name__}: "
        return failed(log, f"{kind}{error}")


def failed(log: Log, why: str, stopped_by: Mapping[str, Any] | None = None) -> Answer:
    """The answer where there is no report, by a limit or otherwise."""
    return Answer({**_said(log), "why_not": why, "stopped_by": stopped_by})


def late(log: Log, limits: Limits) -> Answer:
    """The answer of a log that took too long."""
    return failed(log, f"stopped after {limits.seconds:.0f} s, the longest that a log may take (--time)",
                  {"limit": "time", "most": limits.seconds})  # fmt: skip


def died(log: Log) -> Answer:
    """The answer of a log whose process died."""
    return failed(log, "the process that traced it was killed: for want of memory, perhaps")


def _for_want_of_memory(error: BaseException | None) -> bool:
    """Whether an error is, or came of, one of memory: a reader may have made another of it."""
    while error is not None and not isinstance(error, MemoryError):
        error = error.__cause__ or error.__context__
    return error is not None


def _said(log: Log) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "sinan": sinan_version(),
        "log": log.path,
        "sha256": log.digest,
        "vehicle": Path(log.path).absolute().parent.name,
    }


def _traced(log: Log, path: str, tell: Callable[[str], None]) -> Answer:
    from sinan.experiments.answers.asked import Asked
    from sinan.experiments.answers.traces import tell_in_its_terms, trace, what_is_done
    from sinan.experiments.autopilots.parameters import facts_of_log
    from sinan.experiments.datasets import called, resolve

    tell("reading")
    recording = resolve(path)
    tell(what_is_done(recording))
    found = trace(recording, asked=Asked(called(log.path, recording), log.path))
    facts = facts_of_log(Path(path))
    said = _said(log) | ({"vehicle": facts.vehicle} if facts is not None and facts.vehicle else {})
    tell_in_its_terms(found.document, recording, [path], log.path)
    found.document["logs"] = [{"log": log.path, "sha256": log.digest}]
    tell("drawing")
    with TemporaryDirectory() as folder:
        page = found.to_html(Path(folder) / "page.html")
        return Answer({**found.document, **said, "why_not": None}, page.read_text(encoding="utf-8"))


def is_of(document: Mapping[str, Any], log: Log, limits: Limits) -> bool:
    """Whether a report that was kept is of this log, and need not be made again: it is whole, or a limit that was no
    lower stopped it.
    """
    if any(document.get(key, "") != value for key, value in _said(log).items() if key != "vehicle"):
        return False
    if document.get("why_not", "") is None:
        return True
    match document.get("stopped_by"):
        case {"limit": "time", "most": int() | float() as most}:
            return most >= limits.seconds
        case {"limit": "memory", "most": int() as most}:
            return most >= limits.memory
    return False
