"""`sinan batch`: many logs -> a page each, and one that ranks vehicles by effect, as text, JSON and pages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sinan.experiments.fleet.batch import page_of
from sinan.experiments.fleet.batch import run as trace_all
from sinan.experiments.fleet.logs import logs_in
from sinan.experiments.fleet.ranking import fleet
from sinan.experiments.report.console import progress
from sinan.experiments.report.files import write_json
from sinan.experiments.workers.alone import Limits
from sinan.sensors.files import together


def run(inputs: Sequence[str], out: Path, workers: int | None, dask: str | None, limits: Limits | None = None) -> str:
    """Trace all, write `index.html`, `fleet.json`, reports and pages; return the summary for the terminal."""
    logs = logs_in(inputs, out)
    with progress("tracing", flies=True) as step:
        documents = trace_all(logs, out, workers, dask, lambda done, total: step("", done, total), limits)
    document = fleet(documents, [str(page_of(out, log).relative_to(out)) for log in logs])
    with together():
        from sinan.experiments.report.fleet_page import fleet_page

        write_json(out / "fleet.json", document)
        fleet_page(out / "index.html", document)
    return summary(document)


def summary(document: Mapping[str, Any]) -> str:
    """Vehicles by what their effects explain, one a line."""
    from sinan.experiments.report.fleet_page import changes, title

    lines = [f"{document['logs']} logs: {title(document)}"]
    for one in document["vehicles"]:
        last = one["logs"][-1]
        lines.append(f"  {one['vehicle']}: {last['headline']} ({changes(one)})")
    return "\n".join([*lines, *(f"  not traced: {one['log']}: {one['why']}" for one in document["failed"])])
