"""Figures 7.1 to 7.3: a mass on a spring measures specific force; in free fall it reads zero."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sinan.experiments.report.lab_figures import Panel, panels
from sinan.experiments.report.page import Page
from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import STANDARD_GRAVITY

FREQUENCY, DAMPING = 200.0, 0.1  # Hz, 1: of the mass on its spring; so weak a damping is that of a chip in thin gas
STEP = 1e-4  # s
PUSH = 3.0  # m/s^2, up and then down
HELD, PUSHED, FALLING = (0.0, 0.2), (0.2, 0.4), (0.6, 1.0)  # s
VIBRATION = 1.0  # m/s^2, amplitude of the motors' shaking


def spring_reading(force: FloatArray, step: float, frequency: float, damping: float) -> FloatArray:
    """What a mass on a spring reads while its case feels a specific force along the spring.

    x'' + 2 damping w x' + w^2 x = -f,  reading = -w^2 x: the compression times stiffness over mass

    The equation is linear: a step with the force held over it has no error of its own.

    Parameters
    ----------
    force : (n,) specific force along the axis [m/s^2]; the mass begins at rest under the first of them
    step : s between them
    frequency : of the undamped mass [Hz]
    damping : share of the critical damping

    Returns
    -------
    (n,) m/s^2
    """
    from scipy.signal import cont2discrete, lfilter, lfiltic

    w = 2.0 * np.pi * frequency
    num, den, _ = cont2discrete(([w**2], [1.0, 2.0 * damping * w, w**2]), step, method="zoh")
    past = np.full(2, force[0])
    return np.asarray(lfilter(np.ravel(num), den, force, zi=lfiltic(np.ravel(num), den, past, past))[0])


def magnification(ratio: FloatArray, damping: float) -> FloatArray:
    """Amplitude of the reading over that of a vibration whose frequency is `ratio` times that of the mass."""
    return np.asarray(1.0 / np.sqrt((1.0 - ratio**2) ** 2 + (2.0 * damping * ratio) ** 2))


def lifted_and_dropped(t: FloatArray) -> FloatArray:
    """(n,) upward acceleration of the case [m/s^2]: held, lifted and stopped, held, dropped, caught."""
    a = np.zeros(len(t))
    middle = 0.5 * sum(PUSHED)
    a[(PUSHED[0] <= t) & (t < middle)] = PUSH
    a[(middle <= t) & (t < PUSHED[1])] = -PUSH
    a[(FALLING[0] <= t) & (t < FALLING[1])] = -STANDARD_GRAVITY
    return a


def shaken(frequency: float) -> float:
    """Amplitude of the reading [m/s^2] once the mass has settled in a vibration of this frequency [Hz]."""
    t = np.arange(0.0, 0.3, STEP)
    reading = spring_reading(VIBRATION * np.sin(2.0 * np.pi * frequency * t), STEP, FREQUENCY, DAMPING)
    settled = t > 0.15
    basis = np.stack([np.sin(2.0 * np.pi * frequency * t[settled]), np.cos(2.0 * np.pi * frequency * t[settled])], 1)
    return float(np.hypot(*np.linalg.lstsq(basis, reading[settled], rcond=None)[0]))


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """Hold, lift and drop it; tilt it; shake it."""
    t = np.arange(0.0, 1.2, STEP)
    a = lifted_and_dropped(t)
    reading = spring_reading(a + STANDARD_GRAVITY, STEP, FREQUENCY, DAMPING)
    rest = float(np.mean(reading[t < HELD[1]]))
    fall = float(np.mean(reading[(t > FALLING[0] + 0.05) & (t < FALLING[1])]))
    tilt = np.linspace(-90.0, 90.0, 37)
    compression = STANDARD_GRAVITY * np.sin(np.deg2rad(tilt)) / (2.0 * np.pi * FREQUENCY) ** 2
    frequencies = np.geomspace(20.0, 1000.0, 25)
    amplitude = np.array([shaken(f) for f in frequencies])
    say(f"at rest it reads {rest:.3f} m/s^2, in free fall {fall:.3f}")
    say(f"1 deg of tilt moves the mass by {1e9 * (compression[19] - compression[18]) / 5.0:.0f} nm")
    say(f"a vibration at {FREQUENCY:.0f} Hz is read {max(amplitude):.1f} times as large as it is")
    page = Page(
        "A mass on a spring",
        "An accelerometer measures how far a spring is pressed. That is the force of the case on the mass: everything "
        "but gravity. On a table it reads gravity although nothing accelerates; dropped, it accelerates and reads 0.",
    )
    page.numbers([(f"{rest:.2f} m/s²", "read at rest"), (f"{fall:.2f} m/s²", "read in free fall")])
    grid = np.geomspace(20.0, 1000.0, 400)
    figure = panels(
        [
            Panel(
                "time / s",
                "upward / (m/s²)",
                {"known acceleration": (t, a), "reading": (t, reading)},
                title="held, lifted, held, dropped, caught",
            ),
            Panel(
                "tilt of the axis / deg",
                "compression / nm",
                {"": (tilt, 1e9 * compression)},
                title="the compression tells the tilt",
            ),
            Panel(
                "frequency of the vibration / Hz",
                "read / true",
                {"known formula": (grid, magnification(grid / FREQUENCY, DAMPING))},
                {"simulated": (frequencies, amplitude / VIBRATION)},
                "vibration",
                "xy",
            ),
        ],
        3,
    )
    page.figure(figure, "The reading in motion, at rest at an angle, and in vibration.")
    page.text(
        "What is proportional to the compression is read out: resistance, charge or capacitance (figure 7.3). With "
        "the axis at the angle θ to the horizon the reading is g sin θ, the same tomorrow as today: no error "
        "accumulates. The weakness is vibration: near its own frequency the spring magnifies it."
    )
    page.write(out / "spring_mass.html")
