"""Parts of a long log, in which what it does not declare is sought.

A size is told by n readings to 1 / sqrt(2 n) of itself: by two minutes as well as anybody needs it. What ten minutes
tell besides is how sizes change, which no model here has; so the parts are spread over the log.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from sinan.sensors.recording import GYRO, Recording, Stream
from sinan.sensors.window import between

#: Of so many equal shares of a log one part each, of so many seconds: bound of work (`bounds_of_work long`); measured
#: logs are in docs/notes/ablation.md.
PARTS, SECONDS = 4, 30.0
#: Longer logs are heard in parts [s], 2 * 4 * 30 = 240: of what parts would save less than half of, none is left out.
LONG = 2.0 * PARTS * SECONDS


def heard_in_parts(recording: Recording) -> Recording:
    """A recording of the parts of a long log that turn most, each a stretch of its own; one that is shorter, or of
    which a part has not every stream, comes back as it is.

    Neglects what a stream has in other parts alone, such as a noise that comes late.
    """
    imu = recording.streams["imu"]
    if (len(imu) - 1) * float(np.median(np.diff(imu.t))) <= LONG:
        return recording
    turned = np.concatenate([[0.0], np.cumsum(np.sum(imu.array(GYRO) ** 2, axis=1))])
    begins = [_liveliest(imu.t, turned, first, last) for first, last in pairwise(_edges(len(imu)))]
    parts = [between(recording, begin, begin + SECONDS) for begin in begins]
    if any(part.streams.keys() != recording.streams.keys() for part in parts):
        return recording
    streams = {name: _concatenated([part.streams[name] for part in parts]) for name in recording.streams}
    starts = [float(part.streams["imu"].t[0]) for part in parts[1:]]
    return parts[0].replace(streams=streams, truth=None, breaks=(*recording.breaks, *starts))


def _edges(samples: int) -> list[int]:
    """First sample of each share, and the end: by samples, as a gap tells nothing."""
    return [round(samples * k / PARTS) for k in range(PARTS + 1)]


def _liveliest(t: np.ndarray, turned: np.ndarray, first: int, last: int) -> float:
    """Where in a share the part begins that turns most, by steps of half its length [s]."""
    starts = np.arange(t[first], max(t[last - 1] - SECONDS, t[first]) + 1e-9, 0.5 * SECONDS)
    rows = np.searchsorted(t, np.stack([starts, starts + SECONDS]))
    return float(starts[np.argmax(turned[rows[1]] - turned[rows[0]])])


def _concatenated(parts: list[Stream]) -> Stream:
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0].columns}
    return Stream(np.concatenate([part.t for part in parts]), columns)
