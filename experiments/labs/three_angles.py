"""The course's antisymmetric T as a form of fit: a norm does not see its three angles, a reference does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sinan.calibration.poses.reference import calibrate_directions, small_rotation, three_angles
from sinan.experiments.labs.course_data import calibrated, numbers
from sinan.experiments.report.lab_figures import Panel, panels
from sinan.experiments.report.page import Page
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.arrays import FloatArray

#: Of the simulated board: the three angles [rad], K, b [m/s^2]; noise of a pose [m/s^2]
ANGLES, K, B, NOISE = np.array([0.02, -0.013, 0.008]), np.array([1.02, 0.99, 1.01]), np.array([0.1, -0.2, 0.15]), 2e-3
SEED = 3
NAMES = ("psi", "theta", "phi")
OVER = np.linspace(-0.1, 0.1, 81)  # rad, over which the index is shown


def norm_residual_of_angles(x: FloatArray, readings: FloatArray, norm: float) -> FloatArray:
    """(n,) |T K (r + b)| - norm with the course's nine unknowns: psi, theta, phi, s (3,), b (3,)."""
    return np.asarray(np.linalg.norm((readings + x[6:9]) * x[3:6] @ small_rotation(x[:3]).T, axis=1) - norm)


def slope(readings: FloatArray, x: FloatArray, norm: float) -> FloatArray:
    """(9,) singular values of the residual's Jacobian by central differences, columns scaled by 0.05 of their size."""
    step, size = 1e-4, np.array([0.05] * 6 + [0.05 * norm] * 3)
    columns = [
        (norm_residual_of_angles(x + step * d, readings, norm) - norm_residual_of_angles(x - step * d, readings, norm))
        / (2.0 * step)
        for d in np.diag(size)
    ]
    return np.asarray(np.linalg.svd(np.stack(columns, 1), compute_uv=False))


def turned_by_angles() -> tuple[FloatArray, FloatArray]:
    """The ten attitudes on a turntable that knows its angles: readings of the board, and the true specific force."""
    scenario = load_scenario("ten_attitudes")
    assert scenario.turns is not None
    each = scenario.turns.hold + scenario.turns.turn
    t = each * np.arange(float(len(scenario.turns.attitudes))) + 0.5 * scenario.turns.hold
    truth = scenario.trajectory().motion(t).f_b
    rng = np.random.default_rng(SEED)
    raw = truth @ np.linalg.inv(small_rotation(ANGLES)).T / K - B
    return raw + NOISE * rng.standard_normal(raw.shape), truth


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """The index over each angle by norm and by direction; what each method finds; the course's own ten poses."""
    raw, truth = turned_by_angles()
    known = calibrate_directions(raw, truth, antisymmetric=True, sigma=NOISE)
    whole = calibrate_directions(raw, truth, sigma=NOISE)
    found = known.fit.x[6:9]
    say(
        f"three angles in the board: {numbers(ANGLES)} rad; found with known angles: {numbers(found)}, "
        f"1 sigma {known.fit.std[6]:.0e}"
    )
    angles, rest = three_angles(whole.T)
    say(f"of a T with six free entries: {numbers(angles)}, and {numbers(rest)} that no antisymmetric T can say")
    own, best = calibrated("AccRaw.mat", "accel", 9.8)
    x = np.concatenate([np.zeros(3), best.K, best.offset])
    values = slope(own.reading, x, 9.8)
    say(
        f"course's ten poses: singular values {values[0]:.2g} ... {values[5]:.2g}, and of the three "
        f"angles {values[6]:.0e}"
    )
    page = Page(
        "Three angles that a norm does not see",
        "The course's T turns the calibrated axes by three small angles. A rotation changes no length: |T v|^2 = "
        "|v|^2 + |φ × v|^2, so the index depends on the angles in fourth order about its minimum, and no "
        "solver can find them. A "
        "reference that knows the direction can.",
    )
    turned = (raw + known.offset) * known.K
    page.figure(
        panels([flat(own.reading, x), sharp(turned, truth, found)]),
        "The index over each angle, with everything else at its best.",
    )
    rows = [
        [name, f"{true:.4f}", f"{value:.4f}", f"{std:.0e}"]
        for name, true, value, std in zip(("Δψ", "Δθ", "Δφ"), ANGLES, found, known.fit.std[6:9], strict=True)
    ]
    page.table(["", "in the board / rad", "found / rad", "1 sigma"], rows, (1, 2, 3))
    page.text(
        "What a norm does see is the symmetric part of T: axes that are not at right angles (`accel.cross_axis`, "
        "`sinan calibrate accel LOG --axes triangular`). The antisymmetric part is how the sensor sits on the board: "
        "`accel.misalignment`."
    )
    page.write(out / "three_angles.html")


def flat(readings: FloatArray, x: FloatArray) -> Panel:
    """The index by the norm over each angle, the other unknowns as in x (9,)."""
    curves = {}
    for k, name in enumerate(NAMES):
        trial = [np.concatenate([a * np.eye(3)[k], x[3:]]) for a in OVER]
        index = [np.sum(norm_residual_of_angles(y, readings, 9.8) ** 2) for y in trial]
        curves[name] = (1e3 * OVER, np.array(index))
    return Panel("angle / mrad", "index by norm / (m/s²)²", curves, title="course's ten poses: flat at zero")


def sharp(readings: FloatArray, truth: FloatArray, found: FloatArray) -> Panel:
    """The index by known directions over each angle, the other two as found; readings (n, 3) scaled, without offset."""
    curves = {}
    for k, name in enumerate(NAMES):
        trial = [np.where(np.arange(3) == k, a, found) for a in OVER]
        index = [np.sum((readings @ small_rotation(y).T - truth) ** 2) for y in trial]
        curves[name] = (1e3 * OVER, np.array(index))
    return Panel(
        "angle / mrad",
        "index by direction / (m/s²)²",
        curves,
        title="ten known attitudes: sharp",
        logarithmic="y",
    )
