"""The page of an estimate: biases with their uncertainty, innovations, errors against a reference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.estimate import BiasCourse
from experiments.report import figures
from experiments.report.page import Page
from experiments.report.words import BIAS_UNITS, component_name, number, reference_name, reference_value


def estimate_page(path: Path, name: str, document: Mapping[str, Any], courses: Sequence[BiasCourse]) -> None:
    """Write the page."""
    page = Page(f"{name}: the filter's estimate", f"{number(document['duration'])} s of flight.")
    truth = {k: v for k, v in (document.get("truth") or {}).items() if k.endswith("_rms")}
    page.numbers([(reference_value(name, value), reference_name(name)) for name, value in truth.items()])
    page.heading("Biases")
    known = any(course.truth.size for course in courses)
    page.figure(
        figures.biases_over_time(courses),
        "Each bias with its 3-sigma band" + ("; black: the truth." if known else "."),
    )
    errors = (document.get("truth") or {}).get("bias_error", {})
    rows = []
    for sensor, values in document["bias"].items():
        listed = values if isinstance(values, list) else [values]
        sigmas = document["bias_std"][sensor]
        sigmas = sigmas if isinstance(sigmas, list) else [sigmas]
        rows += [
            [
                f"{sensor} {component_name(sensor, k, len(listed))}".strip(),
                BIAS_UNITS.get(sensor, "m"),
                number(b),
                number(s),
                number(e) if e is not None else "-",
            ]
            for k, b, s, e in zip(
                range(len(listed)),
                listed,
                sigmas,
                errors.get(sensor, [None] * len(listed)),
                strict=True,
            )
        ]
    page.table(["bias", "unit", "value at the end", "1 sigma", "true minus estimate"], rows, numeric=(2, 3, 4))
    page.heading("Innovations")
    rows = [[sensor, number(nis), str(document["rejected"].get(sensor, 0))] for sensor, nis in document["nis"].items()]
    page.table(["sensor", "NIS a degree of freedom (1 is right)", "refused"], rows, numeric=(1, 2))
    for note in [*document.get("noise", []), *document.get("notes", [])]:
        page.text(str(note), note=True)
    page.write(path)
