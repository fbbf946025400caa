"""Design experiment: a magnetometer turned on six faces, T = I, and the sign that the data decide."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from sinan.calibration.poses.triad import norm_residual
from sinan.experiments.labs.course_data import calibrated, numbers
from sinan.experiments.report.figures import norm_before_after
from sinan.experiments.report.page import Page
from sinan.sensors.arrays import FloatArray

PRINTED = (0.9853, 1.0202, 1.0004, -0.1448, -0.0334, -0.0898)  # K and b on the course's slides


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """Calibrate; compare the printed solution, and the one with the other sign of b_z, with the minimum."""
    readings, result = calibrated("MagRaw.mat", "mag")
    other = (*PRINTED[:5], -PRINTED[5])
    costs = [float(np.sum(norm_residual(np.array(x), readings.reading, 1.0) ** 2)) for x in (PRINTED, other)]
    say(f"K = diag({numbers(result.K)}), b = ({numbers(result.offset)}), sum of squares {result.fit.sse:.3f}")
    say(f"b_z = -0.0898 as printed: sum of squares {costs[0]:.2f}; b_z = +0.0898: {costs[1]:.2f}; the data say plus")
    wrong = sign_errors(result.offset, PRINTED[3:])
    page = Page(
        "A magnetometer turned on six faces",
        "The field has the same length in every direction. The printed sign of one offset, b z, does not fit the data.",
    )
    page.numbers(
        [
            (f"{result.fit.sse:.2f}", "sum of squared residuals at the minimum"),
            (f"{costs[0]:.2f}", "the same with the printed b_z = -0.0898"),
            (f"{costs[1]:.2f}", "the same with b_z = +0.0898"),
        ]
    )
    before = np.linalg.norm(readings.reading, axis=1)
    after = np.linalg.norm(result.apply(readings.reading * readings.normalised_by), axis=1)
    page.figure(norm_before_after(before, after, 1.0, "1"), "Norm of each reading, divided by the mean norm.")
    rows = []
    for name, found, printed in (("K", result.K, PRINTED[:3]), ("b", result.offset, PRINTED[3:])):
        for k, axis in enumerate("xyz"):
            mark = "wrong sign" if name == "b" and k in wrong else ""
            unit = "ratio" if name == "K" else "of the mean norm"
            rows.append([f"{name} {axis}", f"{found[k]:+.4f}", f"{printed[k]:+.4f}", unit, mark])
    page.heading("Found, and printed in the course")
    page.table(["", "found", "printed", "unit", ""], rows, (1, 2), marked=[k for k, row in enumerate(rows) if row[4]])
    for k in wrong:
        page.text(
            f"The printed table has a sign error: b {'xyz'[k]} is {result.offset[k]:+.4f}, not {PRINTED[3 + k]:+.4f}. "
            f"With the printed sign the squares sum to {costs[0]:.2f} instead of {costs[1]:.2f}."
        )
    page.text("What is left of the residual is not noise: `sinan trace rfly_course/MagRaw.mat` says what it is.")
    page.write(out / "magnetometer.html")


def sign_errors(found: Sequence[float] | FloatArray, printed: Sequence[float]) -> list[int]:
    """The places at which two lists have one size to the printed digits, but not one sign."""
    pairs = zip(found, printed, strict=True)
    return [k for k, (a, b) in enumerate(pairs) if a * b < 0.0 and abs(abs(a) - abs(b)) < 0.5e-4]
