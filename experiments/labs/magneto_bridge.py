"""Figures 7.9 and 7.10: a magneto-resistive bridge, its offset that a flip takes out, and the Lorentz force."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sinan.experiments.report.lab_figures import Panel, panels
from sinan.experiments.report.page import Page
from sinan.sensors.arrays import FloatArray

# Of a permalloy bridge with 1 mV/V/gauss and a range of some gauss, such as Honeywell's HMC1001 (data sheet 900248)
RATIO = 0.02  # 1: change of the resistance between magnetised along and across the current
ANISOTROPY = 20.0  # gauss: a field across the strip as strong as this turns its magnetisation by 90 deg
RESISTANCE = 850.0  # ohm, of an arm
HEATING = 0.003  # 1/K: resistance of permalloy
ARMS = np.array([0.0, 2e-3, -1e-3, 3e-3])  # 1: by how much the four arms differ, as made
EARTH = 0.5  # gauss
PROTON = 9.5788331e7  # C/kg, charge by mass, CODATA 2018


def resistance(field: FloatArray, current: float, flipped: bool = False) -> FloatArray:
    """(n,) resistance [ohm] of a strip in a field across it [gauss], with its current at an angle to its long axis.

    R = R0 (1 + ratio cos^2(angle between magnetisation and current)); the field turns the magnetisation off the axis
    by asin(field / anisotropy), the other way if a pulse has flipped it.

    Parameters
    ----------
    field : (n,) below `ANISOTROPY`
    current : rad; 0 for a plain strip, +-45 deg with metal stripes across it
    flipped : magnetised backwards
    """
    turned = np.arcsin(np.clip(field / ANISOTROPY, -1.0, 1.0))
    magnetised = np.pi - turned if flipped else turned
    return np.asarray(RESISTANCE * (1.0 + RATIO * np.cos(magnetised - current) ** 2))


def bridge(field: FloatArray, warmer: float = 0.0, flipped: bool = False, arms: FloatArray = ARMS) -> FloatArray:
    """(n,) output over supply of four strips in a ring, neighbours with their stripes at +45 and -45 deg.

    Parameters
    ----------
    field : (n,) gauss
    warmer : K
    flipped : magnetised backwards
    arms : (4,) by what share each arm is off
    """
    up, down = (resistance(field, angle, flipped) for angle in (np.pi / 4, -np.pi / 4))
    R = [(1.0 + HEATING * warmer) * (1.0 + a) * r for a, r in zip(arms, (down, up, up, down), strict=True)]
    return np.asarray(R[1] / (R[0] + R[1]) - R[3] / (R[2] + R[3]))


def orbit(speed: float, field: float, charge_by_mass: float, t: FloatArray) -> FloatArray:
    """(n, 2) path [m] of a charge that starts at 0 along x in a field along z (out of the picture) [T].

    v' = (q / m) v x B: a circle, run through clockwise by a positive charge
    """
    w = charge_by_mass * field
    return np.stack([speed / w * np.sin(w * t), speed / w * (np.cos(w * t) - 1.0)], axis=1)


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """Resistance and bridge over the field; what heat, unequal arms and a flip do; a charge in a field."""
    small = np.linspace(-EARTH, EARTH, 41)
    slope = float(np.polyfit(small, 1e3 * bridge(small, arms=np.zeros(4)), 1)[0])  # mV/V/gauss
    offset = float(1e3 * bridge(np.zeros(1))[0])
    set_, reset = bridge(small), bridge(small, flipped=True)
    half = 0.5e3 * (set_ - reset)
    left = float(np.max(np.abs(half / slope - small)))
    warm = float(
        1e3 * (bridge(np.array([EARTH]), 30.0, arms=np.zeros(4)) - bridge(np.array([EARTH]), arms=np.zeros(4)))[0]
    )
    say(f"bridge: {slope:.3f} mV/V/gauss; unequal arms offset it by {offset:.3f} mV/V, {offset / slope:.2f} gauss")
    say(f"half the difference of set and reset is off by at most {1e3 * left:.2f} mgauss")
    say(f"30 K change what the Earth's field gives by {abs(warm):.1e} mV/V: all arms warm alike")
    page = Page(
        "A bridge of strips that feel a field",
        "A strip of permalloy has less resistance magnetised across its current than along it. Metal stripes turn the "
        "current by 45 deg, where the resistance goes with the field and its sign; four strips in a bridge leave the "
        "change alone.",
    )
    page.numbers(
        [
            (f"{slope:.2f}", "mV/V per gauss"),
            (f"{offset / slope:.2f} gauss", "offset of unequal arms: b' of the course"),
        ]
    )
    curves = {
        "magnetised forwards (set)": (small, 1e3 * set_),
        "backwards (reset)": (small, 1e3 * reset),
        "half their difference": (small, half),
    }
    flip = Panel("field / gauss", "output / (mV/V)", curves, title="a flip takes the offset out")
    figure = panels([strips(), flip, proton()], 3)
    page.figure(figure, "Strip, bridge, and the other principle: the Lorentz force turns what moves (500 m/s).")
    page.text(
        "The offset of a bridge looks like a field of the board, and the course's b' takes up both. A current of 1 mA "
        "through a bar of 1 mm across the Earth's field of 50 µT feels 50 pN; chips that use it let the current swing "
        "at the bar's own frequency, where the bar moves the most."
    )
    page.write(out / "magneto_bridge.html")


def strips() -> Panel:
    """Figure 7.9: resistance over the field, of a plain strip and with stripes."""
    field = np.linspace(-6.0, 6.0, 241)
    return Panel(
        "field across the strip / gauss",
        "resistance / ohm",
        {
            "plain strip": (field, resistance(field, 0.0)),
            "stripes at +45 deg": (field, resistance(field, np.pi / 4)),
            "stripes at -45 deg": (field, resistance(field, -np.pi / 4)),
        },
        title="figure 7.9",
    )


def proton() -> Panel:
    """Figure 7.10: the path of a proton at 500 m/s."""
    path = orbit(500.0, 5e-5, PROTON, np.linspace(0.0, 1.25e-3, 300))
    curve = {"": (100 * path[:, 0], 100 * path[:, 1])}
    return Panel("x / cm", "y / cm", curve, title="figure 7.10: a proton in 50 µT")
