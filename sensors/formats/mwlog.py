"""MWLOGV01: the binary log of a Simulink autopilot. It says how many signals a record has, not what they are.

Source: the course's log files and their reading script; 16 bytes of header, little endian, then records without gaps.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.packed import require_numbers

MAGIC = b"MWLOGV01"
#: magic, time of day, signals a record, type of a signal, bytes a record
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
