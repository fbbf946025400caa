"""What a log does not declare and the filter went by: a table of a page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from sinan.experiments.report.page import Page

HEAD = ("of", "what", "value", "1 sigma", "unit", "from")


def assumption_table(page: Page, document: Mapping[str, Any]) -> None:
    """What was found in the log or taken from its class of instruments, with how well it is known; of a log that
    declares everything nothing.
    """
    if not document.get("assumptions"):
        return
    page.heading("Numbers that the log does not declare")
    page.text(
        "Declare a number in `recording.toml` or a map to replace a row. A sigma written as \u00d7 1.5 is a factor: a "
        "value of 0.2 then lies between 0.13 and 0.3 in two logs of three. Noise is the scale of a Student t "
        "distribution with four degrees of freedom, about 0.8 of the standard deviation of normal noise."
    )
    with page.folded(f"{len(document['assumptions'])} numbers, each with its uncertainty"):
        page.table(HEAD, [_cells(row) for row in document["assumptions"]], numeric=(2, 3))


def _cells(row: Mapping[str, Any]) -> list[str]:
    """Angles in degrees, times below a second in milliseconds."""
    factor, unit = {"rad": (float(np.rad2deg(1.0)), "deg")}.get(row["unit"], (1.0, row["unit"]))
    if row["unit"] == "s" and abs(row["value"]) < 1.0:
        factor, unit = 1e3, "ms"
    sigma = "-"
    if row["sigma"] is not None:
        sigma = f"\u00d7 {np.exp(row['sigma']):.2g}" if row["is_ratio"] else f"{factor * row['sigma']:.2g}"
    return [row["subject"], row["quantity"], f"{factor * row['value']:.3g}", sigma, unit, row["source"]]
