"""`sinan ranges`: a scenario of pseudoranges -> RINEX files, errors over the age of corrections, JSON and a page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sinan.experiments.gnss import link_study, simulated
from sinan.experiments.report.console import working
from sinan.experiments.report.files import write_json
from sinan.experiments.report.words import number


def run(scenario: str, out: Path | None, seed: int, json: Path | None, html: Path | None) -> str:
    """Simulate, study, write what is asked for, return the summary for the terminal."""
    with working("simulating ranges"):
        found = simulated.simulate(simulated.load(scenario), seed)
        document = link_study.document_of(found, seed)
    if out is not None:
        simulated.write(found, out)
    if json is not None:
        write_json(json, document)
    if html is not None:
        from sinan.experiments.report.ranges_page import ranges_page

        ranges_page(html, document)
    place = " ".join(f"{x:.4f}" for x in found.base_position)
    return summary(document) + (
        "" if out is None else f"\n{_to_solve(out, place, simulated.code_of(found.scenario.rover))}"
    )


def _to_solve(out: Path, place: str, code: str) -> str:
    """The command that reads the files."""
    files = f"{out}/rover.obs {out}/broadcast.nav --systems G --reference {out}/reference.csv"
    option = "" if code == "ca" else f" --code {code}"
    return f"files: {out}\n  to solve them: sinan gnss {files} --base {out}/base.obs --base-position {place}{option}"


def summary(document: Mapping[str, Any]) -> str:
    """The result in a few lines."""
    scenario, link = document["scenario"], document["link"]
    lines = [f"{scenario['name']}: {scenario['summary']}"]
    lines.append(f"  {document['epochs']} epochs with {document['satellites']:.1f} satellites each")
    for name, one in document["receivers"].items():
        text = f"noise {number(one['noise'])} m, slow errors {number(one['drift'])} m, {one['rate_hz']:g} Hz"
        lines.append(f"  {name}: {one['class']} ({', '.join(one['codes'])}), {text}")
    lines.append(f"  alone: position error {number(document['alone']['rms'])} m RMS")
    error, age = link["position_error"], link["age"]
    if error is None:
        lines.append("  over the link: no correction is young enough for a fix")
    else:
        ages = (
            f"age {number(age['mean'])} s on average (expected {number(link['expected_age'])}), {age['max']:g} at most"
        )
        lines.append(f"  over the link: position error {number(error['rms'])} m RMS; {ages}")
    lines.append("  age / s   error of a corrected range / m: measured, expected; held without its rate")
    for entry in document["ages"]:
        cells = [entry[kind][key] for kind in ("with_rate", "without_rate") for key in ("range", "range_expected")]
        lines.append(f"  {entry['age']:7g}   " + "  ".join(f"{cell:7.2f}" for cell in cells))
    return "\n".join(lines)
