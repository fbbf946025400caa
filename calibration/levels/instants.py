"""Instants of a receiver's fixes: it measures at regular ones of its own clock, whenever its message was logged."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import Recording, Stream

#: Fixes on either side of one whose stamps say how late its instant is logged: where one in five is early more than
#: half of 31 are so once in 10,000 times, binom.sf(15, 31, 0.2), of half as many once in 240, and a lateness that
#: swings by 50 ms in six minutes is followed to 3 ms by 31 and by 61: a choice (`test_instants`).
NEIGHBOURS = 15
#: Stamps scatter about regular instants by less than this part of the period, three of four, else they are no regular
#: ones; and one that is farther from its instant than so much of it may be of another: a choice. Half of the first lets
#: be what scatters by 0.07, twice moves what does by 0.15; half of the second lets be one stamp that is off by 0.18,
#: twice moves one by 0.35 (`test_instants`).
REGULAR, NEAR = 0.1, 0.25


def regular_instants(t: FloatArray) -> FloatArray:
    """(n,) the stamps without their scatter about regular instants [s]; the stamps themselves where there are none.

    The period is the slope of stamps by their number, gaps counted; how late an instant is logged is the running median
    of what is left. A stamp far from them stays.
    """
    from scipy.ndimage import median_filter

    if len(t) <= 2 * NEIGHBOURS:
        return t
    period = float(np.polyfit(_numbers(t, float(np.median(np.diff(t)))), t, 1)[0])
    on_time = _numbers(t, period) * period
    regular = on_time + median_filter(t - on_time, size=2 * NEIGHBOURS + 1, mode="mirror")
    scatter = np.abs(t - regular) / period
    found = np.where(scatter < NEAR, regular, t)
    return t if float(np.quantile(scatter, 0.75)) > REGULAR or np.any(np.diff(found) <= 0.0) else found


def _numbers(t: FloatArray, period: float) -> FloatArray:
    """(n,) periods from the first stamp to each; no two stamps have the same."""
    return np.cumsum(np.append(0.0, np.maximum(1.0, np.round(np.diff(t) / period))))


def at_regular_instants(recording: Recording) -> tuple[Recording, list[str]]:
    """The recording with the fixes of `gps` at regular instants; and that in words, where a stamp moves."""
    gps = recording.streams["gps"]
    logs = np.split(gps.t, np.searchsorted(gps.t, recording.breaks))
    t = np.concatenate([regular_instants(log) for log in logs])
    moved = np.abs(t - gps.t)
    if not np.any(moved > 1e-6):
        return recording, []
    period, most = float(np.median(np.diff(t))), 1e3 * float(np.max(moved))
    note = f"gps: stamps moved by up to {most:.0f} ms, to regular instants every {period:.3g} s"
    return recording.replace(streams={**recording.streams, "gps": Stream(t, gps.columns)}), [note]
