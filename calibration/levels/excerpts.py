"""Excerpts of a long log, in which what it does not declare is sought at first.

White noise is told by n readings to 1 / sqrt(2 n) of itself: by two minutes as well as anybody needs it. What ten
minutes tell besides is how sizes change, which no model here has; so the excerpts are spread over the log. A search
that begins where theirs ended is short.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import GYRO, Recording
from sinan.sensors.window import LEAST_ROWS, between

#: Of so many equal shares of a log one excerpt each, of so many seconds: a choice, half and twice of which move a size
#: by 1.2 of its sigma at most (`bounds_of_work long`); what it does to measured logs is in docs/notes/ablation.md.
EXCERPTS, SECONDS = 4, 30.0
#: Longer logs are heard in excerpts [s], 2 * 4 * 30 = 240: where these would save less than half, none is left out.
LONG = 2.0 * EXCERPTS * SECONDS
#: Share of its samples that may be missing in an excerpt: a choice, half and twice of which change no size
#: (`bounds_of_work long`).
MISSING = 0.1


def excerpts_of(recording: Recording) -> tuple[Recording, ...]:
    """Of each share of a long log the excerpt that turns most, of one log, without a gap and with readings of every
    stream; a recording that is shorter, or has a share without one, or no position, of which few sizes are sought, as
    it is.
    """
    t, w = recording.streams["imu"].t, recording.streams["imu"].array(GYRO)
    h = np.diff(t)
    if "gps" not in recording.streams or len(h) * float(np.median(h)) <= LONG:
        return (recording,)
    turned = np.concatenate([[0.0], np.cumsum(h * np.sum(w[1:] ** 2, axis=1))])
    edges = [round(len(t) * k / EXCERPTS) for k in range(EXCERPTS + 1)]
    found = [_liveliest(recording, turned, first, last) for first, last in pairwise(edges)]
    excerpts = tuple(between(recording, begin, begin + SECONDS) for begin in found if begin is not None)
    return excerpts if len(excerpts) == EXCERPTS else (recording,)


def _liveliest(recording: Recording, turned: FloatArray, first: int, last: int) -> float | None:
    """Where in a share of the IMU's samples the excerpt begins that turns most, by steps of half its length [s]."""
    t = recording.streams["imu"].t
    samples = SECONDS / float(np.median(np.diff(t)))
    rows = np.arange(first, last, max(1, round(0.5 * samples)))
    ends = np.searchsorted(t, t[rows] + SECONDS)
    breaks = np.array(recording.breaks)
    of_one_log = np.searchsorted(breaks, t[rows] + SECONDS) == np.searchsorted(breaks, t[rows], side="right")
    fit = of_one_log & (ends < last) & (ends - rows >= (1.0 - MISSING) * samples)
    for stream in recording.streams.values():
        fit &= np.searchsorted(stream.t, t[rows] + SECONDS) - np.searchsorted(stream.t, t[rows]) >= LEAST_ROWS
    if not np.any(fit):
        return None
    return float(t[rows[fit]][np.argmax((turned[ends - 1] - turned[rows])[fit])])
