"""`sinan.calibrate`: T, K and b of the three-axis sensors of a recording of poses, with tables, figures and a page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sinan.calibration.poses.gyro import GyroCalibration
from sinan.calibration.poses.triad import Calibration, require_possible
from sinan.experiments.answers.asked import PLAIN, Answer, Asked
from sinan.experiments.calibrate import Calibrated, as_json, calibrate_triad, calibrate_turns, without_declared
from sinan.experiments.report.calibration_words import residual_notes, summary, warnings_of
from sinan.experiments.residual_loop.open_source import (
    declared_for,
    of_each_sensor,
    require_kind,
    sensors_asked_for,
    sensors_in_poses,
    triad_readings,
)
from sinan.sensors.formats.named_columns import UNREAD
from sinan.sensors.recording import Recording

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

#: What stands for every sensor that there is.
ALL = "all"


@dataclass(frozen=True, eq=False, repr=False)
class Calibrations(Answer, Mapping[str, Calibrated]):
    """The sensors of a recording, calibrated; a mapping from a sensor's name to its calibration.

    `calibrations["mag"]` has `T`, `K`, `b` (calibrated = T K (reading + b)) and `apply(reading)`.

    Attributes
    ----------
    recording : the poses
    done : by sensor
    left_out : by sensor, why it cannot be calibrated
    document : the numbers, as `sinan calibrate --json` writes them
    asked : how the user calls the recording
    """

    recording: Recording
    done: Mapping[str, Calibrated]
    left_out: Mapping[str, str]
    document: dict[str, Any]
    asked: Asked = field(default=PLAIN, repr=False)

    def __getitem__(self, sensor: str) -> Calibrated:
        return self.done[sensor]

    def __iter__(self) -> Iterator[str]:
        return iter(self.done)

    def __len__(self) -> int:
        return len(self.done)

    def parameters(self) -> pd.DataFrame:
        """T, K and b of every sensor with their 1-sigma.

        Returns
        -------
        a row a number; columns `sensor`, `parameter` (T, K, b), `row`, `column` (of T), `value`, `sigma`; not a number:
        the data do not determine it
        """
        import numpy as np
        import pandas as pd

        rows = []
        for name, one in self.done.items():
            std = one.result.std()
            for parameter, values, sigma in (("T", one.T, std["T"]), ("K", one.K, std["K"]),
                                             ("b", one.b, std["b"])):  # fmt: skip
                for place in np.ndindex(values.shape):
                    row, column = (*place, -1)[:2]
                    rows.append((name, parameter, row, column, float(values[place]), float(sigma[place])))
        return pd.DataFrame(rows, columns=["sensor", "parameter", "row", "column", "value", "sigma"])

    def summary(self) -> str:
        """What `sinan calibrate` prints: T, K, b, residuals, warnings."""
        said = [summary(one.sensor, one.document) for one in self.done.values()]
        return "\n".join([*said, *(f"{sensor}: not calibrated: {why}" for sensor, why in self.left_out.items())])

    def to_html(self, path: str | Path) -> Path:
        """Write the page of `sinan calibrate --html`. Returns its path."""
        from sinan.experiments.report.calibration_page import calibration_page

        calibration_page(Path(path), self.asked.name_of(self.recording), list(self.done.values()), self.left_out)
        return Path(path)

    def plot_norm(self, sensor: str) -> list[Axes]:
        """Norm of each reading before and after the calibration, against the norm that it should have. One axes.

        Parameters
        ----------
        sensor : "accel" or "mag"

        Raises
        ------
        KeyError : not calibrated
        ValueError : a gyroscope, which is calibrated by turns: its readings have no norm to have
        """
        from sinan.experiments.report import screen
        from sinan.experiments.report.calibration_page import norm_figure

        one = self.done[sensor]
        if one.readings is None:
            raise ValueError(f"plot_norm: `{sensor}` is calibrated by turns; expected accel or mag")
        return screen.axes(lambda: norm_figure(one))


def calibrate(
    recording: Recording,
    sensor: str = ALL,
    *,
    axes: str | None = None,
    gravity: float | None = None,
    asked: Asked = PLAIN,
) -> Calibrations:
    """Calibrate a three-axis sensor from poses, or all that there are: calibrated = T K (reading + b).

    Parameters
    ----------
    recording : of poses
    sensor : "accel", "gyro", "mag" or "all"
    axes : form of T: "none" (the identity), "triangular" (axes not at right angles) or "full" (all six entries, of
        which a gyroscope's turns tell all, and norms three); default "none", of a gyroscope "full"
    gravity : norm at which the accelerometer's readings aim [m/s^2]; default: as declared, else 9.80665
    asked : how a command was typed, for the texts of the report; a script leaves it out

    Returns
    -------
    Calibrations; b in the sensor's unit (a magnetometer's readings are divided by their mean norm)

    Raises
    ------
    InputError : not of poses; none of the sensors can be calibrated

    Examples
    --------
    >>> import sinan
    >>> calibrations = sinan.calibrate(sinan.simulate("mag_poses", seed=7), "mag")
    >>> calibrations["mag"].K.shape
    (3,)
    """
    require_kind(recording, "poses", "calibrate", "`sinan estimate` or `sinan trace` (or --poses: turned by hand)")
    asked_for = sensors_asked_for(recording, None if sensor == ALL else sensor)
    done, left_out = of_each_sensor(recording, asked_for, lambda name: calibrate_sensor(recording, name, axes, gravity))
    several = len(sensors_in_poses(recording)) > 1
    for one in done.values():
        call = asked.call_of(recording, one.sensor if several and sensor != ALL else None)
        one.document["warnings"] = warnings_of(one.result, one.readings, call)
        one.document["window"] = asked.window
        one.document["notes"] = [] if one.readings is None else residual_notes(one.result, one.readings, call)
        if one.readings is not None:
            field_unit = recording.environment.field_unit
            one.document["read_in"] = field_unit if one.sensor == "mag" else one.readings.unit
    document = all_as_json(recording.name, done, left_out) if sensor == ALL else done[sensor].document
    return Calibrations(recording, done, left_out, document, asked)


def calibrate_sensor(recording: Recording, sensor: str, axes: str | None, gravity: float | None) -> Calibrated:
    """One sensor; T is the identity if nothing is said, a gyroscope's is full."""
    readings = None
    if sensor == "gyro":
        result: Calibration | GyroCalibration = calibrate_turns(recording, axes or "full", gravity)
    else:
        readings = without_declared(recording, triad_readings(recording, sensor, gravity))
        result = calibrate_triad(recording, readings, axes or "none")
        if sensor == "accel":
            unread = "; ".join(note for note in recording.notes if note.startswith(UNREAD))
            require_possible(result, readings.norm, f"{recording.where}{f' ({unread})' if unread else ''}")
    document = as_json(sensor, result)
    if readings is not None:
        document["unit"] = readings.unit
    document["declared_effects"] = list(declared_for(recording, sensor))
    return Calibrated(sensor, result, readings, document)


def all_as_json(name: str, done: Mapping[str, Calibrated], left_out: Mapping[str, str]) -> dict[str, Any]:
    """One document with a block a sensor."""
    return {
        "format": 1,
        "recording": name,
        "sensors": {sensor: one.document for sensor, one in done.items()},
        "left_out": [{"sensor": sensor, "why": why} for sensor, why in left_out.items()],
    }
