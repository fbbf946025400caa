"""`sinan calibrate`: a recording of poses -> T, K, b of one sensor or of all, as text, JSON and a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sinan.calibration.poses.gyro import GyroCalibration
from sinan.calibration.poses.triad import Calibration
from sinan.experiments.calibrate import (
    Calibrated,
    as_json,
    calibrate_triad,
    calibrate_turns,
    residual_notes,
    summary,
    warnings_of,
    without_declared,
)
from sinan.experiments.datasets import called, resolve
from sinan.experiments.report.console import tell_notes
from sinan.experiments.report.files import write_json
from sinan.experiments.report.words import trace_call
from sinan.experiments.residual_loop.open_source import (
    declared_for,
    of_each_sensor,
    require_kind,
    sensors_asked_for,
    sensors_in_poses,
    triad_readings,
)
from sinan.sensors.recording import Recording
from sinan.sensors.window import WHOLE, Span

#: What stands for every sensor that there is.
ALL = "all"


def run(
    sensor: str,
    input: str,
    axes: str | None,
    gravity: float | None,
    map_file: Path | None,
    json: Path | None,
    html: Path | None,
    span: Span = WHOLE,
) -> str:
    """Calibrate, write what is asked for, return the summary for the terminal."""
    recording = resolve(input, map_file, span)
    tell_notes(recording)
    require_kind(recording, "poses", "calibrate", "`sinan estimate` or `sinan trace`")
    done, left_out = calibrated(recording, sensor, axes, gravity)
    several = len(sensors_in_poses(recording)) > 1
    for one in done:
        call = trace_call(input, map_file, one.sensor if several and sensor != ALL else None, span)
        one.document["warnings"] = warnings_of(one.result, one.readings, call)
        one.document["window"] = None if span == WHOLE else list(span)
        one.document["notes"] = [] if one.readings is None else residual_notes(one.result, one.readings, call)
        if one.readings is not None:
            field_unit = recording.environment.field_unit
            one.document["read_in"] = field_unit if one.sensor == "mag" else one.readings.unit
    if json is not None:
        write_json(json, done[0].document if sensor != ALL else all_as_json(recording.name, done, left_out))
    if html is not None:
        from sinan.experiments.report.calibration_page import calibration_page

        calibration_page(html, called(input, recording, span), done, left_out)
    return "\n".join([*(summary(one.sensor, one.document) for one in done), *not_calibrated(left_out)])


def calibrated(
    recording: Recording, sensor: str, axes: str | None, gravity: float | None
) -> tuple[list[Calibrated], dict[str, str]]:
    """One sensor, or with `all` every one that can be calibrated; and why the others cannot.

    Raises
    ------
    InputError : none can be calibrated
    """
    asked_for = sensors_asked_for(recording, None if sensor == ALL else sensor)
    done, left_out = of_each_sensor(recording, asked_for, lambda name: calibrate_sensor(recording, name, axes, gravity))
    return list(done.values()), left_out


def calibrate_sensor(recording: Recording, sensor: str, axes: str | None, gravity: float | None) -> Calibrated:
    """One sensor; T is the identity if nothing is said, a gyroscope's is full."""
    readings = None
    if sensor == "gyro":
        result: Calibration | GyroCalibration = calibrate_turns(recording, axes or "full", gravity)
    else:
        readings = without_declared(recording, triad_readings(recording, sensor, gravity))
        result = calibrate_triad(recording, readings, axes or "none")
    document = as_json(sensor, result)
    if readings is not None:
        document["unit"] = readings.unit
    document["declared_effects"] = list(declared_for(recording, sensor))
    return Calibrated(sensor, result, readings, document)


def all_as_json(name: str, done: Sequence[Calibrated], left_out: dict[str, str]) -> dict[str, object]:
    """One document with a block a sensor."""
    return {
        "format": 1,
        "recording": name,
        "sensors": {one.sensor: one.document for one in done},
        "left_out": [{"sensor": sensor, "why": why} for sensor, why in left_out.items()],
    }


def not_calibrated(left_out: dict[str, str]) -> list[str]:
    """A line for each sensor that cannot be calibrated."""
    return [f"{sensor}: not calibrated: {why}" for sensor, why in left_out.items()]
