"""From what a log that describes itself holds to a checked recording: what is damaged is left out and reported."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.geodetic import to_ned
from sinan.sensors.formats.plausible import check_units
from sinan.sensors.formats.units import FIELD_UNIT
from sinan.sensors.recording import QUATERNION, REQUIRED_COLUMNS, Environment, Recording, SensorSpec, Stream, Truth

#: A quaternion whose norm is off one by more is none: autopilots log zeros or NaN before they have an attitude.
_UNIT = 0.01
#: A clock goes back where it does so by more than a few steps, and rows of more than a second are left out for it: what
#: is late by less, or for less, was written out of order.
_FEW_STEPS, _LASTS = 3.0, 1.0
#: Samples are averages where they are taken over at least this part of the step to the next.
_FILLED = 0.5
#: A clock that leaps by more than a day within a log is damaged: no flight has such a gap, a stamp with a wrong bit
#: has [s].
_LEAP = 86_400.0
#: Least and full throttle as widths of pulses to a motor [us], where a log does not say.
PULSES = (1000.0, 2000.0)
#: Forward-right-down of forward-left-up, and north-east-down of east-north-up (REP-103).
FRD_OF_FLU = np.diag([1.0, -1.0, -1.0])
NED_OF_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
#: Topics or kinds of messages that an error names.
_MOST_NAMES = 10


def recording_of(
    path: Path,
    found: Mapping[str, Stream | None],
    attitude: Stream | None = None,
    sensors: Mapping[str, SensorSpec] | None = None,
    notes: Sequence[str] = (),
    there: Sequence[str] = (),
    reference: str = "autopilot",
    needs: str = "imu",
) -> Recording:
    """A flight of the streams that are there; times begin with the first sample.

    Parameters
    ----------
    found : by name, on the log's clock [s]; positions may be geodetic, a magnetometer is in gauss
    attitude : of the reference, quaternions body to NED, and what else it knows
    sensors : what the log declares
    notes : what could not be read, or was chosen
    there : names of what the log holds, for the message of one that cannot be used
    reference : kind of the reference
    needs : the stream without which it is no recording

    Raises
    ------
    InputError : not what is needed; what `Recording` and `check_units` find wrong
    """
    mended = {name: sound(name, stream) for name, stream in found.items() if stream is not None}
    said = [*notes, *(note for _, of_stream in mended.values() for note in of_stream)]
    streams = {name: stream for name, (stream, _) in mended.items() if len(stream) > 0}
    if needs not in streams:
        what = "accelerometer with a gyroscope" if needs == "imu" else needs
        more = f" and {len(there) - _MOST_NAMES} more" if len(there) > _MOST_NAMES else ""
        names = f" (there are {', '.join(there[:_MOST_NAMES])}{more}; `sinan info` lists all)" if there else ""
        raise InputError(path, f"no {what}{names}", "a log that has it")
    start = min(float(stream.t[0]) for stream in streams.values())
    twice = [(begin - start, end - start) for begin, end in goes_back(stream for stream in found.values() if stream)]
    streams = {name: Stream(stream.t - start, stream.columns) for name, stream in streams.items()}
    streams, origin, chosen = to_ned(path, streams, None)
    recording = Recording(
        path.stem, "flight", streams, sensors=sensors or {}, environment=Environment(field_unit=FIELD_UNIT),
        origin=origin, source=str(path), notes=(*said, *chosen), truth=_reference(attitude, start, reference),
        log_start=start, goes_back=tuple(twice),
    )  # fmt: skip
    check_units(recording)
    return recording


def numbered(streams: Sequence[Stream]) -> Stream | None:
    """The first of several streams, and the columns of the others with numbers: `current`, `current_2`."""
    streams = [stream for stream in streams if len(stream)]
    if not streams:
        return None
    first = streams[0]
    columns = dict(first.columns)
    for k, other in enumerate(streams[1:], 2):
        columns |= {f"{name}_{k}": np.interp(first.t, other.t, values) for name, values in other.columns.items()}
    return Stream(first.t, columns)


def turned(C: FloatArray, values: FloatArray) -> FloatArray:
    """(n, 3) vectors by a rotation, C @ v; what is no number becomes none, and `sound` leaves it out."""
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(values @ C.T)


def averaged(t: FloatArray, over: FloatArray) -> dict[str, SensorSpec]:
    """What is declared of an IMU whose samples are taken over some times: those that fill their steps are averages.

    Parameters
    ----------
    t, over : (n,) stamps, and the time over which each sample was taken, in one unit
    """
    if len(t) < 2 or not np.median(over) > _FILLED * np.median(np.diff(t)):
        return {}
    return {"accel": SensorSpec(imu_samples="average")}


def _reference(stream: Stream | None, start: float, kind: str) -> Truth | None:
    """The rows of a reference that have an attitude; `start` is t = 0 of the recording [s]."""
    if stream is None:
        return None
    stream, _ = sound("reference", stream)
    if not stream.has(QUATERNION):
        return None
    stream = stream.rows(np.abs(np.linalg.norm(stream.array(QUATERNION), axis=1) - 1.0) < _UNIT)
    return Truth(Stream(stream.t - start, stream.columns), kind, aligned=True) if len(stream) else None


def sound(name: str, stream: Stream) -> tuple[Stream, list[str]]:
    """A stream without what damage, or a driver that knows no value, has put into it; and sentences that say so.

    Left out are columns that may be missing and hold no number at all, rows that hold a gap, the fewest rows without
    which the time rises, and what a leap of the clock separates from the most.
    """
    notes: list[str] = []
    required = {column for columns in REQUIRED_COLUMNS.get(name, ()) for column in columns}
    finite = {column: np.isfinite(values) for column, values in stream.columns.items()}
    empty = [column for column, good in finite.items() if not np.any(good) and column not in required]
    if empty and len(stream):
        notes.append(f"{name}: no number in it, left out: {', '.join(empty)}")
    columns = {column: values for column, values in stream.columns.items() if column not in empty}
    keep = np.all([finite[column] for column in columns], axis=0) if columns else np.zeros(len(stream), dtype=bool)
    stream, lost = Stream(stream.t, columns).rows(keep), int(np.sum(~keep))
    if lost:
        notes.append(f"{name}: {lost} rows left out: not a number")
    forward = rising(stream.t)
    if lost := int(np.sum(~forward)):
        notes.append(f"{name}: {lost} rows left out: the time goes back")
    stream = stream.rows(forward)
    together = _without_leap(stream.t)
    if lost := int(np.sum(~together)):
        notes.append(f"{name}: {lost} rows left out: their time is more than a day from the others'")
    return stream.rows(together), notes


def goes_back(streams: Iterable[Stream]) -> list[tuple[float, float]]:
    """Times that a log's clock passes twice, as it goes back and rows before and after are read: from and to, in order.

    What overlaps in several streams is one.
    """
    found: list[tuple[float, float]] = []
    for begin, end in sorted(one for stream in streams for one in _passed_twice(stream.t[np.isfinite(stream.t)])):
        if found and begin <= found[-1][1]:
            found[-1] = found[-1][0], max(found[-1][1], end)
        else:
            found.append((begin, end))
    return found


def _passed_twice(t: FloatArray) -> list[tuple[float, float]]:
    """The same of one clock: where it goes back furthest in each run of rows that `rising` leaves out amid others."""
    lost = ~rising(t)
    if not np.any(lost):
        return []
    step = float(np.median(np.diff(t[~lost]))) if np.sum(~lost) > 1 else np.inf
    edges = np.flatnonzero(np.diff(np.concatenate([[False], lost, [False]])))
    found = []
    for first, stop in zip(edges[::2], edges[1::2], strict=True):
        if first == 0 or stop == len(t) or (stop - first) * step <= _LASTS:
            continue
        around = t[first - 1 : stop + 1]
        k = int(np.argmin(np.diff(around)))
        if around[k] - around[k + 1] > _FEW_STEPS * step:
            found.append((float(around[k + 1]), float(around[k])))
    return found


def _without_leap(t: FloatArray) -> BoolArray:
    """(n,) the rows of the largest part of a rising clock that has no leap in it; of equal ones the first."""
    part = np.cumsum(np.diff(t, prepend=t[:1]) > _LEAP)
    return np.asarray(part == np.argmax(np.bincount(part, minlength=1)), dtype=bool)


def rising(t: FloatArray) -> BoolArray:
    """(n,) the longest choice of rows whose time rises, by patience sorting: one wrong stamp costs one row."""
    if np.all(np.diff(t) > 0.0):
        return np.ones(len(t), dtype=bool)
    tops: list[float] = []
    rows: list[int] = []
    before = np.full(len(t), -1, dtype=np.int64)
    for k, value in enumerate(t.tolist()):
        pile = bisect_left(tops, value)
        before[k] = rows[pile - 1] if pile else -1
        tops[pile : pile + 1], rows[pile : pile + 1] = [value], [k]
    keep = np.zeros(len(t), dtype=bool)
    k = rows[-1] if rows else -1
    while k >= 0:
        keep[k] = True
        k = int(before[k])
    return keep
