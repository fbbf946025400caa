"""Figures 7.5, 7.8 and 7.11, and the index against the iterations of Levenberg and Marquardt."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sinan.calibration.poses.triad import norm_jacobian, norm_residual
from sinan.experiments.datasets import resolve
from sinan.experiments.labs.course_data import calibrated
from sinan.experiments.report.lab_figures import Panel, panels
from sinan.experiments.report.page import Page
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import ACCEL, GYRO
from sinan.sensors.rotation import quaternion_conjugate, quaternion_multiply, rotate_back, turned_since_start

STARTS = {
    "AccRaw.mat": np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1]),
    "MagRaw.mat": np.array([1.0, 1.0, 1.0, 0.01, 0.01, 0.01]),
}
SENSORS = {"accel": "accelerometer", "mag": "magnetometer"}
STEPS = 12
SPAN, EVERY = 250, 25  # samples between two directions of the gyroscope's index, 1 s, and between two such pairs


def marquardt(
    residual: Callable[[FloatArray], FloatArray],
    jacobian: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    steps: int = STEPS,
    damping: float = 1e-2,
) -> tuple[FloatArray, FloatArray]:
    """Levenberg and Marquardt's method, each step shown: x -> x - (J'J + damping diag(J'J))^-1 J' r.

    A step that lowers the index is taken and the damping divided by ten; else it is multiplied by ten and x stays.

    Returns
    -------
    (parameters,) the last x; (steps + 1,) the index before each step and after the last
    """
    x, r = start.copy(), residual(start)
    index = [float(r @ r)]
    for _ in range(steps):
        J = jacobian(x)
        A = J.T @ J
        tried = x - np.linalg.solve(A + damping * np.diag(np.diag(A)), J.T @ r)
        r_tried = residual(tried)
        if r_tried @ r_tried < r @ r:
            x, r, damping = tried, r_tried, damping / 10.0
        else:
            damping *= 10.0
        index.append(float(r @ r))
    return x, np.array(index)


def gyro_distance(t: FloatArray, f: FloatArray, w: FloatArray) -> FloatArray:
    """(k,) |h_g - a| [m/s^2]: the direction that the rates carry from one instant to the next, against the reading.

    Parameters
    ----------
    t, f, w : (n,) s, (n, 3) m/s^2, (n, 3) rad/s; only instants at which |f| is within 3 % of gravity are compared
    """
    q = turned_since_start(t, w)
    rows = np.arange(0, len(t) - SPAN, EVERY)
    norm = np.linalg.norm(f, axis=1)
    plumb = np.abs(norm / 9.8 - 1.0) < 0.03
    rows = rows[plumb[rows] & plumb[rows + SPAN]]
    turned = quaternion_multiply(quaternion_conjugate(q[rows]), q[rows + SPAN])
    return np.asarray(np.linalg.norm(rotate_back(turned, f[rows]) - f[rows + SPAN], axis=1))


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """The three figures of the lecture on the course's data, and the two of the lab."""
    accel, accel_index = before_and_after("7.5", "accel", "AccRaw.mat", 9.8, say)
    mag, mag_index = before_and_after("7.11", "mag", "MagRaw.mat", 1.0, say)
    k = np.arange(STEPS + 1)
    index = Panel(
        "iteration",
        "index",
        {"AccRaw.mat": (k, accel_index), "MagRaw.mat": (k, mag_index)},
        title="the lab's two figures",
        logarithmic="y",
    )
    page = Page(
        "Errors before and after, and how fast the index falls",
        "The lecture's figures 7.5, 7.8 and 7.11 show the index of every reading before and after; the lab's show the "
        "index over the iterations. Here are all of them, from the course's own readings.",
    )
    page.figure(
        panels([accel, mag, gyro_before_and_after(say), index]),
        "Dist of each reading, and the index over the iterations.",
    )
    page.text(
        "The autopilot had taken the gyroscope's bias out before it wrote the log; to have something to calibrate, "
        "3 deg/s are put back on every axis, and the rest at the beginning finds them. Its scale and T: "
        "`sinan calibrate gyro`."
    )
    page.write(out / "iterations.html")


def before_and_after(
    number: str, sensor: str, file: str, norm: float, say: Callable[[str], None]
) -> tuple[Panel, FloatArray]:
    """The index of each reading before and after a calibration by the norm; the sum after each iteration."""
    readings, best = calibrated(file, sensor, norm if sensor == "accel" else None)
    r = readings.reading
    x, index = marquardt(lambda x: norm_residual(x, r, norm), lambda x: norm_jacobian(x, r), STARTS[file])
    say(
        f"{file}: index {index[0]:.4g} at the start, {index[3]:.4g} after three iterations, "
        f"{index[-1]:.4g} at the end; off the minimum by {np.max(np.abs(x[:6] - best.fit.x[:6])):.0e}"
    )
    plain = norm_residual(np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]), r, norm) ** 2
    n = np.arange(len(r))
    curves = {"before": (n, plain), "after": (n, norm_residual(x, r, norm) ** 2)}
    return Panel("reading", "Dist", {}, curves, f"figure {number}: {SENSORS[sensor]}", "y"), index


def gyro_before_and_after(say: Callable[[str], None]) -> Panel:
    """Figure 7.8: with 3 deg/s put onto every axis, and with the bias that the rest at the beginning shows."""
    imu = resolve("rfly_course/e4_A.bin").streams["imu"]
    t, f, w = imu.t, imu.array(ACCEL), imu.array(GYRO)
    biased = w + np.deg2rad(3.0)
    bias = np.mean(biased[t < 0.5], axis=0)
    raw, mended = gyro_distance(t, f, biased) ** 2, gyro_distance(t, f, biased - bias) ** 2
    say(
        f"figure 7.8, with 3 deg/s put onto every axis: median Dist {np.median(raw):.3g} before, "
        f"{np.median(mended):.3g} after"
    )
    n = np.arange(len(raw))
    curves = {"before": (n, raw), "after": (n, mended)}
    return Panel("pair of instants", "Dist_g / (m/s²)²", {}, curves, "figure 7.8: gyroscope, 3 deg/s put on", "y")
