"""Calibration against an external reference, an attitude that the log gives, and self-calibration by the norm."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sinan.calibration.poses.reference import ReferenceCalibration, calibrate_by_attitude, three_angles
from sinan.calibration.poses.triad import calibrate_norm
from sinan.experiments.datasets import resolve
from sinan.experiments.report.lab_figures import Panel, panels
from sinan.experiments.report.page import Page
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.recording import MAG, QUATERNION
from sinan.sensors.rotation import quaternion_interpolate, rotate

#: data set -> part that is looked at [s]; before it the last one was carried over the ground
LOGS = {
    "robot_arm_marg/eV50p/Sequencia1/MPU9150.mat": (0.0, np.inf),
    "px4_quad_64a": (0.0, np.inf),
    "px4_vio_quad": (212.0, 305.0),
}
KNOWN = 0.1  # 1-sigma of an entry of T [rad] beyond which it is not known


def with_attitude(name: str) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Readings (n, 3) of a log's compass, divided by their mean norm; attitude (n, 4); current (n,) [A] or None."""
    recording = resolve(name)
    mag, power, (begin, end) = recording.streams["mag"], recording.streams.get("power"), LOGS[name]
    assert recording.truth is not None
    truth = recording.truth.stream
    for other in (truth,) if power is None else (truth, power):
        begin, end = max(other.t[0], begin), min(other.t[-1], end)
    keep = (mag.t >= begin) & (mag.t <= end)
    t, reading = mag.t[keep], mag.array(MAG)[keep]
    q = quaternion_interpolate(t, truth.t, truth.array(QUATERNION))
    current = None if power is None else np.interp(t, power.t, power["current"])
    return reading / np.mean(np.linalg.norm(reading, axis=1)), q, current


def held_out(reading: FloatArray, q: FloatArray, current: FloatArray | None) -> tuple[float, float]:
    """RMS of the field in the reference's frame about its mean [of its norm] in a second half, by a calibration of the
    first half: as it is, and calibrated.
    """
    half = len(reading) // 2
    before, later = (None, None) if current is None else (current[:half], current[half:])
    fit = calibrate_by_attitude(reading[:half], q[:half], 1.0, before)
    fields = rotate(q[half:], reading[half:]), rotate(q[half:], fit.apply(reading[half:], later))
    raw, mended = (float(np.sqrt(np.mean(np.sum((v - v.mean(axis=0)) ** 2, axis=1)))) for v in fields)
    return raw, mended


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """T, K, b, current and field's direction of three logs by their attitude; what the norm alone says of them."""
    page = Page(
        "Self-calibration, and an external reference",
        "A norm needs readings all round the sphere, and tells nothing of a rotation. With the attitude that "
        "something else knows, fewer directions are enough, and T comes out whole, with the mounting in it.",
    )
    shown = []
    for name in LOGS:
        reading, q, current = with_attitude(name)
        fit = calibrate_by_attitude(reading, q, 1.0, current)
        angles, _ = three_angles(fit.T)
        worst = float(np.max(fit.fit.std[6:12]))
        raw, mended = held_out(reading, q, current) if worst < KNOWN else (np.nan, np.nan)
        try:
            calibrate_norm("mag", reading[:: max(len(reading) // 500, 1)], 1.0, "triangular")
            alone = "the norm alone fits"
        except InputError as error:
            alone = f"the norm alone: {error.found}"
        outcome = (
            f"T's angles {', '.join(f'{a:+.1f}' for a in np.rad2deg(angles))} deg"
            if worst < KNOWN
            else "T is not known"
        )
        say(f"{name}: {outcome}, 1 sigma of an entry up to {worst:.2g}; {alone}")
        if worst < KNOWN:
            say(
                f"{name}: field of the second half by the first half's calibration, {raw:.3f} -> "
                f"{mended:.3f} of its norm"
            )
        page.heading(name)
        page.table(["", "x", "y", "z"], _rows(fit), (1, 2, 3))
        predicted = f"Second half, calibrated by the first: scatter of the field {raw:.3f} → {mended:.3f}. "
        page.text((predicted if worst < KNOWN else "T is not known. ") + f"{_upper(alone)}.")
        field, better = rotate(q, reading), rotate(q, fit.apply(reading, current))
        n = slice(None, None, max(len(reading) // 600, 1))
        shown.append(
            Panel(
                "north (of the reference) / norm",
                "east / norm",
                {},
                {"as it is": (field[n, 0], field[n, 1]), "calibrated": (better[n, 0], better[n, 1])},
                name.split("/")[0],
            )
        )
    page.figure(
        panels(shown, 3), "Horizontal field in the reference's frame: a good calibration makes one point of it."
    )
    page.text(
        "The robot knows its pose: the raw compass on it is calibrated on what it had not seen. The "
        "attitude of `px4_quad_64a` is the autopilot's own, whose heading comes from this compass in "
        "part: its T is what "
        "the autopilot believes, not a truth. That of `px4_vio_quad` comes from cameras; its flight "
        "turns by 27 deg and "
        "leans by 17, its field is disturbed, and its T is not known: sigmas larger than 0.1 say so."
    )
    page.write(out / "reference.html")


def _rows(fit: ReferenceCalibration) -> list[list[str]]:
    std, x = fit.fit.std, fit.fit.x
    angles, _ = three_angles(fit.T)
    known = np.max(std[6:12]) < KNOWN
    rows = [["T's Δφ, Δθ, Δψ / rad", *(f"{a:+.3f}" if known else "not known" for a in angles[::-1])]]
    rows += [
        [label, *(f"{x[k]:.3f} ± {std[k]:.3f}" for k in range(i, i + 3))] for label, i in (("K", 0), ("b / norm", 3))
    ]
    rows.append(["T's xy, xz, yx", *(f"{x[k]:.3f} ± {std[k]:.3f}" for k in range(6, 9))])
    rows.append(["T's yz, zx, zy", *(f"{x[k]:.3f} ± {std[k]:.3f}" for k in range(9, 12))])
    if len(x) > 14:
        rows.append(["current / (norm/A)", *(f"{x[k]:.5f} ± {std[k]:.5f}" for k in range(14, 17))])
    return rows


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]
