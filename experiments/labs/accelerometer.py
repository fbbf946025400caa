"""Basic experiment: an accelerometer in ten poses, T = I, g = 9.8 m/s^2."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sinan.experiments.labs.course_data import calibrated, numbers
from sinan.experiments.report.figures import norm_before_after
from sinan.experiments.report.page import Page

PRINTED = ((0.9912, 0.9974, 0.9947), (0.0168, 0.2691, 0.1253))  # K and b on the course's slides


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """Calibrate, compare with the printed values, draw the norms before and after."""
    readings, result = calibrated("AccRaw.mat", "accel", 9.8)
    say(f"K = diag({numbers(result.K)}), b = ({numbers(result.offset)})")
    say(f"printed: K = diag({numbers(PRINTED[0])}), b = ({numbers(PRINTED[1])})")
    page = Page(
        "Ten poses of an accelerometer",
        "At rest its reading has the length of gravity, whatever the pose: that fixes three scales and three offsets.",
    )
    page.numbers(
        [(f"{result.fit.sse_before:.3g}", "sum of squares before / (m/s²)²"), (f"{result.fit.sse:.3g}", "after")]
    )
    before = np.linalg.norm(readings.reading, axis=1)
    after = np.linalg.norm(result.apply(readings.reading), axis=1)
    page.figure(norm_before_after(before, after, 9.8, "m/s²"), "Norm of each reading; the line is gravity.")
    rows = [
        ["K (ratio)", numbers(result.K), numbers(PRINTED[0])],
        ["b / (m/s²)", numbers(result.offset), numbers(PRINTED[1])],
    ]
    page.table(["", "found", "printed in the course"], rows)
    page.write(out / "accelerometer.html")
