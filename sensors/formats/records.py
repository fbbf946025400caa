"""Binary logs of fixed records, as many hobby loggers write them: what a record holds is said by the map."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import FloatArray, IntArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.packed import read_plain, require_numbers

#: The names of the types, as in a data sheet.
TYPES = {
    "uint8": "u1", "int8": "i1", "uint16": "u2", "int16": "i2", "uint32": "u4", "int32": "i4", "uint64": "u8",
    "int64": "i8", "float32": "f4", "float64": "f8",
}  # fmt: skip


@dataclass(frozen=True)
class RecordLayout:
    """What a record holds.

    Attributes
    ----------
    fields : (name, type) in order
    magic : value of the first field in every record; None: not checked
    tail : (name, type) of fields that follow only where the field `tail_if` is not zero
    tail_if : see `tail`
    big_endian : byte order
    """

    fields: tuple[tuple[str, str], ...]
    magic: int | None = None
    tail: tuple[tuple[str, str], ...] = ()
    tail_if: str = ""
    big_endian: bool = False

    def dtype(self, fields: tuple[tuple[str, str], ...]) -> np.dtype[np.void]:
        """The numpy type of some of the fields."""
        order = ">" if self.big_endian else "<"
        return np.dtype([(name, order + TYPES[kind]) for name, kind in fields])


def read_records(path: Path, layout: RecordLayout) -> dict[str, FloatArray]:
    """The fields of all records by name, each (n,); `row` counts the records, `tail.row` those with a tail.

    Raises
    ------
    InputError : a record without its magic (names the byte), a last record that is cut off, no record
    """
    data = read_plain(path)
    head = layout.dtype(layout.fields)
    tail = layout.dtype(layout.tail)
    starts, with_tail = _starts(path, data, layout, head, tail)
    require_numbers(path, len(starts) * len(layout.fields) + len(with_tail) * len(layout.tail))
    raw = np.frombuffer(data, np.uint8)
    columns = fields_at(raw, starts, head, head.names or ())
    columns["row"] = np.arange(len(starts), dtype=np.float64)
    if layout.tail:
        found = fields_at(raw, starts[with_tail] + head.itemsize, tail, tail.names or ())
        columns.update({f"tail.{name}": values for name, values in found.items()})
        columns["tail.row"] = with_tail.astype(np.float64)
    return columns


def _starts(
    path: Path, data: bytes, layout: RecordLayout, head: np.dtype[np.void], tail: np.dtype[np.void]
) -> tuple[IntArray, IntArray]:
    """The byte at which each record starts, and the indices of those that have a tail."""
    starts, tails = array("q"), array("q")
    position = 0
    while position < len(data):
        place = f"byte {position}, record {len(starts) + 1}"
        if position + head.itemsize > len(data):
            raise InputError(path, f"a record cut off after {len(data) - position} bytes", f"{head.itemsize}", place)
        record = np.frombuffer(data, head, count=1, offset=position)[0]
        if layout.magic is not None and record[0] != layout.magic:
            found = f"0x{int(record[0]):x}" if isinstance(record[0], np.integer) else f"{record[0]}"
            raise InputError(path, f"{found} at the start of a record", f"0x{layout.magic:x}", place)
        starts.append(position)
        position += head.itemsize
        if layout.tail_if and record[layout.tail_if] != 0:
            if position + tail.itemsize > len(data):
                raise InputError(path, "a record whose tail is cut off", f"{tail.itemsize} bytes of it", place)
            tails.append(len(starts) - 1)
            position += tail.itemsize
    if not starts:
        raise InputError(path, "no record", "at least one", "byte 0")
    return np.array(starts, dtype=np.int64), np.array(tails, dtype=np.int64)


def fields_at(
    raw: np.ndarray, starts: IntArray, dtype: np.dtype[np.void], names: Sequence[str]
) -> dict[str, FloatArray]:
    """Some fields of the records that start at some bytes; byte by byte of a field: an index takes eight bytes."""
    columns = {}
    for name in names:
        assert dtype.fields is not None
        kind, offset, *_ = dtype.fields[name]
        values = np.empty((len(starts), kind.itemsize), dtype=np.uint8)
        for k in range(kind.itemsize):
            values[:, k] = raw[starts + (offset + k)]
        with np.errstate(invalid="ignore"):  # what signals that it is no number still is none
            columns[name] = values.view(kind)[:, 0].astype(np.float64)
    return columns
