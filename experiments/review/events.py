"""What happened during a log, for the common axis of its page: gaps, stretches, faults, what was found, arming."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from sinan.estimator.filter.faults import Note
from sinan.experiments.datasets.inputs import file_of
from sinan.experiments.report.words import SENSORS
from sinan.experiments.review.curves import Event
from sinan.sensors.recording import COVARIATE_STREAMS, Recording

#: A gap is a step in which so many readings are missing at the median rate, and that lasts so long [s].
_MISSING, _LEAST = 3.5, 0.1
#: Of one stream, the longest gaps.
_MOST_GAPS = 200


def gap_events(recording: Recording) -> list[Event]:
    """Where a stream was silent."""
    found = []
    for name, stream in recording.streams.items():
        if len(np.unique(stream.t)) < 3 or name in COVARIATE_STREAMS:
            continue
        t = np.unique(stream.t)  # the points of one picture have one instant
        step = np.diff(t)
        wide = np.flatnonzero((step > _MISSING * np.median(step)) & (step > _LEAST))
        wide = np.sort(wide[np.argsort(-step[wide], kind="stable")[:_MOST_GAPS]])
        called = "IMU" if name == "imu" else SENSORS.get(name, name)
        found += [Event(f"gaps, {called}", float(t[k]), float(t[k + 1]), f"no reading of {called}")
                  for k in wide]  # fmt: skip
    return found


def fault_events(notes: Iterable[Note | str]) -> list[Event]:
    """Stretches that the filter found frozen or saturated; its gaps are those of the recording."""
    return [
        Event("faults", note.start, note.stop, f"{SENSORS.get(note.stream, note.stream)} {note.kind}")
        for note in notes
        if isinstance(note, Note) and note.kind != "gap"
    ]


def stretch_events(stretches: Sequence[tuple[float, float]]) -> list[Event]:
    """Stretches with states of their own, where there are several."""
    if len(stretches) < 2:
        return []
    return [Event("stretches", start, stop, f"stretch {k}") for k, (start, stop) in enumerate(stretches, 1)]


def found_events(document: Mapping[str, Any], end: float) -> list[Event]:
    """When the time-localised effects of a trace act."""
    return [
        Event("found", float(e["interval"][0]), min(float(e["interval"][1]), end), str(e["name"]))
        for e in document["effects"]
        if e.get("interval")
    ]


def logged_events(recording: Recording) -> list[Event]:
    """What the log itself says: when it was armed, in which mode it flew. Of several logs together nothing is said."""
    from sinan.sensors.formats.happenings import happenings_of

    path = None if recording.log_start is None else file_of(recording.source)
    if path is None or recording.log_start is None:
        return []
    end = max(float(stream.t[-1]) for stream in recording.streams.values())
    found = []
    for one in happenings_of(path):
        start, stop = one.start - recording.log_start, min(one.stop - recording.log_start, end)
        if stop >= 0.0 and start <= end:
            found.append(Event(one.kind, max(start, 0.0), stop, one.label))
    return found
