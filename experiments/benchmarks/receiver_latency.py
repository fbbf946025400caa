"""How much older than its position the velocity of a receiver is: by its own fixes, and by the filter's sizes.

    python -m sinan.experiments.benchmarks.receiver_latency [LOG ...] [--longest S] [--table FILE]

A position is the integral of the velocity. Over windows of `WINDOW` seconds p(t) - integral of v(s + lead) ds is, but
for errors that a parabola takes up, nothing: the lead is where its squares are least. No IMU and no filter have a part
in it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid

from sinan.calibration.levels.preparation import prepared
from sinan.estimator.filter.events import position_of
from sinan.experiments.benchmarks.halves import liveliest, parsed, written
from sinan.experiments.datasets import resolve
from sinan.experiments.measured.flights import LOGS
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import VELOCITY, Recording
from sinan.sensors.window import between

#: Length of a window, and the leads that are compared [s].
WINDOW = 10.0
LEADS = np.linspace(-0.4, 0.4, 81)

HEAD = """# Velocities that are older than positions

Written by `python -m sinan.experiments.benchmarks.receiver_latency`. **by the fixes**: the lead at which a receiver's
own positions are best the integrals of its own horizontal velocities, of each half of the log, and by how much that
changes the RMS of what is left. **by the sizes**: how much older than its position the velocity of a fix is by the
likelihood of the filter, with its sigma, of the liveliest part of the log. The two have no sensor in common but the
receiver.

| log | fixes, first half [s] | second half [s] | RMS without and with it [m] | sizes [s] | sigma [s] |
| --- | --- | --- | --- | --- | --- |
"""


@dataclass(frozen=True)
class Lead:
    """By a receiver's own fixes: s, and the RMS of positions less integrals without and with it [m]; NaN of less than
    a window.
    """

    lead: float
    rms: tuple[float, float]


def lead_of_fixes(t: FloatArray, p_n: FloatArray, v_n: FloatArray) -> Lead:
    """Of fixes at instants t (k,), horizontal positions (k, 2) and velocities (k, 2); see the head of the module."""
    squares, count = np.zeros(len(LEADS)), 0
    for begin in np.arange(t[0], t[-1] - WINDOW, WINDOW):
        rows = (t >= begin) & (t < begin + WINDOW)
        own = t[rows]
        if len(own) < 6:
            continue
        count += 2 * len(own)
        parabola = np.vander((own - begin) / WINDOW, 3)
        for k, lead in enumerate(LEADS):
            v = np.stack([np.interp(own + lead, t, component) for component in v_n.T], axis=1)
            left = p_n[rows] - cumulative_trapezoid(v, own, axis=0, initial=0.0)
            left = left - parabola @ np.linalg.lstsq(parabola, left, rcond=None)[0]
            squares[k] += float(np.sum(left**2))
    if not count:
        return Lead(np.nan, (np.nan, np.nan))
    least = int(np.argmin(squares))
    rms = np.sqrt(squares / count)
    return Lead(float(LEADS[least]), (float(rms[len(LEADS) // 2]), float(rms[least])))


def fixes_of(recording: Recording) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Instants, and horizontal positions and velocities of a recording's receiver."""
    gps = recording.streams["gps"]
    return gps.t, position_of(recording, "gps")[:, :2], gps.array(VELOCITY)[:, :2]


def row(name: str, longest: float | None) -> str:
    """Of one log, as a line of the table."""
    recording = resolve(LOGS[name])
    t, p_n, v_n = fixes_of(recording)
    half = len(t) // 2
    first, second = lead_of_fixes(t[:half], p_n[:half], v_n[:half]), lead_of_fixes(t[half:], p_n[half:], v_n[half:])
    both = lead_of_fixes(t, p_n, v_n)
    levels = prepared(between(recording, *liveliest(recording, longest))).levels
    sigma = {(size.sensor, size.key): s for size, s in zip(levels.found, levels.sigmas, strict=True)}
    of_both = float(np.linalg.norm([sigma.get(("latency", key), np.nan) for key in ("gps", "gps_position")]))
    return (
        f"| {name} | {first.lead:.2f} | {second.lead:.2f} | {both.rms[0]:.3f}, {both.rms[1]:.3f} | {levels.lead:.3f} "
        f"| {of_both:.3f} |\n"
    )


def main(arguments: Sequence[str]) -> None:
    """Write the table of the logs that are named, of all whose receiver gives velocities otherwise."""
    asked, table = parsed(arguments, __doc__)
    lines = HEAD
    for one in asked:
        recording = resolve(LOGS[one.log])
        if recording.kind == "flight" and "gps" in recording.streams and recording.streams["gps"].has(VELOCITY):
            lines += row(one.log, one.longest)
    written(lines, table)


if __name__ == "__main__":
    main(sys.argv[1:])
