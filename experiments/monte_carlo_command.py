"""`sinan montecarlo`: many flights of one scenario -> NEES, NIS, coverage, as text, JSON and a page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from experiments.monte_carlo import run as fly
from experiments.report.console import progress
from experiments.report.files import write_json


def run(
    scenario: str,
    runs: int,
    workers: int | None,
    dask: str | None,
    resume: Path | None,
    seed: int,
    json: Path | None,
    html: Path | None,
    relinearise: bool = False,
) -> str:
    """Run, write what is asked for, return the summary for the terminal."""
    with progress("flying") as step:
        result = fly(
            scenario,
            runs,
            seed=seed,
            workers=workers,
            dask=dask,
            resume=resume,
            progress=lambda done, total: step("", done, total),
            relinearise=relinearise,
        )
    document = result.summary()
    if json is not None:
        write_json(json, document)
    if html is not None:
        from experiments.report.monte_carlo_page import monte_carlo_page

        monte_carlo_page(html, document)
    return summary(document)


def summary(document: Mapping[str, Any]) -> str:
    """Averages against their intervals, one a line."""

    def line(name: str, entry: Mapping[str, Any]) -> str:
        if entry["mean_per_dof"] is None:
            return f"  {name:18} no reading"
        low, high = entry["interval"]
        inside = "" if low <= entry["mean_per_dof"] <= high else "  outside"
        return f"  {name:18} {entry['mean_per_dof']:.3f}  [{low:.3f}, {high:.3f}]{inside}"

    lines = [f"{document['scenario']}: {document['runs']} flights", "NEES a state at the end, with its 95 % interval"]
    lines.append(line("all states", document["nees"]["overall"]))
    lines += [line(name, entry) for name, entry in document["nees"]["blocks"].items()]
    lines.append("NIS a degree of freedom")
    lines += [line(name, entry) for name, entry in document["nis"].items()]
    shares = ", ".join(f"{k} sigma {100 * share:.1f} %" for k, share in document["coverage"].items())
    return "\n".join([*lines, f"errors within {shares}"])
