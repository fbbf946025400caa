"""Height from a laser scan: the course's mean of rho cos(phi) is exact only without roll in the scan's plane."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from experiments.report.figures import lines
from experiments.report.page import Page
from sensors.laser import course_scan_error, scan_height, scan_range_of_the_course

HEIGHT, PITCH = 10.0, 0.1  # m, rad
HALF_WIDTHS = (10.0, 20.0, 30.0, 40.0)  # deg


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """Error of the course's mean over roll for several widths of the scan, and the exact formula beside it."""
    roll = np.deg2rad(np.linspace(-20.0, 20.0, 81))
    curves, worst = {}, 0.0
    for width in HALF_WIDTHS:
        angles = np.deg2rad(np.linspace(-width, width, 61))
        ranges = HEIGHT / (np.cos(PITCH) * np.cos(roll[:, None] + angles))
        slant = HEIGHT / (np.cos(PITCH) * np.cos(roll))
        relative = scan_range_of_the_course(ranges, angles) / slant - 1.0
        worst = max(worst, float(np.max(np.abs(relative - course_scan_error(angles, roll)))))
        exact = scan_height(ranges, angles, roll, np.full(len(roll), PITCH))
        worst = max(worst, float(np.max(np.abs(exact / HEIGHT - 1.0))))
        curves[f"scan ±{width:.0f} deg"] = 100.0 * relative
    too_long = curves["scan ±30 deg"][-1]
    say(f"formula and simulation agree to {worst:.0e}; 20 deg of roll, a ±30 deg scan: {too_long:.1f} % too long")
    page = Page(
        "Height from a scan",
        "A laser sweeps from side to side: the beam at angle φ returns the range ρ. The course takes mean(ρ cos φ) for "
        "the range straight down in the body; over flat ground that holds without roll alone. With every beam taken at "
        "its own angle to the vertical, φ plus roll, the height is exact.",
    )
    figure = lines(np.rad2deg(roll), curves, "roll / deg", "error of the mean / %")
    caption = (
        "How much too long the course's mean is, over roll, for scans of several widths; pitch makes no such error, "
        "and the least-squares height of all beams has none."
    )
    page.figure(figure, caption)
    page.write(out / "scan_height.html")
