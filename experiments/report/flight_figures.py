"""Figures of a flight through the filter: the way, and the innovations of every sensor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sinan.estimator.filter.layout import P_N
from sinan.experiments.report.figures import AFTER, BAND, BEFORE, blank, new_figure
from sinan.experiments.report.words import SENSORS
from sinan.sensors.recording import POSITION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sinan.estimator.filter.journal import Journal
    from sinan.sensors.arrays import FloatArray
    from sinan.sensors.recording import Stream

#: Points of a curve that a figure shows.
_MOST = 4000


def trajectory(t: FloatArray, x: FloatArray, truth: Stream | None = None) -> Figure:
    """The way from above, north up, and the height over time.

    Parameters
    ----------
    t, x : (n,) s; (n, 10 or more) nominal states, position first (NED [m])
    truth : drawn in black where it knows the position
    """
    figure = blank(9.0, 4.2)
    above, height = figure.subplots(1, 2, width_ratios=(1.0, 1.2))
    step = max(1, len(t) // _MOST)
    if truth is not None and truth.has(POSITION):
        p = truth.array(POSITION)[:: max(1, len(truth) // _MOST)]
        above.plot(p[:, 1], p[:, 0], color="black", lw=0.9, label="truth")
        height.plot(truth.t[:: max(1, len(truth) // _MOST)], -p[:, 2], color="black", lw=0.9, label="truth")
    north, east, down = x[::step, P_N].T
    above.plot(east, north, color=AFTER, lw=1.2, label="estimate")
    height.plot(t[::step], -down, color=AFTER, lw=1.2, label="estimate")
    above.set_aspect("equal", adjustable="datalim")
    above.set_xlabel("east / m", fontsize=9)
    above.set_ylabel("north / m", fontsize=9)
    height.set_xlabel("time / s", fontsize=9)
    height.set_ylabel("height / m", fontsize=9)
    for one in (above, height):
        one.spines[["top", "right"]].set_visible(False)
        one.tick_params(labelsize=8)
    height.legend(frameon=False, fontsize=9)
    return figure


def innovations(journal: Journal) -> Figure:
    """Innovations over time, each in units of the sigma that the filter expects of it; red: refused by the gate."""
    streams = [stream for name in journal.sensors if len(stream := journal.stream(name))]
    figure, axes = new_figure(max(len(streams), 1), 1, 1.5, sharex=True)
    for one, stream in zip(axes[:, 0], streams, strict=False):
        sigma = np.sqrt(np.diagonal(stream.S, axis1=1, axis2=2))
        ratio = stream.nu / sigma
        step = max(1, len(stream) // _MOST)
        one.axhspan(-2.0, 2.0, color=BAND, lw=0)
        one.plot(stream.t[::step], ratio[::step], ".", color=AFTER, ms=2.5)
        out = ~stream.accepted & np.all(np.isfinite(ratio), axis=1)
        one.plot(stream.t[out], ratio[out], "x", color=BEFORE, ms=4.0)
        title = f"{SENSORS.get(stream.sensor, stream.sensor)}: innovation over its expected sigma (band: 2 sigma)"
        one.set_title(title, loc="left", fontsize=9)
        one.set_ylim(*_within(ratio[stream.accepted]))
    axes[-1, 0].set_xlabel("time / s", fontsize=9)
    return figure


def _within(values: FloatArray) -> tuple[float, float]:
    """Room for all that was used, four sigma at least."""
    most = float(np.nanmax(np.abs(values))) if values.size else 0.0
    return -max(4.0, 1.1 * most), max(4.0, 1.1 * most)
