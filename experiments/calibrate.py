"""A sensor of a recording of poses -> T, K, b with their uncertainty; its words: `report.calibration_words`."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sinan.calibration.poses.evidence.poses import motion_seen
from sinan.calibration.poses.gyro import GyroCalibration, calibrate_gyro, read_turns
from sinan.calibration.poses.triad import Axes, Calibration, calibrate_norm
from sinan.estimator.evidence.term import Model, declared_model, effects_added, require_known
from sinan.experiments.residual_loop.open_source import (
    TriadReadings,
    declared_for,
    gravity_of,
    sensors_in_poses,
    triad_readings,
)
from sinan.sensors.arrays import FloatArray, finite_or_none
from sinan.sensors.covariates import covariates_for
from sinan.sensors.errors import InputError
from sinan.sensors.motion import Motion
from sinan.sensors.recording import ACCEL, GYRO, Recording

#: Declared effects are taken off until a pass changes nothing beyond this share of a reading: each gains two digits.
_SETTLED, _MOST_PASSES = 1e-9, 25
#: Readings, in equal steps, that show whether their directions are enough for a calibration.
_ENOUGH_TO_SEE = 500


@dataclass(frozen=True)
class Calibrated:
    """One sensor, calibrated.

    Attributes
    ----------
    readings : of an accelerometer or magnetometer, without what the recording declares; None of a gyroscope
    document : the JSON of its report
    """

    sensor: str
    result: Calibration | GyroCalibration
    readings: TriadReadings | None
    document: dict[str, object]

    @property
    def T(self) -> FloatArray:
        """(3, 3) axes; not a number where the data do not determine an entry."""
        return self.result.T

    @property
    def K(self) -> FloatArray:
        """(3,) scale."""
        return self.result.K

    @property
    def b(self) -> FloatArray:
        """(3,) offset, added to the reading; of a magnetometer to the reading over its mean norm."""
        return self.result.offset

    def apply(self, reading: FloatArray) -> FloatArray:
        """(n, 3) calibrated readings T K (reading + b), in the body's axes."""
        return self.result.apply(reading)


def calibrate_triad(recording: Recording, readings: TriadReadings, axes: str) -> Calibration:
    """Calibrate an accelerometer or magnetometer by the norm of its readings."""
    form: Axes = axes  # type: ignore[assignment]
    return calibrate_norm(
        readings.sensor,
        readings.reading,
        readings.norm,
        form,
        None if readings.sigma is None else float(np.sqrt(np.mean(readings.sigma**2))),
        normalised_by=readings.normalised_by,
        where=recording.where,
    )


def not_calibrated(recording: Recording) -> dict[str, InputError]:
    """The sensors in poses that a quick look already says cannot be calibrated, nor traced, each with the reason.

    Of an accelerometer and a magnetometer a part of the readings is fitted, and all where that does not pass; a
    gyroscope needs rests.
    """
    why = dict[str, InputError]()
    for sensor in sensors_in_poses(recording):
        try:
            readings = triad_readings(recording, "accel" if sensor == "gyro" else sensor)
            if sensor != "gyro" and not _passes(recording, _some_of(readings)):
                calibrate_triad(recording, readings, "none")
        except InputError as error:
            why[sensor] = error
    return why


def _some_of(readings: TriadReadings) -> TriadReadings:
    """Every so many readings, `_ENOUGH_TO_SEE` at most."""
    step = -(-len(readings.t) // _ENOUGH_TO_SEE)
    sigma = None if readings.sigma is None else readings.sigma[::step]
    return replace(readings, t=readings.t[::step], reading=readings.reading[::step], sigma=sigma)


def _passes(recording: Recording, readings: TriadReadings) -> bool:
    """Whether a triad can be calibrated by these readings."""
    try:
        calibrate_triad(recording, readings, "none")
    except InputError:
        return False
    return True


def calibrate_turns(recording: Recording, axes: str, gravity: float | None) -> GyroCalibration:
    """Calibrate a gyroscope by turns between static poses."""
    imu = recording.streams["imu"]
    g = gravity_of(recording, gravity)
    declared = declared_model(declared_for(recording, "gyro"))
    covariates = covariates_for(recording, "gyro", imu.t)
    reading = imu.array(GYRO)
    for _ in range(_MOST_PASSES):
        log = read_turns(
            imu.t,
            imu.array(ACCEL),
            reading,
            g,
            recording.spec("gyro").noise_density,
            recording.spec("accel").noise_density,
            recording.where,
        )
        result = calibrate_gyro(log, axes, recording.where)
        motion = Motion(t=imu.t, w_ib_b=result.apply(reading), f_b=log.f_b, covariates=covariates)
        require_known(declared, motion, recording.where)
        change = imu.array(GYRO) - effects_added(declared, motion.w_ib_b, motion) - reading
        if np.max(np.abs(change)) < _SETTLED * np.max(np.abs(reading)):
            return result
        reading = reading + change
    raise _too_large(recording, declared)


def without_declared(recording: Recording, readings: TriadReadings) -> TriadReadings:
    """The readings with the declared effects taken off, as the plain calibration at hand sees the true ones.

    reading - effects(u) = M u + b,  u = K (reading - effects(u) + offset), by repetition

    Raises
    ------
    InputError : an effect needs what the recording does not have, or is too large to be taken off
    """
    declared = declared_model(declared_for(recording, readings.sensor, readings.normalised_by))
    if not declared:
        return readings
    plain = readings
    for _ in range(_MOST_PASSES):
        fit = calibrate_triad(recording, plain, "none")
        u = (plain.reading + fit.offset) * fit.K
        motion = motion_seen(readings.sensor, readings.t, u, readings.covariates)
        require_known(declared, motion, recording.where)
        change = readings.reading - effects_added(declared, u, motion) - plain.reading
        plain = replace(plain, reading=plain.reading + change)
        if np.max(np.abs(change)) < _SETTLED * readings.norm:
            return plain
    raise _too_large(recording, declared)


def _too_large(recording: Recording, declared: Model) -> InputError:
    names = ", ".join(term.name for term in declared)
    found = f"{names} declared, too large to be taken off"
    return InputError(recording.where, found, "effects smaller than the reading")


def as_json(sensor: str, result: Calibration | GyroCalibration) -> dict[str, object]:
    """The calibration as the JSON of the report; what the data do not determine is null."""
    std = result.std()
    # directions of specific force are scaled to g: over g, their residuals are angles
    unit = 1.0 if isinstance(result, Calibration) else result.log.gravity**2
    document: dict[str, object] = {
        "format": 1,
        "sensor": sensor,
        "unit": {"accel": "m/s^2", "gyro": "rad/s", "mag": "1"}[sensor],
        "T": _plain(result.T),
        "K": _plain(result.K),
        "b": _plain(result.offset),
        "normalised_by": result.normalised_by if isinstance(result, Calibration) else 1.0,
        "std": {name: _plain(value) for name, value in std.items()},
        "n": result.n if isinstance(result, Calibration) else len(result.log.poses),
        "sse_before": (result.fit.sse_before if isinstance(result, Calibration) else result.sse_before) / unit,
        "sse": (result.fit.sse if isinstance(result, Calibration) else result.sse) / unit,
        "undetermined": list(result.undetermined),
        "singular_values": _plain(result.fit.singular_values),
    }
    if isinstance(result, Calibration) and np.any(np.isnan(result.T)):
        document["T_without_rotation"] = _plain(result.T_seen)
    return document


def _plain(values: FloatArray) -> object:
    """Nested lists with null for what is not finite."""
    if values.ndim > 0:
        return [_plain(row) for row in values]
    return finite_or_none(float(values))
