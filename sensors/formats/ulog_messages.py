"""The messages of a ULog, and their data as columns. What is whole is read, what is damaged passed over and counted.

A message is its size (uint16, little endian), its type (a letter) and that many bytes. `F` names the fields of a
format, `A` announces a topic of some format under a number, `D` is a reading of the topic of its number. Source: PX4
user guide, "ULog file format".
"""

from __future__ import annotations

import re
import struct
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.packed import read_plain
from sinan.sensors.formats.records import fields_at

MAGIC = b"ULog\x01\x12\x35"

#: Bytes of the file's header: magic, version, time stamp of the start.
_FILE_HEADER = 16
#: Bytes of a message's header, size and type; and of a reading's, with the number of its topic.
_HEADER, _NUMBER, _READING = 3, 2, 5
_READING_HEADER, _D = struct.Struct("<HBH"), ord("D")
#: What follows the header, by type: key and value, their length before them; severity and time of what was logged.
_VALUE, _LOGGED = rb"[!-~]+ [!-~]+.*", rb"[0-7\0-\x07]"
_BODIES = {
    kind: re.compile(body, re.DOTALL)
    for kind, body in {
        b"B": rb".{40,}", b"F": rb"\w{1,200}:[\w\[\]; ]*", b"A": rb"...\w{1,200}", b"R": rb"..", b"D": rb"..+",
        b"I": rb"." + _VALUE, b"M": rb".." + _VALUE, b"P": rb"." + _VALUE, b"Q": rb".." + _VALUE,
        b"L": _LOGGED + rb".{8,}", b"C": _LOGGED + rb".{10,}", b"O": rb"..",
        b"S": re.escape(bytes.fromhex("2f731320250cbb12")),
    }.items()
}  # fmt: skip
#: Flags in bytes 8 to 15 of `B` that say what a reader must know: bit 0, data were appended after a crash.
_APPENDED = 1
_BASE = {
    "int8_t": "<i1", "uint8_t": "<u1", "int16_t": "<i2", "uint16_t": "<u2", "int32_t": "<i4", "uint32_t": "<u4",
    "int64_t": "<i8", "uint64_t": "<u8", "float": "<f4", "double": "<f8", "bool": "<i1", "char": "<i1",
}  # fmt: skip
_FIELD = re.compile(r"(\w+)(?:\[(\d{1,5})\])? (\w+)", re.ASCII)
#: The largest message, and so the most fields of a reading; how deep formats lie in one another.
_LARGEST, _DEEPEST = 2**16, 8
#: Texts that are kept of those that a log told its user.
_MOST_TEXTS = 1000


@dataclass
class _Topic:
    """An announced topic.

    Attributes
    ----------
    dtype : of a reading, without the padding at its end
    least, size : of a reading without and with it [bytes]
    at : where in the file each reading begins [bytes]
    """

    dtype: np.dtype[np.void]
    least: int
    size: int
    at: array[int] = field(default_factory=lambda: array("q"))

    @property
    def clock(self) -> int | None:
        """Where its time stamp is within a reading [bytes]."""
        if self.dtype.fields is None or "timestamp" not in self.dtype.fields:
            return None
        kind, offset, *_ = self.dtype.fields["timestamp"]
        return int(offset) if kind == np.dtype("<u8") else None


@dataclass
class _Loss:
    """What of one kind could not be read: how often, how many bytes, and where first."""

    count: int = 0
    size: int = 0
    first: int = 0
    names: dict[str, None] = field(default_factory=dict)

    def add(self, at: int, size: int, name: str = "") -> None:
        self.first = self.first if self.count else at
        self.count, self.size = self.count + 1, self.size + size
        if len(self.names) < 5 and name:
            self.names[name] = None

    def shown(self, what: str) -> str:
        some = "one such place" if self.count == 1 else f"{self.count} such places"
        names = f" ({', '.join(self.names)})" if self.names else ""
        return f"{what}{names}: not read, {some}, {self.size} bytes, the first at byte {self.first}"


@dataclass
class Said:
    """What a log says of itself: parameters as they were last, information (`sys_name`, `ver_sw`), texts."""

    parameters: dict[str, float] = field(default_factory=dict)
    information: dict[str, str] = field(default_factory=dict)
    texts: list[str] = field(default_factory=list)

    def take(self, kind: bytes, body: bytes) -> None:
        """Take in a message of a parameter, of information or of a text."""
        if kind == b"L":
            if len(self.texts) < _MOST_TEXTS:
                self.texts.append(body[9:].decode("utf-8", "replace"))
            return
        key, value = body[1 : 1 + body[0]].decode("ascii", "replace"), body[1 + body[0] :]
        base, _, name = key.partition(" ")
        if kind == b"P" and base in ("int32_t", "float") and len(value) == 4:
            self.parameters[name] = float(struct.unpack("<i" if base == "int32_t" else "<f", value)[0])
        elif kind == b"I" and base.startswith("char["):
            self.information[name] = value.decode("utf-8", "replace").rstrip("\0")


class Fields(Mapping[str, FloatArray]):
    """All fields of a log by `topic.field`, each (n,); a further instance k of a topic is `topic#k.field`.

    A column is made when it is asked for.
    """

    _names: Mapping[str, tuple[str, str]]

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


class Topics(Fields):
    """Those of a ULog.

    Parameters
    ----------
    data : of the file
    topics : by name
    said : what the log says of itself
    notes : what could not be read
    """

    def __init__(self, data: bytes, topics: Mapping[str, _Topic], said: Said, notes: tuple[str, ...]) -> None:
        self._raw = np.frombuffer(data, np.uint8)
        self._topics, self.said, self.notes = topics, said, notes
        self._names = {
            f"{name}.{column}": (name, column) for name, topic in topics.items() for column in topic.dtype.names or ()
        }

    def __getitem__(self, name: str) -> FloatArray:
        topic, column = self._names[name]
        found = self._topics[topic]
        return fields_at(self._raw, np.array(found.at, dtype=np.int64), found.dtype, (column,))[column]

    def rows(self, topic: str) -> int:
        """How many readings of a topic there are."""
        return len(self._topics[topic].at)

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics that have a reading."""
        return tuple(sorted(self._topics))


def read_topics(path: Path) -> Topics:
    """All topics that have a reading. Times are in us.

    Raises
    ------
    InputError : no ULog, one that needs another reader, or one without data
    """
    data = read_plain(path)
    if not data.startswith(MAGIC) or len(data) < _FILE_HEADER:
        raise InputError(path, f"it begins with {data[:8]!r}", "a ULog", "byte 0")
    log = _Messages(path, data)
    log.read()
    topics = {name: topic for name, topic in log.topics.items() if topic.at}
    notes = log.notes()
    if not topics:
        raise InputError(path, "no reading of any topic" + (f" ({notes[0]})" if notes else ""), "a log with data")
    return Topics(data, topics, log.said, notes)


def _members(inside: str, kind: str, count: str | None, name: str) -> list[tuple[str, str]]:
    """Name and type of each element of a field; `inside` is the field that it is a part of."""
    whole = f"{inside}.{name}" if inside else name
    return [(whole, kind)] if count is None else [(f"{whole}[{k}]", kind) for k in range(min(int(count), _LARGEST))]


class _Messages:
    """The messages of one file, walked through from the first to the last.

    Parameters
    ----------
    path, data : of the file
    """

    def __init__(self, path: Path, data: bytes) -> None:
        self.path, self.data = path, data
        self.formats: dict[str, str] = {}
        self.topics: dict[str, _Topic] = {}
        self.announced: dict[int, tuple[str, _Topic]] = {}
        self.losses: dict[str, _Loss] = {}
        self.said = Said()
        self._landmarks: re.Pattern[bytes] | None = None

    def read(self) -> None:
        """Walk through the file: up to where data were appended after a crash, and through these."""
        appended = [k for k in self._flags() if _FILE_HEADER < k < len(self.data)]
        for start, end in zip([_FILE_HEADER, *appended], [*appended, len(self.data)], strict=True):
            self._section(start, end, cut_off_expected=end < len(self.data))

    def notes(self) -> tuple[str, ...]:
        """What was not read, a sentence a kind."""
        return tuple(loss.shown(what) for what, loss in self.losses.items())

    def _flags(self) -> list[int]:
        """Where data were appended, in order; an error where the log needs a reader that knows more."""
        if self.data[_FILE_HEADER + 2 : _FILE_HEADER + 3] != b"B":
            return []
        body = self.data[_FILE_HEADER + 3 : _FILE_HEADER + 3 + 40]
        needed = body[8:16]
        if any(needed[1:]) or needed[:1] > bytes([_APPENDED]):
            found = f"flags {needed.hex()} of what a reader has to know"
            raise InputError(self.path, found, "a log of the first version", f"byte {_FILE_HEADER}")
        return sorted(struct.unpack("<3Q", body[16:40])) if needed[:1] == b"\1" and len(body) == 40 else []

    def _section(self, start: int, end: int, cut_off_expected: bool) -> None:
        position = start
        while (position := self._readings(position, end)) < end:
            following = self._following(position, end)
            if following is not None and self.data[position + 2] != _D:
                self._take(position, following)
                position = following
                continue
            if cut_off_expected and end - position < _LARGEST and position + self._size(position) > end:
                return
            found = self._landmark(position + 1, end)
            self._lose(*self._what(position, following, found, end), position, found - position)
            position = found

    def _readings(self, position: int, end: int) -> int:
        """Take in the readings that begin at a byte, one after the other, most of a file; the byte after them."""
        data, announced = self.data, self.announced
        while position + _READING <= end:
            size, kind, number = _READING_HEADER.unpack_from(data, position)
            following = position + _HEADER + size
            if kind != _D or number not in announced or following > end:
                break
            topic = announced[number][1]
            if not topic.least <= size - _NUMBER <= topic.size:
                break
            topic.at.append(position + _READING)
            position = following
        return position

    def _what(self, position: int, following: int | None, found: int, end: int) -> tuple[str, str]:
        """What the bytes up to the next message are, and of which topic."""
        if following is None or following != found or self.data[position + 2 : position + 3] != b"D":
            return ("bytes that are no message" if found < end else "what is after the last whole message"), ""
        name, topic = self._topic_of(position)
        return f"readings of {'topics that are not announced' if topic is None else 'another size'}", name

    def _size(self, position: int) -> int:
        """What a message at a byte says of its length, its header with it [bytes]."""
        return _HEADER + int.from_bytes(self.data[position : position + 2], "little")

    def _following(self, position: int, end: int) -> int | None:
        """The byte after the message at a byte; None: there is none."""
        body, following = position + _HEADER, position + self._size(position)
        if following > end or body > end:
            return None
        kind = self.data[position + 2 : position + 3]
        pattern = _BODIES.get(kind)
        return following if pattern and pattern.fullmatch(self.data, body, following) else None

    def _topic_of(self, position: int) -> tuple[str, _Topic | None]:
        """What the number of a reading stands for; without an announcement the number."""
        number = int.from_bytes(self.data[position + _HEADER : position + _READING], "little")
        return self.announced.get(number, (f"number {number}", None))

    def _take(self, position: int, following: int) -> None:
        """Take in the message between two bytes, which is no reading."""
        kind, body = self.data[position + 2 : position + 3], position + _HEADER
        if kind == b"F":
            name, _, fields = self.data[body:following].decode("ascii").partition(":")
            self.formats[name] = fields
        elif kind == b"A":
            self._announce(position, self.data[body:following])
        elif kind == b"R":
            self.announced.pop(int.from_bytes(self.data[body:following], "little"), None)
        elif kind in (b"P", b"I", b"L"):
            self.said.take(kind, self.data[body:following])

    def _announce(self, position: int, body: bytes) -> None:
        """Take in a topic; what has its number from then on is its."""
        kind = body[3:].decode("ascii", "replace")
        number = int.from_bytes(body[1:3], "little")
        fields = self._flatten(kind)
        if not fields:
            self._lose("topics without a format that can be read", kind, position, _HEADER + len(body))
            self.announced.pop(number, None)
            return
        size = sum(np.dtype(base).itemsize for _, base in fields)
        while fields and fields[-1][0].startswith("_padding"):
            fields.pop()
        dtype = np.dtype(fields)
        name = kind if body[0] == 0 else f"{kind}#{body[0]}"
        topic = self.topics.get(name)
        if topic is None or topic.dtype != dtype:
            if topic is not None:
                self._lose(
                    "topics that were announced before with other fields", name, topic.at[0] if topic.at else 0, 0
                )
            topic = self.topics[name] = _Topic(dtype, dtype.itemsize, size)
        self.announced[number] = name, topic
        self._landmarks = None

    def _flatten(self, kind: str) -> list[tuple[str, str]] | None:
        """The fields of a format, name and type, those of the formats within it in their places; None: it is none.

        What is left to do is a stack, and every step counts: formats without a field nest as deep as they like.
        """
        fields: list[tuple[str, str]] = []
        left = [("", kind)]
        for _ in range(_LARGEST):
            if not left:
                return fields if len({name for name, _ in fields}) == len(fields) else None
            name, kind = left.pop()
            if kind in _BASE:
                fields.append((name, _BASE[kind]))
                continue
            parts = [_FIELD.fullmatch(part) for part in self.formats.get(kind, "-").split(";") if part]
            inside = [member for part in parts if part for member in _members(name, *part.groups())]
            if not all(parts) or len(inside) > _LARGEST or name.count(".") > _DEEPEST:
                return None
            left += reversed(inside)
        return None

    def _landmark(self, start: int, end: int) -> int:
        """The next byte that is surely the start of a message, the end where there is none: of a sync mark, a reading
        whose number and size fit, a format or an announcement.
        """
        if self._landmarks is None:
            sizes = {
                (number, size) for number, (_, topic) in self.announced.items() for size in {topic.least, topic.size}
            }
            readings = [re.escape(struct.pack("<HcH", size + 2, b"D", number)) for number, size in sizes]
            self._landmarks = re.compile(
                b"|".join([rb"\x08\0S", *readings, rb"..F\w{1,200}:", rb"..A...\w"]), re.DOTALL
            )
        while match := self._landmarks.search(self.data, start, end):
            if self._following(match.start(), end) is not None and not self._is_stale(match.start()):
                return match.start()
            start = match.start() + 1
        return end

    def _is_stale(self, position: int) -> bool:
        """Whether a reading is older than the last one of its topic: a piece of what was written before."""
        _, topic = self._topic_of(position)
        if self.data[position + 2 : position + 3] != b"D" or topic is None or not topic.at or topic.clock is None:
            return False
        this, last = (
            int.from_bytes(self.data[at + topic.clock : at + topic.clock + 8], "little")
            for at in (position + _READING, topic.at[-1])
        )
        return this < last

    def _lose(self, what: str, name: str, at: int, size: int) -> None:
        self.losses.setdefault(what, _Loss()).add(at, size, name)
