"""Figures 7.6 and 7.7: two masses that swing against each other read a rate, and no acceleration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sinan.experiments.report.lab_figures import Panel, panels
from sinan.experiments.report.page import Page
from sinan.sensors.arrays import FloatArray

DRIVE = 2000.0  # Hz, of the swing along x
AMPLITUDE = 5e-6  # m, of the swing
SENSE, DAMPING = 6000.0, 0.02  # Hz, 1: of each mass across the swing
SAMPLING = 100_000.0  # Hz
MISMATCH = 0.01  # 1: by how much one spring is stiffer
DISC, ROLLED = np.deg2rad(90.0), 1.0  # rad/s and m/s: a disc that turns, a ball that rolls outwards on it


@dataclass(frozen=True)
class Pair:
    """What two masses do across their swing.

    Attributes
    ----------
    one, two : (n,) deflections of the masses along z [m]
    """

    one: FloatArray
    two: FloatArray


def deflection(force: FloatArray, frequency: float) -> FloatArray:
    """(n,) deflection [m] of a mass on its spring under a force per mass [m/s^2], linear between the samples."""
    from scipy.signal import cont2discrete, lfilter

    w = 2.0 * np.pi * frequency
    num, den, _ = cont2discrete(([1.0], [1.0, 2.0 * DAMPING * w, w**2]), 1.0 / SAMPLING, method="foh")
    return np.asarray(lfilter(np.ravel(num), den, force))


def pair(t: FloatArray, rate: FloatArray, acceleration: FloatArray, mismatch: float = 0.0) -> Pair:
    """The pair under a rate about y and an acceleration along z.

    F / m = -2 w x v: with v = (v, 0, 0), w = (0, w, 0) that is (0, 0, 2 w v). The masses swing with +v and -v, so the
    Coriolis force deflects them against each other, and an acceleration deflects both to the same side, -a.

    Parameters
    ----------
    t : (n,) s, evenly at `SAMPLING`
    rate : (n,) rad/s
    acceleration : (n,) m/s^2
    mismatch : by what share the second spring is stiffer
    """
    v = AMPLITUDE * 2.0 * np.pi * DRIVE * np.cos(2.0 * np.pi * DRIVE * t)
    one = deflection(2.0 * rate * v - acceleration, SENSE)
    two = deflection(-2.0 * rate * v - acceleration, SENSE * np.sqrt(1.0 + mismatch))
    return Pair(one, two)


def rolled(t: FloatArray, rate: float, speed: float, centrifugal: bool = True) -> FloatArray:
    """(n, 2) path [m], as seen from a disc that turns about z, of a ball that leaves its middle along x.

    r'' = -2 w x v - w x (w x r), in the plane (2 w v_y + w^2 x, -2 w v_x + w^2 y)

    Parameters
    ----------
    t : (n,) s
    rate, speed : w [rad/s], m/s
    centrifugal : with the second term too; the first is the Coriolis force
    """
    from scipy.linalg import expm

    A = np.zeros((4, 4))
    A[:2, 2:] = np.eye(2)
    A[2, 3], A[3, 2] = 2.0 * rate, -2.0 * rate
    A[2, 0] = A[3, 1] = rate**2 if centrifugal else 0.0
    return np.asarray(expm(t[:, None, None] * A)[:, :2, 2] * speed)


def demodulated(t: FloatArray, signal: FloatArray) -> FloatArray:
    """(n,) rate [rad/s] that a deflection tells: its part in step with the swing, over ten periods, as a part of the
    frequency response at the drive.
    """
    w, w0 = 2.0 * np.pi * DRIVE, 2.0 * np.pi * SENSE
    response = 1.0 / (w0**2 - w**2 + 2j * DAMPING * w0 * w)
    carrier = np.cos(w * t + np.angle(response))
    window = np.ones(round(10.0 * SAMPLING / DRIVE))
    mean = np.convolve(signal * carrier, window / len(window), mode="same")
    return np.asarray(mean / (2.0 * AMPLITUDE * w * np.abs(response)))  # two masses, twice w v each, half of cos^2


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """A turn, a push and a vibration in step with the swing, read by one mass, by a pair, by a pair with a flaw."""
    t = np.arange(0.0, 0.3, 1.0 / SAMPLING)
    rate = np.deg2rad(np.where((t > 0.05) & (t < 0.1), 100.0, 0.0))
    push = np.where((t > 0.13) & (t < 0.18), 20.0, 0.0)
    shaking = np.where((t > 0.22) & (t < 0.28), 1.0, 0.0) * np.cos(2.0 * np.pi * DRIVE * t)
    good, flawed = pair(t, rate, push + shaking), pair(t, rate, push + shaking, MISMATCH)
    read = {
        "one mass": demodulated(t, 2.0 * good.one),
        "the pair": demodulated(t, good.one - good.two),
        f"springs {100 * MISMATCH:.0f} % apart": demodulated(t, flawed.one - flawed.two),
    }
    parts = {"turn": (0.06, 0.09), "push": (0.14, 0.17), "vibration": (0.23, 0.27)}
    rows = []
    for name, value in read.items():
        each = [round(float(np.rad2deg(np.mean(value[(t > a) & (t < b)]))), 2) + 0.0 for a, b in parts.values()]
        rows.append([name, *(f"{x:.2f}" for x in each)])
        say(f"{name}: turn {each[0]:.2f}, push {each[1]:.2f}, vibration {each[2]:.2f} deg/s")
    page = Page(
        "Two masses that swing against each other",
        "In a turning case a moving mass is pushed sideways: F = -2 m ω × v. Two masses that move against each other "
        "are pushed to opposite sides, and the difference of their capacitances is the rate. An acceleration pushes "
        "both to one side, which the difference does not see.",
    )
    shown = slice(None, None, 20)
    pushed = (t > 0.1795) & (t < 0.1815)
    figure = panels(
        [
            ball(),
            Panel(
                "time / s",
                "rate read / (deg/s)",
                {"known rate": (t[shown], np.rad2deg(rate[shown]))}
                | {name: (t[shown], np.rad2deg(value[shown])) for name, value in read.items()},
                title="a turn, a push, a vibration",
            ),
            Panel(
                "time after the push / ms",
                "deflection / nm",
                {
                    "mass 1": (1e3 * (t[pushed] - 0.18), 1e9 * good.one[pushed]),
                    "mass 2": (1e3 * (t[pushed] - 0.18), 1e9 * good.two[pushed]),
                    "difference": (1e3 * (t[pushed] - 0.18), 1e9 * (good.one - good.two)[pushed]),
                },
                title="both masses move alike",
            ),
        ],
        3,
    )
    page.figure(
        figure,
        "A ball that rolls straight on, as a disc sees it that turns at 90 deg/s. What is read of a turn (100 deg/s), "
        "a push (20 m/s²), and a vibration in step with the swing (1 m/s²).",
    )
    page.table(["read / (deg/s)", *parts], rows, (1, 2, 3))
    page.text(
        "A steady push is not in step with the swing, so even one mass does not take it for a rate. A vibration in "
        "step with the swing is: the pair rejects it as far as its springs are alike. What gets through is an "
        "effect, `gyro.g_sensitivity`."
    )
    page.write(out / "coriolis.html")


def ball() -> Panel:
    """Figure 7.6: a straight path, seen from a disc that turns; and what the Coriolis force alone makes of it."""
    t = np.linspace(0.0, 1.0, 101)
    straight = ROLLED * t[:, None] * np.stack([np.cos(DISC * t), -np.sin(DISC * t)], axis=1)
    both, coriolis = rolled(t, DISC, ROLLED), rolled(t, DISC, ROLLED, centrifugal=False)
    return Panel(
        "x of the disc / m",
        "y of the disc / m",
        {
            "known: straight": (straight[:, 0], straight[:, 1]),
            "both forces": (both[:, 0], both[:, 1]),
            "Coriolis alone": (coriolis[:, 0], coriolis[:, 1]),
        },
        title="figure 7.6",
    )
