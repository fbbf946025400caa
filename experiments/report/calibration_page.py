"""The page of a calibration: parameters with their uncertainty, norm before and after, what is undetermined."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sinan.experiments.report import figures, words
from sinan.experiments.report.page import Page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sinan.experiments.autopilots.parameter_set import Setting
    from sinan.experiments.calibrate import Calibrated


def calibration_page(
    path: Path, name: str, done: Sequence[Calibrated], left_out: Mapping[str, str], settings: Sequence[Setting] = ()
) -> None:
    """Write the page of one calibration, or of several.

    Parameters
    ----------
    settings : parameters of the autopilot that take it over
    """
    *others, last = [words.SENSORS[one.sensor] for one in done]
    sensors = f"{', '.join(others)} and {last}" if others else last
    aims = {one.sensor: _aim(one) for one in done}
    lead = "; ".join(dict.fromkeys(aims.values()))
    page = Page(f"{name}: {sensors} calibrated", f"calibrated = T K (reading + b), so that {lead}.")
    for one in done:
        if others:
            page.heading(_title(words.SENSORS[one.sensor]))
        _calibration(page, one, page.subheading if others else page.heading)
    if settings:
        page.heading("Parameters to type in")
        rows = [[one.name, f"{one.value:.6g}", "" if one.was is None else f"{one.was:.6g}"] for one in settings]
        page.table(["parameter", "to be set to", "as it was"], rows, numeric=(1, 2))
    if left_out:
        page.heading("What could not be calibrated")
    for sensor, why in left_out.items():
        page.text(f"{_title(words.SENSORS[sensor])}: {why}.")
    page.write(path)


def _title(text: str) -> str:
    return text[0].upper() + text[1:]


def _aim(one: Calibrated) -> str:
    """What a calibration makes true."""
    if one.readings is None:
        return "the turns of the gyroscope lead from each pose to the next"
    return "every reading has the length it should have"


def _calibration(page: Page, one: Calibrated, heading: Callable[[str], None]) -> None:
    """The numbers, the figure and the tables of one sensor."""
    document: Mapping[str, Any] = one.document
    gyro = one.readings is None
    squared = {"mag": "", "gyro": " / rad²"}.get(one.sensor, " / (m/s²)²")
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
        page.text(f"{_title(warning)}.")
    if one.readings is not None:
        page.figure(norm_figure(one), "Norm of each reading; the line is its true value.")
    heading("Parameters")
    page.table(["parameter", "value ± 1 sigma", "unit"], _rows(one.sensor, document), numeric=(1,))
    heading("What these data do not determine")
    for sentence in document["undetermined"]:
        page.text(sentence + ".")
    if not document["undetermined"]:
        page.text("Every parameter of this model is determined.")


def norm_figure(one: Calibrated) -> Figure:
    """Norm of each reading of an accelerometer or magnetometer before and after."""
    readings = one.readings
    assert readings is not None
    before = np.linalg.norm(readings.reading, axis=1)
    after = np.linalg.norm(one.apply(readings.reading * readings.normalised_by), axis=1)
    return figures.norm_before_after(before, after, readings.norm, words.stream_unit(one.sensor, readings.unit))


def _rows(sensor: str, document: Mapping[str, Any]) -> list[list[str]]:
    """Every parameter with its sigma and unit."""
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
    return rows


def _cells(value: float | None, std: float | None) -> list[str]:
    if value is None:
        return ["undetermined"]
    return [words.number(value) if std == 0.0 else words.with_sigma(value, std)]
