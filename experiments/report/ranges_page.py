"""The page of simulated pseudoranges: the receivers, the fixes alone and over the link, errors over age."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sinan.experiments.report.lab_figures import Panel, panels
from sinan.experiments.report.page import Page
from sinan.experiments.report.words import change, number


def ranges_page(path: Path, document: Mapping[str, Any]) -> None:
    """Write the page."""
    scenario, link = document["scenario"], document["link"]
    page = Page(f"Simulated pseudoranges: {scenario['summary']}", _lead(document))
    error = link["position_error"]
    page.numbers(
        [
            (f"{change(document['alone']['rms'], error['rms'])} m", "RMS position error, alone and over the data link"),
            (f"{number(link['age']['mean'])} s", f"mean age; expected {number(link['expected_age'])} s"),
        ]
        if error
        else [(f"{number(document['alone']['rms'])} m", "RMS position error; over the link there is no fix")]
    )
    page.heading("Receivers")
    rows = [
        [
            name,
            one["class"],
            ", ".join(one["codes"]),
            f"{one['noise']:.2f}",
            f"{one['drift']:.2f}",
            f"{one['rate_hz']:g}",
        ]
        for name, one in document["receivers"].items()
    ]
    page.table(["", "class", "codes", "noise / m", "slow error / m", "rate / Hz"], rows, (3, 4, 5))
    page.heading("What the age of a correction does")
    page.figure(panels([_panel(document, "range"), _panel(document, "position")]), _CAPTION)
    head = ["age / s", "range / m", "expected", "position / m", "expected", "held: range / m", "expected"]
    keys = [("with_rate", "range"), ("with_rate", "range_expected"), ("with_rate", "position")]
    keys += [("with_rate", "position_expected"), ("without_rate", "range"), ("without_rate", "range_expected")]
    table = [[f"{e['age']:g}", *(f"{e[kind][key]:.2f}" for kind, key in keys)] for e in document["ages"]]
    page.table(head, table, range(len(head)))
    page.text(
        "Expected: variance of the corrected range from the autocovariance of what the messages are wrong by, the line "
        "that the base draws through its past, and the noise of both receivers; nothing is fitted.", note=True,
    )  # fmt: skip
    page.write(path)


_CAPTION = (
    "RMS error over the age of a correction, aged by its rate and held without it; dots: simulated, lines: expected. "
    "A rate is worth its noise only where the error has a rate."
)


def _lead(document: Mapping[str, Any]) -> str:
    link = document["scenario"]["link"]
    content = {"corrections": "corrections with rates", "raw": "the base's raw pseudoranges"}[link["content"]]
    text = f"{document['epochs']} epochs, {document['satellites']:.1f} satellites each. The data link brings {content} "
    text += f"every {link['interval']:g} s, {link['delay']:g} s late, and loses {100 * link['loss']:.0f} % of them"
    return text + (f", {link['run']:g} in a row." if link["run"] else ".")


def _panel(document: Mapping[str, Any], what: str) -> Panel:
    ages = np.array([entry["age"] for entry in document["ages"]])
    curves, points = {}, {}
    for kind, name in (("with_rate", "with rate"), ("without_rate", "held")):
        curves[f"{name}, expected"] = (ages, np.array([entry[kind][f"{what}_expected"] for entry in document["ages"]]))
        points[f"{name}, simulated"] = (ages, np.array([entry[kind][what] for entry in document["ages"]]))
    title = {"range": "a corrected range", "position": "the fix"}[what]
    return Panel("age of the correction / s", "RMS error / m", curves, points, title)
