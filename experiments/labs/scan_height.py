"""Height from a laser scan: the course's mean of rho cos(phi) is exact only without roll in the scan's plane."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sinan.experiments.labs.course_flight import flown, rms
from sinan.experiments.report.figures import lines
from sinan.experiments.report.page import Page
from sinan.sensors.arrays import FloatArray
from sinan.sensors.laser import (
    Laser,
    course_scan_error,
    ground_points,
    scan_height,
    scan_range_of_the_course,
    slant_from_height,
)
from sinan.sensors.motion import Motion
from sinan.sensors.ranging import tilt_compensated_height
from sinan.sensors.rotation import quaternion_from_rpy

HEIGHT, PITCH = 10.0, 0.1  # m, rad
HALF_WIDTHS = (10.0, 20.0, 30.0, 40.0)  # deg
FLOWN = np.deg2rad(np.linspace(-20.0, 20.0, 9))  # of the scan that is flown


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """Error of the course's mean over roll for several widths of the scan, and of both heights in a flight."""
    roll = np.deg2rad(np.linspace(-20.0, 20.0, 81))
    body = hanging(roll)
    curves, worst = {}, 0.0
    for width in HALF_WIDTHS:
        angles = np.deg2rad(np.linspace(-width, width, 61))
        ranges = Laser(1.0, angles=angles).predict(body)
        relative = scan_range_of_the_course(ranges, angles) / slant_from_height(body) - 1.0
        exact = scan_height(ranges, angles, roll, np.full(len(roll), PITCH))
        worst = max(
            worst,
            float(np.max(np.abs(relative - course_scan_error(angles, roll)))),
            float(np.max(np.abs(exact / HEIGHT - 1.0))),
        )
        curves[f"scan ±{width:.0f} deg"] = 100.0 * relative
    too_long = curves["scan ±30 deg"][-1]
    say(f"formulas and simulated beams agree to {worst:.0e}; 20 deg of roll, a ±30 deg scan: {too_long:.1f} % too long")
    errors, level = flight()
    for name, error in errors.items():
        say(f"{name}: {error:.3f} m RMS in a flight")
    page = Page(
        "Height from a scan",
        "A laser sweeps from side to side: the beam at angle φ returns the range ρ. The course takes mean(ρ cos φ) for "
        "the range straight down in the body; over flat ground that holds without roll alone. With every beam taken at "
        "its own angle to the vertical, roll minus φ, the height is exact.",
    )
    page.figure(
        lines(np.rad2deg(roll), curves, "roll / deg", "error of the mean / %"),
        "How much too long the course's mean is, over roll, for scans of several widths; pitch makes no such error, "
        "and the least-squares height of all beams has none.",
    )
    page.heading("In a flight with noise")
    page.table(["height from", "RMS error / m"], [[name, f"{error:.3f}"] for name, error in errors.items()], (1,))
    page.text(f"The ground that the beams touch is flat to {level:.3f} m RMS, which is their noise across it.")
    page.write(out / "scan_height.html")


def hanging(roll: FloatArray) -> Motion:
    """A body at `HEIGHT` with these rolls (n,) [rad] and one pitch."""
    rpy = np.stack([roll, np.full(len(roll), PITCH), np.zeros(len(roll))], axis=1)
    p_n = np.tile([0.0, 0.0, -HEIGHT], (len(roll), 1))
    return Motion(np.arange(float(len(roll))), p_n, q_nb=quaternion_from_rpy(rpy))


def flight() -> tuple[dict[str, float], float]:
    """RMS error [m] of the heights of a simulated flight, by formula; RMS of the touched points about the ground."""
    scan, motion, rpy = flown("aerobatics", "laser", FLOWN)
    ranges, (roll, pitch, _) = scan.array([f"range_{i}" for i in range(len(FLOWN))]), rpy.T
    mean = scan_range_of_the_course(ranges, FLOWN)
    mended = mean / (1.0 + course_scan_error(FLOWN, roll))
    heights = {
        "the course's mean": tilt_compensated_height(mean, roll, pitch),
        "the same less its known error": tilt_compensated_height(mended, roll, pitch),
        "all beams by least squares": scan_height(ranges, FLOWN, roll, pitch),
    }
    touched = ground_points(motion, ranges, FLOWN)[..., 2] - motion.ground_down
    return {name: rms(height - motion.height) for name, height in heights.items()}, rms(touched)
