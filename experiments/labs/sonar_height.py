"""Height from a sonar: time of flight, the air's temperature, tilt, and where no echo comes back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sinan.experiments.labs.course_flight import flown, rms
from sinan.experiments.report.figures import lines
from sinan.experiments.report.page import Page
from sinan.sensors.atmosphere import speed_of_sound
from sinan.sensors.ranging import tilt_compensated_height
from sinan.sensors.sonar import Sonar, range_from_time_of_flight

AIR, ASSUMED = 5.0, 20.0  # degC: a cold morning, and what the sonar's maker took for granted
MAXIMUM, BEAM_ANGLE = 8.0, np.deg2rad(35.0)  # m, of the scenarios' sonar
SOFTNESS = np.linspace(0.0, 0.95, 20)


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """Errors of the height step by step, and how soft a ground may be."""
    stream, motion, rpy = flown("low_pass", "sonar")
    time = 2.0 * stream["range"] / speed_of_sound(np.array(AIR))
    assumed, measured = (range_from_time_of_flight(time, degrees) for degrees in (ASSUMED, AIR))
    steps = {
        f"speed of sound at {ASSUMED:.0f} degC, no tilt": assumed,
        f"at the air's {AIR:.0f} degC, no tilt": measured,
        "and less the tilt": tilt_compensated_height(measured, rpy[:, 0], rpy[:, 1]),
    }
    errors = {name: rms(height - motion.height) for name, height in steps.items()}
    for name, error in errors.items():
        say(f"{name}: {error:.3f} m RMS")
    sonar = Sonar(1.0, maximum=MAXIMUM, beam_angle=BEAM_ANGLE)
    heard = np.array([100.0 * np.mean(sonar.echo(motion, softness)) for softness in SOFTNESS])
    say(f"of the echoes of a hard ground, one that swallows 0.95 of the sound returns {heard[-1]:.0f} %")
    page = Page(
        "Height from a sonar",
        "A sonar measures a time. The speed of sound makes a range of it, and the tilt a height.",
    )
    page.table(["height from", "RMS error / m"], [[name, f"{error:.3f}"] for name, error in errors.items()], (1,))
    page.heading("Where no echo comes back")
    page.figure(
        lines(SOFTNESS, {"low passes and stretches at 6 m": heard}, "softness of the ground", "echoes heard / %"),
        "A target of softness s returns 1 - s of the sound, so it is heard to sqrt(1 - s) of the range of a hard one.",
    )
    page.write(out / "sonar_height.html")
