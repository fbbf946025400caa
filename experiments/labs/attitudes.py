"""The course's ten attitudes and six faces: what each subset of them determines."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from sinan.calibration.poses.least_squares import covariance_of, undetermined_directions
from sinan.calibration.poses.triad import norm_jacobian, parameter_names
from sinan.experiments.report.lab_figures import Panel, panels
from sinan.experiments.report.page import Page
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.arrays import FloatArray

OPEN = 0.3  # 1-sigma from which on nothing is determined: no sensor's scale, offset or T is off by as much
NOISE = 2e-3  # m/s^2 of an accelerometer's pose; a magnetometer's reading has 0.005 of the field
#: pose numbers of the course's figure, from 1: up, down, left, right, forward, back, then 45 deg to four sides
SUBSETS: Mapping[str, tuple[int, ...]] = {
    "all ten": tuple(range(1, 11)),
    "six faces": tuple(range(1, 7)),
    "upright, and 45 deg to four sides": (1, 7, 8, 9, 10),
    "without upside down": (1, 3, 4, 5, 6, 7, 8, 9, 10),
    "up, down, left, right": (1, 2, 3, 4),
}
#: faces of the magnetometer, each turned about the vertical
FACES: Mapping[str, tuple[int, ...]] = {
    "six faces": (1, 2, 3, 4, 5, 6),
    "up, left, forward": (1, 3, 5),
    "up and down": (1, 2),
    "up alone": (1,),
}


def determined(truth: FloatArray, noise: float) -> tuple[FloatArray, tuple[str, ...]]:
    """What readings of these true vectors determine by their norm.

    Returns
    -------
    (9,) 1-sigma of K, b (in units of the norm) and T's upper triangle, infinite where a norm does not tell; sentences
    """
    norm = float(np.mean(np.linalg.norm(truth, axis=1)))
    ideal = np.concatenate([np.ones(3), np.zeros(6)])
    J = norm_jacobian(ideal, truth / norm)
    names, plausible = parameter_names("triangular"), np.full(9, 0.05)
    U, size, V_T = np.linalg.svd(J * plausible, full_matrices=False)
    size[size < noise / norm * plausible[0] / OPEN] = 0.0  # what is known worse than `OPEN` is not known
    J = (U * size) @ V_T / plausible
    _, sentences, _ = undetermined_directions(J, names, plausible)
    return np.sqrt(np.diag(covariance_of(J, plausible, noise / norm))), sentences


def poses() -> FloatArray:
    """(10, 3) specific force in the course's ten attitudes [m/s^2]."""
    scenario = load_scenario("ten_attitudes")
    assert scenario.turns is not None
    each = scenario.turns.hold + scenario.turns.turn
    return scenario.trajectory().motion(each * np.arange(10.0) + 0.5 * scenario.turns.hold).f_b


def faces() -> FloatArray:
    """(6, 36, 3) field, of length one, while each of the six faces is turned once about the vertical."""
    scenario = load_scenario("six_faces")
    assert scenario.turns is not None
    hold = scenario.turns.hold
    t = (hold + scenario.turns.turn) * np.arange(6)[:, None] + hold * np.linspace(0.05, 0.95, 36)
    field = scenario.trajectory().motion(t.ravel()).m_b
    return np.asarray(field / np.linalg.norm(field, axis=1, keepdims=True)).reshape(6, 36, 3)


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """A table for the accelerometer, one for the magnetometer, and both sets of directions."""
    f, m = poses(), faces()
    page = Page(
        "What ten attitudes and six faces determine",
        "Six unknowns need six directions, but not any six. Each row is a choice of the course's "
        "attitudes: what their norms "
        "determine, and what they leave open.",
    )
    for title, subsets, pick, noise in (
        ("Accelerometer: the ten attitudes", SUBSETS, lambda k: f[k], NOISE),
        ("Magnetometer: faces turned about the vertical", FACES, lambda k: m[k].reshape(-1, 3), 0.005),
    ):
        rows = []
        for name, numbers in subsets.items():
            std, sentences = determined(pick(np.array(numbers) - 1), noise)
            cells = [_worst(std[:3]), _worst(std[3:6]), *(_worst(s) for s in std[6:9])]
            rows.append([name, *cells, "; ".join(_short(s) for s in sentences) or "none"])
            say(
                f"{name}: scale {cells[0]}, offset {cells[1]}, T {', '.join(cells[2:])}; "
                f"{np.sum(std > OPEN)} of 9 left open"
            )
        page.heading(title)
        page.table(["poses", "K", "b / norm", "T_xy", "T_xz", "T_yz", "cannot be told"], rows, (1, 2, 3, 4, 5))
    shown = [
        Panel(
            "x", "z (down)", {}, {"ten attitudes": (-f[:, 0] / 9.8, -f[:, 2] / 9.8)}, "gravity in the body, side view"
        ),
        Panel("y", "z (down)", {}, {"ten attitudes": (-f[:, 1] / 9.8, -f[:, 2] / 9.8)}, "the same from ahead"),
        Panel(
            "x",
            "z (down)",
            {
                name: (m[k, :, 0], m[k, :, 2])
                for k, name in enumerate(("up", "down", "left", "right", "forward", "back"))
            },
            title="field in the body, six faces",
        ),
    ]
    page.figure(panels(shown, 3), "Directions that the poses show to the sensor.")
    page.text(
        "The ten attitudes lean to the sides or forward, never both: T_xy stays open, and a lean to the side and "
        "forward at once closes it. The six faces alone fix scale and offset of T = I, no more. Numbers are 1 sigma; "
        "open: 0.3 or more."
    )
    page.write(out / "attitudes.html")


def _worst(std: FloatArray) -> str:
    worst = float(np.max(std))
    return f"{worst:.1e}" if worst < OPEN else "open"


def _short(sentence: str) -> str:
    return sentence.replace(" cannot be determined from these data", "").split(": they can")[0]
