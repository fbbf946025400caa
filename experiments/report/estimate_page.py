"""The page of an estimate: biases with their uncertainty, innovations, errors against a reference."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from experiments.report.page import Page
from experiments.report.words import number


def estimate_page(path: Path, name: str, document: Mapping[str, Any]) -> None:
    """Write the page."""
    page = Page(f"{name}: the filter's estimate", f"{number(document['duration'])} s of flight.")
    truth = {k: v for k, v in (document.get("truth") or {}).items() if isinstance(v, float)}
    page.numbers([(number(value), key.replace("_", " ") + " against the reference") for key, value in truth.items()])
    page.heading("Biases at the end")
    rows = []
    for sensor, values in document["bias"].items():
        listed = values if isinstance(values, list) else [values]
        sigmas = document["bias_std"][sensor]
        sigmas = sigmas if isinstance(sigmas, list) else [sigmas]
        rows += [
            [f"{sensor} {axis}".strip(), number(b), number(s)]
            for axis, b, s in zip("xyz" if len(listed) > 1 else [""], listed, sigmas, strict=True)
        ]
    page.table(["bias", "value", "1 sigma"], rows, numeric=(1, 2))
    page.heading("Innovations")
    rows = [[sensor, number(nis), str(document["rejected"].get(sensor, 0))] for sensor, nis in document["nis"].items()]
    page.table(["sensor", "NIS a degree of freedom (1 is right)", "refused"], rows, numeric=(1, 2))
    for note in [*document.get("noise", []), *document.get("notes", [])]:
        page.text(str(note), note=True)
    page.write(path)
