"""The page of a calibration: parameters with their uncertainty, norm before and after, what is undetermined."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from calibration.triad import Calibration
from experiments.report import figures, words
from experiments.report.page import Page

if TYPE_CHECKING:
    from calibration.gyro import GyroCalibration
    from sensors.arrays import FloatArray


def calibration_page(
    path: Path,
    name: str,
    sensor: str,
    result: Calibration | GyroCalibration,
    document: Mapping[str, Any],
    readings: FloatArray | None = None,
    norm: float = 1.0,
    unit: str = "1",
) -> None:
    """Write the page of a calibration."""
    page = Page(f"{name}: {sensor} calibrated", "calibrated = T K (reading + b)")
    page.numbers(
        [
            (words.number(document["sse_before"]), "sum of squared residuals before"),
            (words.number(document["sse"]), "after"),
            (str(document["n"]), "readings" if isinstance(result, Calibration) else "static poses"),
        ]
    )
    if readings is not None and isinstance(result, Calibration):
        before = np.linalg.norm(readings, axis=1)
        after = np.linalg.norm(result.apply(readings * result.normalised_by), axis=1)
        page.figure(
            figures.norm_before_after(before, after, norm, unit), "Norm of each reading; the line is its true value."
        )
    page.heading("Parameters")
    rows = []
    for i, axis in enumerate("xyz"):
        rows.append([f"scale K {axis}", _cell(document["K"][i]), _cell(document["std"]["K"][i])])
    for i, axis in enumerate("xyz"):
        rows.append([f"offset b {axis}", _cell(document["b"][i]), _cell(document["std"]["b"][i])])
    for i in range(3):
        for j in range(3):
            if i != j and document["T"][i][j] != 0.0:
                rows.append(
                    [f"axes T {'xyz'[i]}{'xyz'[j]}", _cell(document["T"][i][j]), _cell(document["std"]["T"][i][j])]
                )
    page.table(["parameter", "value", "1 sigma"], rows, numeric=(1, 2))
    page.heading("What these data do not determine")
    for sentence in document["undetermined"]:
        page.text(sentence + ".")
    if not document["undetermined"]:
        page.text("Every parameter of this model is determined.")
    page.write(path)


def _cell(value: float | None) -> str:
    return "undetermined" if value is None else f"{value:.6g}"
