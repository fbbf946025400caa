"""The page of pseudoranges: stages from the plain model to the full one, excluded satellites, DGPS."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from experiments.report.figures import stage_bars
from experiments.report.page import Page
from experiments.report.words import number, stage_names


def gnss_page(path: Path, document: Mapping[str, Any]) -> None:
    """Write the page."""
    stages = document["stages"]
    first, last = stages[0], stages[-1]
    names = ", ".join(effect["name"].removeprefix("pseudorange.").replace("_", " ") for effect in document["effects"])
    page = Page(
        f"What the ranges call for: {names or 'nothing'}",
        f"{document['recording']}: {document['epochs']} epochs of {', '.join(document['systems'])}.",
    )
    page.numbers(
        [
            (f"{number(first['residual_rms'])} m → {number(last['residual_rms'])} m", "residual, plain to full model"),
            *_errors(first, last),
        ]
    )
    page.heading("Stage by stage")
    page.figure(stage_bars(stages), "Residual and, where the position is known, position error after each effect.")
    rows = []
    for name, stage in zip(stage_names(stages), stages, strict=True):
        error = stage.get("position_error") or {}
        enu = error.get("enu")
        rows.append(
            [
                name,
                number(stage["residual_rms"]),
                number(error["mean"]) if error else "-",
                number(error["p95"]) if error else "-",
                ", ".join(number(v) for v in enu) if enu else "-",
            ]
        )
    head = ["model", "residual / m", "mean error / m", "95 % / m", "mean east, north, up / m"]
    page.table(head, rows, numeric=(1, 2, 3))
    if document.get("dgps"):
        _dgps(page, document["dgps"])
    page.heading("What was left out, and what cannot be seen")
    for item in document["excluded"]:
        page.text(f"Satellite {item['satellite']} was left out in {item['epochs']} epochs.")
    for note in document["journal"]:
        page.text(note, note=True)
    page.write(path)


def _errors(first: Mapping[str, Any], last: Mapping[str, Any]) -> list[tuple[str, str]]:
    before, after = first.get("position_error"), last.get("position_error")
    if not before or not after:
        return []
    return [(f"{number(before['mean'])} m → {number(after['mean'])} m", "mean position error")]


def _dgps(page: Page, dgps: Mapping[str, Any]) -> None:
    page.heading("With the base receiver's corrections")
    pairs = [(f"{number(dgps['baseline'] / 1000.0)} km", "base line"), (f"{number(dgps['age']['mean'])} s", "mean age")]
    error = dgps.get("position_error")
    if error:
        pairs.append((f"{number(error['mean'])} m", "mean position error"))
    page.numbers(pairs)
