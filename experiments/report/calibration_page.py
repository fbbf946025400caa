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
    gyro = not isinstance(result, Calibration)
    squared = {"mag": "", "gyro": " / rad²"}.get(sensor, " / (m/s²)²")
    page = Page(
        f"{name}: {words.SENSORS[sensor]} calibrated",
        "calibrated = T K (reading + b), so that "
        + ("the turns lead from each pose to the next." if gyro else "every reading has the length it should have."),
    )
    page.numbers(
        [
            (
                f"{words.number(document['sse_before'])} → {words.number(document['sse'])}",
                f"sum of squared residuals{squared}, before and after",
            ),
            (str(document["n"]), words.noun_of(document["n"], "static pose" if gyro else "reading")),
        ]
    )
    for warning in document.get("warnings", []):
        page.text(f"{warning[0].upper()}{warning[1:]}.")
    if readings is not None and isinstance(result, Calibration):
        before = np.linalg.norm(readings, axis=1)
        after = np.linalg.norm(result.apply(readings * result.normalised_by), axis=1)
        page.figure(
            figures.norm_before_after(before, after, norm, words.stream_unit(sensor, unit)),
            "Norm of each reading; the line is its true value.",
        )
    page.heading("Parameters")
    offset_unit = words.stream_unit(sensor, str(document["unit"]))
    rows = []
    for i, axis in enumerate("xyz"):
        rows.append([f"scale K {axis}", *_cells(document["K"][i], document["std"]["K"][i]), "ratio"])
    for i, axis in enumerate("xyz"):
        rows.append([f"offset b {axis}", *_cells(document["b"][i], document["std"]["b"][i]), offset_unit])
    for i in range(3):
        for j in range(3):
            if i != j and document["T"][i][j] != 0.0:
                std = document["std"]["T"][i][j]
                rows.append([f"axes T {'xyz'[i]}{'xyz'[j]}", *_cells(document["T"][i][j], std), "ratio"])
    page.table(["parameter", "value ± 1 sigma", "unit"], rows, numeric=(1,))
    page.heading("What these data do not determine")
    for sentence in document["undetermined"]:
        page.text(sentence + ".")
    if not document["undetermined"]:
        page.text("Every parameter of this model is determined.")
    page.write(path)


def _cells(value: float | None, std: float | None) -> list[str]:
    if value is None:
        return ["undetermined"]
    return [words.number(value) if std == 0.0 else words.with_sigma(value, std)]
