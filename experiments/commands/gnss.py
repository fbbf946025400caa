"""`sinan gnss`: RINEX files -> positions and traced ranges, as text, JSON and a page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sinan.experiments.gnss.study import run as solve
from sinan.experiments.report.console import working
from sinan.experiments.report.files import write_json
from sinan.experiments.report.words import length, number, shown_stages, stage_names


def run(
    observation: Path,
    navigation: list[Path],
    systems: str,
    mask: float,
    position: tuple[float, float, float] | None,
    reference: Path | None,
    base: Path | None,
    base_position: tuple[float, float, float] | None,
    solution: Path | None,
    json: Path | None,
    html: Path | None,
) -> str:
    """Solve and trace, write what is asked for, return the summary for the terminal."""
    with working("solving and tracing the ranges"):
        document = solve(observation, navigation, systems, mask, position, reference, base, base_position, solution)
    if json is not None:
        write_json(json, document)
    if html is not None:
        from sinan.experiments.report.gnss_page import gnss_page

        gnss_page(html, document)
    return summary(document)


def summary(document: Mapping[str, Any]) -> str:
    """The result in a few lines."""
    lines = [f"{document['recording']}: {document['epochs']} epochs, {', '.join(document['systems'])}"]
    lines[0] += f"; position errors against {document['reference']}" if document.get("reference") else ""
    lines.append(f"  verdict: {document['verdict']}")
    stages = shown_stages(document)
    width = max(map(len, stage_names(stages)))
    for name, stage in zip(stage_names(stages), stages, strict=True):
        error = stage.get("position_error")
        text = f"  {name:{width}}  residual {number(stage['residual_rms'])} m RMS"
        lines.append(text + (f", position error {number(error['mean'])} m mean" if error else ""))
    dgps = document.get("dgps")
    if dgps:
        error = dgps.get("position_error")
        text = f"  with corrections of the base, {length(dgps['baseline'])} away"
        lines.append(text + (f": position error {number(error['mean'])} m mean" if error else ""))
    lines += [f"  excluded: {item['satellite']} in {item['epochs']} epochs" for item in document["excluded"]]
    lines += [f"  note: {note}" for note in document["journal"]]
    return "\n".join(lines)
