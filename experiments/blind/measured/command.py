"""`sinan blind --measured`: effects put into measured minutes, traced and counted."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sinan.experiments.blind.measured import benchmark
from sinan.experiments.blind.measured.page import page, rates, sizes_of
from sinan.experiments.blind.rates import shown
from sinan.experiments.measured.flights import LOGS
from sinan.experiments.report.console import progress
from sinan.experiments.report.files import write_json
from sinan.sensors.errors import InputError
from sinan.sensors.files import together, write_text


def run(out: Path, runs: int, seed: int, logs: Sequence[str], workers: int, table: Path | None) -> str:
    """Put in, trace, count; the rates for the terminal. The page is of all that the folder holds, of every seed.

    Parameters
    ----------
    out : folder for the reports; what it holds already is not traced again
    logs : names of measured flights and hand-held logs, or what `sinan trace` is given; none: all
    table : file of the page; default: `out`/blind_measured.md
    """
    names = [named(log) for log in logs] or list(LOGS)
    with progress("minutes", flies=True) as tell:
        benchmark.run(out, names, runs, seed, workers, tell)
    controls, found = benchmark.collected(out)
    asked = rates(found)
    with together():
        write_json(out / "rates.json", {"format": 1, "rates": asked, "detectable": sizes_of(controls)})
        write_text(table or out / "blind_measured.md", page(controls, found))
    return "\n".join(f"{what:80} {shown(entry)}" for what, entry in asked.items())


def named(log: str) -> str:
    """The name of a log, which may be given as the input of a command.

    Raises
    ------
    InputError : no such log
    """
    found = log if log in LOGS else next((name for name, given in LOGS.items() if given == log), None)
    if found is None:
        raise InputError(log, "no measured flight or hand-held log", "one of " + "; ".join(LOGS))
    return found
