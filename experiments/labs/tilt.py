"""Figure 7.2: tilt from the accelerometer has no drift, tilt from the integrated gyroscope has no disturbance."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sinan.experiments.datasets import resolve
from sinan.experiments.labs.course_flight import rms
from sinan.experiments.report.lab_figures import Panel, panels
from sinan.experiments.report.page import Page
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import ACCEL, GYRO
from sinan.sensors.rotation import quaternion_from_rpy, quaternion_multiply, rpy_from_quaternion, turned_since_start

LOG = "rfly_course/e4_A.bin"
START = 0.5  # s at rest at the beginning


def tilt_of_gravity(f: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n,) roll and pitch [rad] of a body at rest whose accelerometer reads f (n, 3): f = -C_bn g."""
    x, y, z = f.T
    return np.arctan2(-y, -z), np.arctan2(x, np.hypot(y, z))


def tilt_of_rates(t: FloatArray, w: FloatArray, roll: float, pitch: float) -> tuple[FloatArray, FloatArray]:
    """(n,) roll and pitch [rad] from rates w (n, 3) [rad/s] alone, from a known tilt on."""
    start = quaternion_from_rpy(np.array([[roll, pitch, 0.0]]))
    rpy = rpy_from_quaternion(quaternion_multiply(start, turned_since_start(t, w)))
    return rpy[:, 0], rpy[:, 1]


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """An autopilot turned by hand: two tilts and that of its own filter; then with a bias of the gyroscope."""
    recording = resolve(LOG)
    imu = recording.streams["imu"]
    t, f, w = imu.t, imu.array(ACCEL), imu.array(GYRO)
    assert recording.truth is not None
    pilot = np.interp(t, recording.truth.stream.t, np.rad2deg(recording.truth.stream["pitch"]))
    roll, pitch = tilt_of_gravity(f)
    first = float(np.mean(roll[t < START])), float(np.mean(pitch[t < START]))
    w = w - np.mean(w[t < START], axis=0)
    good = np.rad2deg(tilt_of_rates(t, w, *first)[1])
    worn = np.rad2deg(tilt_of_rates(t, w + np.deg2rad([0.0, 1.0, 0.0]), *first)[1])
    slow = np.rad2deg(pitch)
    still = np.abs(np.linalg.norm(f, axis=1) - 9.8) < 0.3
    end = t > t[-1] - 0.5
    say(
        f"accelerometer against the autopilot's own filter: {rms((slow - pilot)[still]):.1f} deg RMS where |f| is that "
        f"of gravity, {rms((slow - pilot)[~still]):.1f} deg elsewhere"
    )
    say(
        f"at the end: gyroscope {np.mean((good - slow)[end]):+.1f} deg off the accelerometer, with 1 "
        f"deg/s more of bias "
        f"{np.mean((worn - slow)[end]):+.1f} deg; the accelerometer knows no time"
    )
    page = Page(
        "Two ways to know a tilt",
        "Gravity tells roll and pitch at every instant anew, as long as nothing but gravity acts. A gyroscope adds up "
        "rates: nothing disturbs it, and whatever its bias is grows with time. An estimator takes both.",
    )
    figure = panels(
        [
            Panel(
                "time / s",
                "pitch / deg",
                {
                    "known to the autopilot's filter": (t, pilot),
                    "accelerometer": (t, slow),
                    "gyroscope": (t, good),
                    "gyroscope + 1 deg/s": (t, worn),
                },
            ),
            Panel(
                "time / s",
                "accelerometer - filter / deg",
                {
                    "pushed": (t, np.where(still, np.nan, slow - pilot)),
                    "|f| within 0.3 m/s² of g": (t, np.where(still, slow - pilot, np.nan)),
                },
            ),
        ],
        1,
        2.8,
    )
    page.figure(figure, "An autopilot turned by hand (the course's data). Grey is its own estimate, not a truth.")
    page.write(out / "tilt.html")
