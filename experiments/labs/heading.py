"""Heading from a magnetometer: what the tilt does to it, and what a wrong tilt does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sinan.experiments.labs.course_flight import flown, rms
from sinan.experiments.report.figures import lines
from sinan.experiments.report.page import Page
from sinan.sensors.arrays import FloatArray
from sinan.sensors.magnetometer import tilt_compensated_heading
from sinan.sensors.motion import Motion
from sinan.sensors.recording import MAG

SHOWN = 60.0  # s of the flight in the figure


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """Errors of the heading without tilt, with the tilt that gravity seems to show, and with the true tilt."""
    stream, motion, rpy = flown("aerobatics", "mag")
    m_b, level = stream.array(MAG), np.zeros(len(stream))
    declination = np.arctan2(motion.m_n[0, 1], motion.m_n[0, 0])
    tilts = {
        "no tilt": (level, level),
        "tilt of the specific force": tilt_of_force(motion),
        "true tilt": (rpy[:, 0], rpy[:, 1]),
    }
    errors = {}
    for name, (roll, pitch) in tilts.items():
        off = tilt_compensated_heading(m_b, roll, pitch) + declination - rpy[:, 2]
        errors[name] = np.rad2deg(np.angle(np.exp(1j * off)))
        say(f"{name}: {rms(errors[name]):.1f} deg RMS")
    page = Page(
        "Heading from a magnetometer",
        "The field points down more than north. A tilted compass takes a part of what points down for north; turned "
        "back by roll and pitch it does not. The specific force of a multicopter is no plumb line: it is the thrust, "
        "along body up, and shows next to no tilt however far the vehicle leans.",
    )
    page.table(["heading with", "RMS error / deg"], [[name, f"{rms(e):.1f}"] for name, e in errors.items()], (1,))
    shown = stream.t < SHOWN
    curves = {name: error[shown] for name, error in errors.items()}
    page.figure(lines(stream.t[shown], curves, "time / s", "error of the heading / deg"), "Error of the heading.")
    page.text("What is left with the true tilt is the magnetometer's own bias, of a few hundredths of the field.")
    page.write(out / "heading.html")


def tilt_of_force(motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Roll and pitch [rad] of a body that were at rest with this specific force, f = -C_bn g."""
    x, y, z = motion.f_b.T
    return np.arctan2(-y, -z), np.arctan2(x, np.hypot(y, z))
