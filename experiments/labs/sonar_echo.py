"""Figures 7.12 and 7.13: time of flight at the air's temperature, and the four ways in which no echo comes back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sinan.experiments.report.lab_figures import Panel, panels
from sinan.experiments.report.page import Page
from sinan.sensors.arrays import FloatArray
from sinan.sensors.atmosphere import speed_of_sound
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import quaternion_from_rpy
from sinan.sensors.sonar import Sonar, range_from_time_of_flight

ASSUMED = 20.0  # degC: what the sonar counts with
SONAR = Sonar(0.01, minimum=0.2, maximum=8.0, beam_angle=np.deg2rad(35.0))
#: figure 7.13: height [m], tilt of the surface [deg], share of the sound that it swallows
CASES = {
    "hard and level": (3.0, 0.0, 0.0),
    "soft": (3.0, 0.0, 0.9),
    "at an angle": (3.0, 45.0, 0.0),
    "too far": (9.0, 0.0, 0.0),
    "too near": (0.1, 0.0, 0.0),
}


def over_ground(height: FloatArray, tilt: FloatArray) -> Motion:
    """A body at these heights (n,) [m], rolled by these angles (n,) [rad]: the ground seems to lean the other way."""
    rpy, p_n = np.zeros((len(tilt), 3)), np.zeros((len(height), 3))
    rpy[:, 0], p_n[:, 2] = tilt, -height
    return Motion(np.arange(float(len(height))), p_n, q_nb=quaternion_from_rpy(rpy))


def highest(tilt: FloatArray, softness: float) -> FloatArray:
    """(n,) height [m] above which no echo comes back, by bisection of what the sonar says; 0 where none does."""
    low, high = np.full(len(tilt), SONAR.minimum + 1e-6), np.full(len(tilt), 20.0)
    never = ~SONAR.echo(over_ground(low, tilt), softness)
    for _ in range(40):
        middle = 0.5 * (low + high)
        heard = SONAR.echo(over_ground(middle, tilt), softness)
        low, high = np.where(heard, middle, low), np.where(heard, high, middle)
    return np.where(never, 0.0, low)


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """Ranges from times at wrong temperatures; each failure of figure 7.13; the limits over tilt and softness."""
    air = np.linspace(-20.0, 45.0, 66)
    errors = {}
    for d in (2.0, 5.0, 8.0):
        time = 2.0 * d / speed_of_sound(air)
        errors[f"{d:.0f} m"] = (air, 100.0 * (range_from_time_of_flight(time, ASSUMED) - d))
    cold = float(errors["5 m"][1][np.argmin(np.abs(air))])
    say(f"5 m in air of 0 degC, counted with {ASSUMED:.0f} degC, read {cold:.1f} cm too long")
    rows = []
    for name, (height, tilt, softness) in CASES.items():
        heard = bool(SONAR.echo(over_ground(np.array([height]), np.deg2rad([tilt])), softness)[0])
        say(f"{name}: {'an echo' if heard else 'no echo'}")
        rows.append([name, f"{height:.1f}", f"{tilt:.0f}", f"{softness:.1f}", "yes" if heard else "no"])
    tilts = np.linspace(0.0, 60.0, 241)
    limits = {f"softness {s:.1f}": (tilts, highest(np.deg2rad(tilts), s)) for s in (0.0, 0.5, 0.9)}
    page = Page(
        "Time of flight, and when no echo comes back",
        "d = v Δt / 2. The speed of sound goes with the root of the absolute temperature: 0.17 % a kelvin. A soft "
        "target swallows the sound, one at an angle sends it elsewhere, a far one answers too faintly.",
    )
    page.figure(
        panels(
            [
                Panel("temperature of the air / degC", "error of the range / cm", errors, title="counted with 20 degC"),
                Panel("tilt / deg", "highest height with an echo / m", limits, title="figure 7.13"),
            ]
        ),
        "What a wrong temperature does to a range, and from where an echo comes back.",
    )
    page.table(["figure 7.13", "height / m", "tilt / deg", "swallowed", "echo"], rows, (1, 2, 3))
    page.text("A flight with all of it: `sinan lab sonar_height`. The wrong speed as an effect: `sonar.sound_speed`.")
    page.write(out / "sonar_echo.html")
