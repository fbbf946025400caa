"""MWLOGV01: the binary log of a Simulink autopilot. It says how many signals a record has, not what they are.

Source: the course's log files and their reading script; 16 bytes of header, little endian, then records without gaps.
"""

from __future__ import annotations

import os
import struct
import time
from pathlib import Path
from types import TracebackType

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.files import cannot_write
from sinan.sensors.formats.packed import require_numbers

MAGIC = b"MWLOGV01"
#: magic, seconds since 1970, signals a record, type of a signal, bytes a record
_HEADER = struct.Struct("<8sIBBH")
_TYPES = {1: "<f8", 2: "<f4", 3: "<i4", 4: "<u4", 5: "<i2", 6: "<u2", 7: "i1", 8: "u1", 9: "u1"}


def read_mwlog(path: Path) -> dict[str, FloatArray]:
    """The signals of a log, `"1"` to `"k"` in their order, each (n,).

    Raises
    ------
    InputError : wrong magic, header cut off, unknown type, a record size that does not fit, a last record cut off
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_HEADER.size)
        if not head.startswith(MAGIC):
            raise InputError(path, f"magic {head[:8]!r}", f"{MAGIC!r}", "byte 0")
        if len(head) < _HEADER.size:
            raise InputError(path, f"a header of {len(head)} bytes", f"{_HEADER.size}", "byte 0")
        _, _, signals, kind, record_size = _HEADER.unpack(head)
        if kind not in _TYPES:
            raise InputError(path, f"type {kind}", "1 (double) to 9 (logical)", "byte 13")
        dtype = np.dtype(_TYPES[kind])
        if signals == 0 or record_size != signals * dtype.itemsize:
            expected = f"{signals} x {dtype.itemsize}" if signals else "at least one signal"
            raise InputError(path, f"records of {record_size} bytes with {signals} signals", expected, "byte 12")
        records, rest = divmod(size - _HEADER.size, record_size)
        if rest:
            found = f"{rest} bytes after {records} records of {record_size}: the last one is cut off"
            raise InputError(path, found, "whole records", f"byte {size - rest}")
        require_numbers(path, records * signals)
        data = np.fromfile(file, dtype, count=records * signals).reshape(records, signals).astype(np.float64)
    return {str(k + 1): data[:, k].copy() for k in range(signals)}


class MwlogWriter:
    """A log that is written as readings come, in whole records: what is killed leaves a log that can be read.

    Parameters
    ----------
    path : a new file, or one to be replaced
    signals : of a record, 1 to 255
    kind : type of the signals, as in the header; 2, the course's: single
    begun : seconds since 1970; None: now

    Raises
    ------
    InputError : it cannot be written, or so many signals have no place in a record
    """

    def __init__(self, path: Path, signals: int, kind: int = 2, begun: int | None = None) -> None:
        self.path, self.dtype = path, np.dtype(_TYPES[kind])
        if not 1 <= signals <= 255:
            raise InputError(path, f"{signals} signals", "1 to 255")
        self.signals = signals
        head = _HEADER.pack(MAGIC, int(time.time()) if begun is None else begun, signals, kind,
                            signals * self.dtype.itemsize)  # fmt: skip
        try:
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | getattr(os, "O_BINARY", 0), 0o666)
            os.write(self._file, head)
        except OSError as error:
            raise cannot_write(path, error, "a file that can be written") from None

    def write(self, records: FloatArray) -> None:
        """Append (n, signals) records.

        Raises
        ------
        InputError : another number of signals, a value that the type does not hold, a disk without room
        """
        rows = np.atleast_2d(np.asarray(records, dtype=np.float64))
        if rows.shape[1] != self.signals:
            raise InputError(self.path, f"records of {rows.shape[1]} signals", f"{self.signals}")
        with np.errstate(invalid="ignore", over="ignore"):
            data = rows.astype(self.dtype)
        if self.dtype.kind in "iu" and not np.array_equal(data.astype(np.float64), rows):
            raise InputError(self.path, "numbers that are not whole, or too large", f"{self.dtype.name}")
        try:
            os.write(self._file, data.tobytes())
        except OSError as error:
            raise cannot_write(self.path, error, "a file that can be written") from None

    def close(self) -> None:
        """End it."""
        os.close(self._file)

    def __enter__(self) -> MwlogWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()
