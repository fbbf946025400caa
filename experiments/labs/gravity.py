"""Analysis experiment: the same calibration with g = 1, and the pitch angle of a slowly turned autopilot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sinan.calibration.poses.triad import Calibration, calibrate_norm, norm_residual
from sinan.experiments.datasets import resolve
from sinan.experiments.labs.course_data import calibrated, numbers
from sinan.experiments.report.figures import lines
from sinan.experiments.report.lab_figures import Panel, panels
from sinan.experiments.report.page import Page
from sinan.experiments.residual_loop.open_source import TriadReadings
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import ACCEL

PRINTED_AT_ONE = (0.1012, 0.1017, 0.1014, 0.0123, 0.2771, 0.1456)  # K and b on the course's slides, g = 1


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """Compare g = 9.8 with g = 1: the scale divides, the offset and every angle stay."""
    readings, nine = calibrated("AccRaw.mat", "accel", 9.8)
    _, one = calibrated("AccRaw.mat", "accel", 1.0)
    page = Page(
        "Gravity's size does not matter for angles",
        "With g = 1 instead of 9.8 every scale divides by 9.8, and neither the offset nor any angle changes.",
    )
    pitch = [pitch_while_turned(fit) for fit in (nine, one)]
    apart = np.max(np.abs(pitch[0] - pitch[1]))
    printed = float(np.sum(norm_residual(np.array(PRINTED_AT_ONE), readings.reading, 1.0) ** 2))
    ratio = printed / one.fit.sse
    say(f"g = 9.8: K = diag({numbers(nine.K)}), b = ({numbers(nine.offset)})")
    say(f"g = 1:   K = diag({numbers(one.K)}), b = ({numbers(one.offset)}); K x 9.8 = ({numbers(one.K * 9.8)})")
    say(f"the course prints b = ({numbers(PRINTED_AT_ONE[3:])}): {ratio:.1f} times the minimal sum of squares")
    say(f"largest difference of the pitch angles: {apart:.1e} deg")
    page.numbers(
        [
            (f"{apart:.0e}°", "largest difference of the two pitch angles"),
            (f"{ratio:.1f} ×", "sum of squares of the printed solution over the minimum: its solver stopped early"),
        ]
    )
    t = np.arange(len(pitch[0]), dtype=np.float64)
    figure = lines(t, {"g = 9.8": pitch[0], "g = 1": pitch[1]}, "reading", "pitch / deg")
    page.figure(figure, "Pitch while the autopilot is turned slowly: the two curves lie on each other.")
    why(page, readings, nine, say)
    rows = [
        ["K, g = 9.8", numbers(nine.K), "0.9912, 0.9974, 0.9947"],
        ["b, g = 9.8", numbers(nine.offset), "0.0168, 0.2691, 0.1253"],
        ["K, g = 1", numbers(one.K), numbers(PRINTED_AT_ONE[:3])],
        ["b, g = 1", numbers(one.offset), numbers(PRINTED_AT_ONE[3:])],
    ]
    page.table(["", "found", "printed in the course"], rows)
    page.write(out / "gravity.html")


def pitch_while_turned(fit: Calibration) -> FloatArray:
    """(n,) pitch [deg] of the slowly turned autopilot by its calibrated accelerometer."""
    f = fit.apply(resolve("rfly_course/accdata.mat").streams["poses"].array(ACCEL))
    return np.asarray(np.rad2deg(np.arctan2(f[:, 0], np.hypot(f[:, 1], f[:, 2]))))


def why(page: Page, readings: TriadReadings, nine: Calibration, say: Callable[[str], None]) -> None:
    """K' = a K and b' = b: derived, and shown with thirteen sizes of gravity."""
    page.heading("Why: K' = a K, b' = b")
    page.text(
        "At the minimum every derivative of Σ(|K (r + b)| - g)^2 is zero. Put a K for K and a g for g: "
        "every residual is "
        "a times what it was, so the sum is a^2 times what it was at any K and b, and its minimum lies at a K and the "
        "same b. Not only a stationary point: the minimum. Angles are ratios of calibrated readings, from which a "
        "cancels."
    )
    a = np.geomspace(0.02, 50.0, 13)
    fits = [calibrate_norm("accel", readings.reading, 9.8 * factor) for factor in a]
    off = [np.max(np.abs(fit.K / (factor * nine.K) - 1.0)) for fit, factor in zip(fits, a, strict=True)]
    moved = [np.max(np.abs(fit.offset - nine.offset)) for fit in fits]
    say(f"a from 0.02 to 50: K' / (a K) - 1 at most {max(off):.0e}, b' - b at most {max(moved):.0e} m/s^2")
    scale = Panel(
        "a",
        "K'",
        {"known a K (of y)": (a, a * nine.K[1])},
        {"found (x, y, z)": (np.repeat(a, 3), np.array([fit.K for fit in fits]).ravel())},
        "scale",
        "xy",
    )
    found = {c: (a, np.array([fit.offset[k] for fit in fits])) for k, c in enumerate("xyz")}
    offset = Panel("a", "b' / (m/s²)", {}, found, "offset", "x")
    page.figure(panels([scale, offset]), "Thirteen calibrations of the same readings, each with another g.")
