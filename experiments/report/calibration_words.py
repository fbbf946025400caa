"""A calibration in words: what came out, and what speaks against it."""

from __future__ import annotations

import numpy as np

from sinan.calibration.poses.gyro import GyroCalibration
from sinan.calibration.poses.triad import Calibration
from sinan.estimator.evidence.whiteness import whiteness
from sinan.experiments.report.words import counted, stream_unit
from sinan.experiments.residual_loop.open_source import TriadReadings

#: Residuals beyond so many times their noise are remarked upon (a declared noise is rarely known to a fifth), and so
#: are residuals that a test of whiteness calls noise in fewer than so many cases.
_TOO_LARGE, _NO_NOISE = 1.2, 1e-3


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
