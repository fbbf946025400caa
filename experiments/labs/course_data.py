"""The course's readings, calibrated with its own model (T = I)."""

from __future__ import annotations

from sinan.calibration.poses.triad import Calibration, calibrate_norm
from sinan.experiments.datasets import resolve
from sinan.experiments.residual_loop.open_source import TriadReadings, triad_readings


def calibrated(file: str, sensor: str, gravity: float | None = None) -> tuple[TriadReadings, Calibration]:
    """Readings of a file of the course's data set and their calibration with T = I."""
    readings = triad_readings(resolve(f"rfly_course/{file}"), sensor, gravity)
    return readings, calibrate_norm(sensor, readings.reading, readings.norm, normalised_by=readings.normalised_by)


def numbers(values: object) -> str:
    """Four decimals, as the course prints them."""
    return ", ".join(f"{v:.4f}" for v in values)  # type: ignore[attr-defined]
