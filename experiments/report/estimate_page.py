"""The page of an estimate: biases with their uncertainty, innovations, errors against a reference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.estimate import BiasCourse
from experiments.report import figures
from experiments.report.page import Page
from experiments.report.words import (
    BIAS_UNITS,
    SENSORS,
    component_name,
    number,
    reference_name,
    reference_value,
    with_sigma,
)


def estimate_page(path: Path, name: str, document: Mapping[str, Any], courses: Sequence[BiasCourse]) -> None:
    """Write the page."""
    page = Page(f"{name}: the filter's estimate", f"{number(document['duration'])} s of flight. {_verdict(document)}")
    truth = {k: v for k, v in (document.get("truth") or {}).items() if k.endswith("_rms")}
    page.numbers([(reference_value(name, value), reference_name(name)) for name, value in truth.items()])
    for warning in document.get("warnings", []):
        page.text(f"{warning[0].upper()}{warning[1:]}.")
    page.heading("Biases")
    known = any(course.truth.size for course in courses)
    page.figure(
        figures.biases_over_time(courses),
        "Each bias, as the filter estimates it, with its 3-sigma band" + ("; black: the truth." if known else "."),
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
                with_sigma(b, s),
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
    page.table(["bias", "unit", "at the end ± 1 sigma", "true minus estimate"], rows, numeric=(2, 3))
    page.heading("Innovations: reading minus prediction")
    page.text(
        "NIS is the squared innovation over the variance that the filter expects of it, a degree of freedom: 1 is "
        "right, more means errors that the filter does not know of. Refused are single readings that no noise explains."
    )
    rows = [
        [
            SENSORS.get(sensor, sensor),
            "-" if nis is None else f"{nis:.3f}",
            " to ".join("-" if v is None else f"{v:.3f}" for v in document["nis_interval"][sensor]),
            str(document["rejected"].get(sensor, 0)),
        ]
        for sensor, nis in document["nis"].items()
    ]
    page.table(["sensor", "NIS", "95 % of right filters", "refused"], rows, numeric=(1, 2, 3))
    for note in [*document.get("noise", []), *document.get("notes", [])]:
        page.text(str(note), note=True)
    page.write(path)


def _verdict(document: Mapping[str, Any]) -> str:
    outside = len(document.get("warnings", []))
    if not outside:
        return "Its innovations are about as large as it expects: nothing speaks against its model."
    return f"The innovations of {outside} of {len(document['nis'])} sensors are not as large as it expects."
