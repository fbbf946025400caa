"""The messages of a MAVLink telemetry log (`.tlog`), as columns; `pymavlink` says what a message holds.

A log is a row of frames, each behind the time of its arrival: us since 1970, uint64, big endian. A frame is a mark
(0xFD, 0xFE in the first version), the length of its payload, a head of 10 (6) bytes with these two, the payload whose
zeros at the end may be missing, a checksum (CRC-16/MCRF4XX over all but the mark, and a byte that stands for the
message's definition), and a signature of 13 bytes where bit 0 of its flags says so. Source: MAVLink guide, "Packet
serialization".
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.errors import InputError, with_extra
from sinan.sensors.formats.packed import read_plain, require_numbers

_V2, _V1 = 0xFD, 0xFE
#: Bytes: the time before a frame, the head of a frame, its checksum, a signature.
_TIME, _HEADS, _CHECKSUM, _SIGNATURE = 8, {_V2: 10, _V1: 6}, 2, 13
#: First two bytes of a time between 2001 and 2104 [us].
_YEARS = (b"\x00\x03", b"\x00\x0f")
_LETTERS = {"c": "S", "b": "<i1", "B": "<u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8", "Q": "<u8",
            "f": "<f4", "d": "<f8"}  # fmt: skip
#: Systems that send: the vehicle of a ground station is one of 1 to 254; 255 is the ground station.
_GROUND = 255


def is_telemetry(head: bytes) -> bool:
    """Whether bytes begin with a time and a frame, and go on with another, as far as they go."""
    following = _following(head, 0, len(head) + 2**16)
    if following == 0:
        return False
    return following + _TIME >= len(head) or _begins(head, following)


def _begins(data: bytes, position: int) -> bool:
    """Whether a time and the mark of a frame stand at a byte."""
    year = data[position : position + 2]
    return _YEARS[0] <= year < _YEARS[1] and data[position + _TIME : position + _TIME + 1] in (b"\xfd", b"\xfe")


def _following(data: bytes, position: int, end: int) -> int:
    """The byte after the frame at a byte; the byte itself: there is none."""
    if position + _TIME + 3 > len(data) or not _begins(data, position):
        return position
    at = position + _TIME
    signed = data[at] == _V2 and data[at + 2] & 1
    size = _HEADS[data[at]] + data[at + 1] + _CHECKSUM + (_SIGNATURE if signed else 0)
    return at + size if at + size <= end else position


@dataclass
class Telemetry:
    """The messages of one vehicle.

    Attributes
    ----------
    path : of the log
    counts : of messages, by name
    notes : what could not be read
    """

    path: Path
    counts: dict[str, int]
    notes: tuple[str, ...]
    _tables: dict[str, tuple[FloatArray, np.ndarray, IntArray]]

    def __contains__(self, name: object) -> bool:
        return name in self._tables

    def has(self, name: str, part: str) -> bool:
        """Whether there are messages of a kind with this field."""
        return name in self._tables and part in (self._tables[name][1].dtype.names or ())

    def arrived(self, name: str) -> FloatArray:
        """(n,) when the messages of a kind came [s since 1970]."""
        return self._tables[name][0]

    def numbers(self, name: str, part: str) -> FloatArray:
        """(n,) or (n, k) a field as its numbers are sent."""
        return np.asarray(self._tables[name][1][part], dtype=np.float64)

    def texts(self, name: str, part: str) -> list[str]:
        """A field of texts."""
        return [bytes(one).split(b"\0")[0].decode("utf-8", "replace") for one in self._tables[name][1][part]]

    def raw(self, name: str, part: str) -> np.ndarray:
        """A field with its own type."""
        return np.asarray(self._tables[name][1][part])

    def places(self, name: str) -> IntArray:
        """(n,) where in the log the messages of a kind stand [bytes]."""
        return self._tables[name][2]

    def between(self, start: int, stop: int) -> Telemetry:
        """The messages that stand from one byte of the log to before another."""
        tables = {}
        for name, (arrived, table, places) in self._tables.items():
            a, b = np.searchsorted(places, [start, stop]).tolist()
            if b > a:
                tables[name] = arrived[a:b], table[a:b], places[a:b]
        return Telemetry(self.path, {name: len(table[0]) for name, table in tables.items()}, self.notes, tables)


@dataclass
class _Frames:
    """Where the frames of one kind and length are."""

    at: array[int] = field(default_factory=lambda: array("q"))


def read_telemetry(path: Path) -> Telemetry:
    """All messages of the vehicle that sends most; frames with a wrong checksum are passed over and counted.

    Raises
    ------
    InputError : no `pymavlink`, no telemetry log, one without a message that is known
    """
    return telemetry_of(read_plain(path), path)


def telemetry_of(data: bytes, path: Path) -> Telemetry:
    """The same of the bytes of a log, or of a part of one; `path` is how messages call it."""
    try:
        from pymavlink.dialects.v20.ardupilotmega import mavlink_map
    except ImportError:
        raise InputError(path, "a MAVLink log, whose messages `pymavlink` knows", with_extra("mavlink")) from None
    frames, lost, places = _walk(data)
    raw = np.frombuffer(data, np.uint8)
    require_numbers(path, sum(len(one.at) for one in frames.values()))
    systems = _systems(raw, frames)
    if not systems:
        raise InputError(path, "no MAVLink message", "a telemetry log (.tlog)")
    vehicle = max(systems, key=lambda system: systems[system])
    parts: dict[str, list[tuple[IntArray, np.ndarray]]] = {}
    wrong = 0
    for (mark, kind, length), one in frames.items():
        known = mavlink_map.get(kind)
        if known is None:
            continue
        starts = np.frombuffer(one.at, np.int64)
        head = _HEADS[mark]
        starts = starts[raw[starts + (5 if mark == _V2 else 3)] == vehicle]
        if len(starts) == 0:
            continue
        good = _checked(raw, starts, head + length, known.crc_extra)
        wrong += int(np.sum(~good))
        if np.any(good):
            payload = _payload(raw, starts[good] + head, length, known)
            parts.setdefault(known.msgname, []).append((starts[good], payload))
    tables = {name: _joined(raw, found) for name, found in parts.items()}
    if not tables:
        raise InputError(path, "no message that is whole", "a telemetry log (.tlog)")
    notes = [f"{lost} bytes that are no frame: not read, at {places} places"] if lost else []
    notes += [f"{wrong} messages with a wrong checksum: not read"] if wrong else []
    if others := sorted(set(systems) - {vehicle, _GROUND}):
        notes.append(f"system {vehicle} is read, not {', '.join(map(str, others))}")
    counts = {name: len(table[0]) for name, table in sorted(tables.items())}
    return Telemetry(path, counts, tuple(notes), tables)


def _walk(data: bytes) -> tuple[dict[tuple[int, int, int], _Frames], int, int]:
    """The frames by mark, kind and length of the payload; how many bytes are none, and at how many places."""
    frames: dict[tuple[int, int, int], _Frames] = {}
    position, end, lost, places = 0, len(data), 0, 0
    while position < end:
        following = _following(data, position, end)
        if following == position:
            found = _next(data, position + 1)
            lost, places, position = lost + found - position, places + 1, found
            continue
        at = position + _TIME
        mark, length = data[at], data[at + 1]
        kind = data[at + 5] if mark == _V1 else int.from_bytes(data[at + 7 : at + 10], "little")
        key = mark, kind, length
        if key not in frames:
            frames[key] = _Frames()
        frames[key].at.append(at)
        position = following
    return frames, lost, places


def _next(data: bytes, start: int) -> int:
    """Where the next frame begins that another follows, or the end of the file."""
    end = len(data)
    while (position := data.find(b"\x00", start)) >= 0:
        following = _following(data, position, end)
        if following > position and (following == end or _begins(data, following)):
            return position
        start = position + 1
    return end


def _systems(raw: np.ndarray, frames: Mapping[tuple[int, int, int], _Frames]) -> dict[int, int]:
    """How many frames each system has sent, ground stations last."""
    counts: dict[int, int] = {}
    for (mark, _, _), one in frames.items():
        system = raw[np.frombuffer(one.at, np.int64) + (5 if mark == _V2 else 3)]
        for number, count in zip(*np.unique(system, return_counts=True), strict=True):
            counts[int(number)] = counts.get(int(number), 0) + int(count)
    return {number: 0 if number == _GROUND else count for number, count in counts.items()}


def _checked(raw: np.ndarray, starts: IntArray, size: int, extra: int) -> BoolArray:
    """(n,) whether the checksum behind frames of one size [bytes, from the mark on] is theirs."""
    crc: np.ndarray = np.full(len(starts), 0xFFFF, dtype=np.uint16)
    for k in range(1, size + 1):
        byte = raw[starts + k].astype(np.uint16) if k < size else np.full(len(starts), extra, dtype=np.uint16)
        mixed = (byte ^ crc) & 0xFF
        mixed = (mixed ^ (mixed << 4)) & 0xFF
        crc = (crc >> 8) ^ (mixed << 8) ^ (mixed << 3) ^ (mixed >> 4)
    said = raw[starts + size].astype(np.uint16) | (raw[starts + size + 1].astype(np.uint16) << 8)
    return np.asarray(crc == said)


def _payload(raw: np.ndarray, starts: IntArray, length: int, known: Any) -> np.ndarray:
    """(n,) the fields of messages of one length; zeros at the end that were not sent are added."""
    letters = known.native_format.decode().lstrip("<")
    fields: list[Any] = []
    for name, letter, count in zip(known.ordered_fieldnames, letters, known.array_lengths, strict=True):
        kind = _LETTERS[letter]
        fields.append((name, f"S{max(count, 1)}") if kind == "S" else (name, kind, (count,)) if count else (name, kind))
    dtype = np.dtype(fields)
    table = np.zeros((len(starts), dtype.itemsize), dtype=np.uint8)
    for k in range(min(length, dtype.itemsize)):
        table[:, k] = raw[starts + k]
    return table.view(dtype)[:, 0]


def _joined(raw: np.ndarray, parts: list[tuple[IntArray, np.ndarray]]) -> tuple[FloatArray, np.ndarray, IntArray]:
    """When the messages of all lengths came [s since 1970], these in the order of the file, and where they stand."""
    starts = np.concatenate([at for at, _ in parts])
    order = np.argsort(starts, kind="stable")
    stamps = np.zeros((len(starts), _TIME), dtype=np.uint8)
    for k in range(_TIME):
        stamps[:, k] = raw[starts + (k - _TIME)]
    arrived = stamps.view(">u8")[:, 0].astype(np.float64) * 1e-6
    return arrived[order], np.concatenate([table for _, table in parts])[order], starts[order]
