"""The page of an estimate: biases with their uncertainty, innovations, errors against a reference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sinan.experiments.estimate import BiasCourse
from sinan.experiments.report import figures
from sinan.experiments.report.assumption_table import assumption_table
from sinan.experiments.report.estimate_words import (
    gaps_in_words,
    innovations,
    not_as_expected,
    size_of_innovations,
    what_next,
)
from sinan.experiments.report.page import Drawn, Page
from sinan.experiments.report.words import (
    SENSORS,
    bias_rows,
    number,
    off_by,
    reference_notes,
    reference_rows,
    with_sigma,
)


def estimate_page(
    path: Path,
    name: str,
    document: Mapping[str, Any],
    courses: Sequence[BiasCourse],
    review: Drawn | None = None,
) -> None:
    """Write the page.

    Parameters
    ----------
    document : of `sinan estimate --json`
    courses : the biases over time
    review : the recording over time
    """
    silent = f", {silence}" if (silence := gaps_in_words(document)) else ""
    lasts = f"{number(document['duration'])} s of flight{silent}"
    page = Page(f"{name}: the filter's estimate", f"{lasts}. {size_of_innovations(document)}")
    outside = not_as_expected(document)
    agrees = not outside
    page.verdict("consistent" if agrees else "not as expected", "no_effect" if agrees else "ambiguous")
    page.text(f"What to do next: {what_next(document)}")
    page.numbers([(value, name) for name, value in reference_rows(document)])
    for warning in document.get("warnings", []):
        page.text(f"{warning[0].upper()}{warning[1:]}.")
    page.rests_on(document.get("logs", []))
    taken = [*reference_notes(document), *document.get("noise", []), *document.get("notes", [])]
    if taken:
        with page.folded("What the log does not declare, and was estimated from it"):
            page.items([str(note) for note in taken])
    if document.get("not_seen"):
        with page.folded("What this log could not show"):
            page.items(document["not_seen"])
    bias_part(page, document, courses)
    innovation_part(page, document)
    assumption_table(page, document)
    if review is not None:
        page.heading("The log over time")
        page.part(review)
    page.write(path)


def bias_part(page: Page, document: Mapping[str, Any], courses: Sequence[BiasCourse]) -> None:
    """The biases over time and, as numbers, at the end."""
    page.heading("Biases")
    known = any(course.truth.size for course in courses)
    is_broken = any(np.any(np.isnan(course.value)) for course in courses)
    page.figure(
        figures.biases_over_time(courses),
        "Each bias, as the filter estimates it, with its 3-sigma band"
        + ("; black: the truth." if known else ".")
        + (" Lines break where the IMU was silent." if is_broken else ""),
    )
    head = ["bias", "unit", "at the end ± 1 sigma"]
    rows = [[row.name, row.unit, with_sigma(row.value, row.sigma)] for row in bias_rows(document)]
    if known:
        head += ["truth", "estimate minus truth"]
        for cells, row in zip(rows, bias_rows(document), strict=True):
            cells += ["-" if row.truth is None else f"{row.truth:.{row.digits}f}", off_by(row)]
    page.table(head, rows, numeric=(2, 3, 4))


def innovation_part(page: Page, document: Mapping[str, Any]) -> None:
    """How large the innovations of each sensor are, against what the filter expects of them."""
    page.heading("Innovations: reading minus prediction")
    page.text(
        "NIS compares the size of the innovations with what the filter expects of them: 1 is right; more than 1 means "
        "errors that the filter does not know of, less than 1 that it expects too much noise. With a right model NIS "
        "lies outside the interval by chance in one case of a hundred; where the noise is found from the log and has "
        "heavy tails there is no interval. Refused are single readings too far off to be noise."
    )
    rows = [
        [
            SENSORS.get(sensor, sensor),
            "-" if nis is None else f"{nis:.3f}",
            " to ".join("-" if v is None else f"{v:.3f}" for v in document["nis_interval"][sensor]),
            innovations(document, sensor) or "-",
            str(document["rejected"].get(sensor, 0)),
        ]
        for sensor, nis in document["nis"].items()
    ]
    head = ["sensor", "NIS", "99 % interval if the model is right", "innovations", "refused"]
    page.table(head, rows, numeric=(1, 2, 4))
