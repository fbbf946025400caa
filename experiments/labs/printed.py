"""The lecture's printed T, K and b, held against the data that the course gives."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sinan.calibration.poses.reference import small_rotation
from sinan.experiments.datasets import resolve
from sinan.experiments.labs.course_data import calibrated
from sinan.experiments.labs.iterations import gyro_distance
from sinan.experiments.report.lab_figures import Panel, panels
from sinan.experiments.report.page import Page
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import ACCEL, GYRO

#: of T its angles psi, theta, phi [rad]; K; b
ACCELEROMETER = ((0.0093, 0.0136, 0.0265), (1.0203, 1.0201, 1.0201), (-2.755e-5, 1.565e-5, -9.942e-5))
MAGNETOMETER = ((-0.0026, -0.0516, -0.0156), (0.9999, 1.0, 0.9999), (-0.3223e-5, -0.1280e-5, 0.1589e-5))
GYROSCOPE = ((0.1001, 0.1090, 0.1002), (1.0, 1.0, 1.0), (0.2001e-3, 0.2002e-3, 0.2004e-3))
Printed = tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]


def applied(printed: Printed, readings: FloatArray) -> FloatArray:
    """(n, 3) T K (reading + b)."""
    angles, K, b = (np.array(part) for part in printed)
    return np.asarray((readings + b) * K @ small_rotation(angles).T)


def index(v: FloatArray, norm: float) -> float:
    """The course's index: sum of (|v| - norm)^2."""
    return float(np.sum((np.linalg.norm(v, axis=1) - norm) ** 2))


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """The index of the readings as they are, with what is printed, with the same without T, and at the minimum."""
    rows, shown = [], []
    for name, file, norm, printed in (
        ("accelerometer", "AccRaw.mat", 9.8, ACCELEROMETER),
        ("magnetometer", "MagRaw.mat", 1.0, MAGNETOMETER),
    ):
        readings, best = calibrated(file, "accel" if norm > 2.0 else "mag", 9.8 if norm > 2.0 else None)
        r = readings.reading
        straight = ((0.0, 0.0, 0.0), *printed[1:])
        values = index(r, norm), index(applied(printed, r), norm), index(applied(straight, r), norm), best.fit.sse
        rows.append([name, *(f"{v:.4g}" for v in values)])
        say(
            f"{name}: index {values[0]:.4g} raw, {values[1]:.4g} printed, {values[2]:.4g} without T, "
            f"{values[3]:.4g} least"
        )
        norms = {"raw": r, "printed": applied(printed, r)}
        n = np.arange(len(r))
        least = np.linalg.norm((r + best.offset) * best.K, axis=1)
        shown.append(
            Panel(
                "reading",
                f"norm, {name}",
                {"known": (n, np.full(len(r), norm))},
                {k: (n, np.linalg.norm(v, axis=1)) for k, v in norms.items()} | {"least squares": (n, least)},
            )
        )
    imu = resolve("rfly_course/e4_A.bin").streams["imu"]
    t, f, w = imu.t, imu.array(ACCEL), imu.array(GYRO)
    gyro = [float(np.sum(gyro_distance(t, f, x) ** 2)) for x in (w, applied(GYROSCOPE, w))]
    rows.append(["gyroscope", f"{gyro[0]:.4g}", f"{gyro[1]:.4g}", "", ""])
    say(f"gyroscope: index {gyro[0]:.4g} raw, {gyro[1]:.4g} printed")
    page = Page(
        "The lecture's printed T, K and b",
        "The readings behind them are not given. Held against the readings that the course does give, they calibrate "
        "none of them: each board has its own T, K and b, and norms do not tell T at all.",
    )
    page.table(["sum of squares", "raw", "printed", "printed, T = I", "least"], rows, (1, 2, 3, 4))
    page.figure(panels(shown), "Norms of the course's readings, as they are and with the printed numbers.")
    page.text(
        "Why they look as they do is a guess: scales of 1, offsets of 1e-5 and angles of the gyroscope of 0.1 all "
        "round are what a solver begins with. An antisymmetric T changes a norm in second order only, so "
        "a solver has no "
        "reason to leave its start: `sinan lab three_angles`."
    )
    page.write(out / "printed.html")
