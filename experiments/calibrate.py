"""A sensor of a recording of poses -> T, K, b with their uncertainty, and what speaks against them, in words."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sinan.calibration.poses.gyro import GyroCalibration, calibrate_gyro, read_turns
from sinan.calibration.poses.triad import Axes, Calibration, calibrate_norm
from sinan.estimator.evidence.whiteness import whiteness
from sinan.experiments.report.words import counted, stream_unit
from sinan.experiments.residual_loop.open_source import TriadReadings, declared_for, gravity_of
from sinan.experiments.residual_loop.poses import motion_seen
from sinan.experiments.residual_loop.term import Model, declared_terms, effects_added, require_known
from sinan.sensors.arrays import FloatArray, finite_or_none
from sinan.sensors.covariates import covariates_for
from sinan.sensors.errors import InputError
from sinan.sensors.motion import Motion
from sinan.sensors.recording import ACCEL, GYRO, Recording

#: Declared effects are taken off until a pass changes nothing beyond this share of a reading: each gains two digits.
_SETTLED, _MOST_PASSES = 1e-9, 25
#: Residuals beyond so many times their noise are remarked upon (a declared noise is rarely known to a fifth), and so
#: are residuals that a test of whiteness calls noise in fewer than so many cases.
_TOO_LARGE, _NO_NOISE = 1.2, 1e-3


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


def calibrate_turns(recording: Recording, axes: str, gravity: float | None) -> GyroCalibration:
    """Calibrate a gyroscope by turns between static poses."""
    imu = recording.streams["imu"]
    g = gravity_of(recording, gravity)
    declared = declared_terms(declared_for(recording, "gyro"))
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
    declared = declared_terms(declared_for(recording, readings.sensor, readings.normalised_by))
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


def warnings_of(
    result: Calibration | GyroCalibration, readings: TriadReadings | None, call: str = "sinan trace INPUT"
) -> list[str]:
    """What speaks against the model, a sentence each: a residual above its noise, or one that is no noise.

    Parameters
    ----------
    readings : of an accelerometer or magnetometer; None: a gyroscope, whose turns are weighted by their scatter
    call : the command that looks for what is missing
    """
    declared = readings is None or readings.sigma is not None
    doubt = ", or the noise is not as declared" if declared else ""
    what_next = f"the model lacks something{doubt}: `{call}` looks for it"
    if isinstance(result, GyroCalibration) or readings is None:
        ratio = float(np.max(result.weights)) if isinstance(result, GyroCalibration) else 1.0
        return [f"the residual is {ratio:.1f} times its noise: {what_next}"] if ratio > _TOO_LARGE else []
    fit, found = result.fit, []
    freedom = len(fit.residual) - int(np.sum(np.isfinite(fit.std)))
    if readings.sigma is not None and freedom > 0 and fit.sigma > 0.0:
        ratio = float(np.sqrt(fit.sse / freedom)) / fit.sigma
        if ratio > _TOO_LARGE + 3.0 / np.sqrt(2.0 * freedom):  # three sigma of the ratio itself
            rms = np.sqrt(fit.sse / len(fit.residual))
            size = f"{rms:.3g} {stream_unit(readings.sensor, readings.unit)} RMS"
            found.append(f"the residual, {size}, is {ratio:.1f} times what the declared noise leaves: {what_next}")
    colour = whiteness(fit.residual[np.argsort(readings.t, kind="stable")][:, None])
    if not found and colour is not None and colour[1] < _NO_NOISE:
        found.append(f"neighbouring residuals are correlated ({colour[0]:.2g}), as noise never is: {what_next}")
    return found


def residual_notes(result: Calibration | GyroCalibration, readings: TriadReadings, call: str) -> list[str]:
    """How large the residual is where nothing says how large it should be.

    Parameters
    ----------
    call : the command that tests the residual
    """
    if readings.sigma is not None:
        return []
    rms = float(np.sqrt(np.mean(np.square(result.fit.residual))))
    size = f"{rms:.3g} {stream_unit(readings.sensor, readings.unit)}".strip()
    return [f"residual {size} RMS; no noise is declared to judge it by: `{call}` tests it"]


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


def _squared(sensor: str) -> str:
    """Unit of the sum of squares, of the norm's residuals or of the angles that turns miss; none for a field."""
    return {"mag": "", "gyro": " rad^2"}.get(sensor, " (m/s^2)^2")


def summary(sensor: str, document: dict[str, object]) -> str:
    """The result in a few lines."""

    def numbers(values: object) -> str:
        return "  ".join("  undetermined" if v is None else f"{v:+10.4f}" for v in values)  # type: ignore[attr-defined]

    T: list[object] = document["T"]  # type: ignore[assignment]
    n: int = document["n"]  # type: ignore[assignment]
    lines = [
        f"{sensor}: calibrated = T K (reading + b), {counted(n, 'static pose' if sensor == 'gyro' else 'reading')}",
        *(f"  T  {numbers(row)}" for row in T),
        f"  K  {numbers(document['K'])}",
        f"  b  {numbers(document['b'])}  {stream_unit(sensor, str(document['unit']))}",
        f"  sum of squared residuals {document['sse_before']:.4g} -> {document['sse']:.4g}{_squared(sensor)}",
    ]
    if document["normalised_by"] != 1.0:
        norm = f"{document['normalised_by']:.6g} {document.get('read_in') or '(in the unit of the log)'}"
        lines.append(f"  readings divided by their mean norm {norm}")
    lines += [f"  {sentence}" for sentence in document["undetermined"]]  # type: ignore[attr-defined]
    lines += [f"  note: {sentence}" for sentence in document.get("notes", [])]  # type: ignore[attr-defined]
    lines += [f"  warning: {sentence}" for sentence in document.get("warnings", [])]  # type: ignore[attr-defined]
    return "\n".join(lines)
