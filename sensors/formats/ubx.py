"""u-blox UBX: the receiver's own solution (NAV-PVT) and its inertial sensor, every message checked by its checksum.

Source: u-blox F9 interface description (UBX-22008968), sections "UBX frame structure" and "UBX-NAV-PVT".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import FIRST, Choice, not_there
from sinan.sensors.formats.facts import Facts, Table
from sinan.sensors.formats.logged import recording_of
from sinan.sensors.formats.packed import read_plain
from sinan.sensors.formats.text_table import TextColumns
from sinan.sensors.formats.ubx_inertial import KINDS, Message, inertial
from sinan.sensors.recording import Recording, Stream

MAGIC = b"\xb5\x62"
_NAV_PVT = (0x01, 0x07)
_WEEK = 604_800.0
#: What the values of `fixType` mean, from 0 on, and those of a fix in three dimensions.
_FIX_TYPES = (
    "without a fix", "by dead reckoning alone", "in two dimensions", "in three dimensions",
    "in three dimensions with dead reckoning", "of the time only",
)  # fmt: skip
_IN_SPACE = (3, 4)
#: The columns of a GPS, and the fields and units that they are made of.
_GPS = {
    "latitude": ("lat", 1e-7), "longitude": ("lon", 1e-7), "height": ("height", 1e-3), "vel_north": ("velN", 1e-3),
    "vel_east": ("velE", 1e-3), "vel_down": ("velD", 1e-3), "eph": ("hAcc", 1e-3), "epv": ("vAcc", 1e-3),
    "s_variance": ("sAcc", 1e-3), "pdop": ("pDOP", 1e-2), "satellites": ("numSV", 1.0),
}  # fmt: skip
_PVT = np.dtype([
    ("iTOW", "<u4"), ("year", "<u2"), ("month", "u1"), ("day", "u1"), ("hour", "u1"), ("min", "u1"), ("sec", "u1"),
    ("valid", "u1"), ("tAcc", "<u4"), ("nano", "<i4"), ("fixType", "u1"), ("flags", "u1"), ("flags2", "u1"),
    ("numSV", "u1"), ("lon", "<i4"), ("lat", "<i4"), ("height", "<i4"), ("hMSL", "<i4"), ("hAcc", "<u4"),
    ("vAcc", "<u4"), ("velN", "<i4"), ("velE", "<i4"), ("velD", "<i4"), ("gSpeed", "<i4"), ("headMot", "<i4"),
    ("sAcc", "<u4"), ("headAcc", "<u4"), ("pDOP", "<u2"), ("flags3", "<u2"), ("reserved", "<u4"),
    ("headVeh", "<i4"), ("magDec", "<i2"), ("magAcc", "<u2"),
])  # fmt: skip


def read_ubx(path: Path) -> dict[str, FloatArray]:
    """The fields of NAV-PVT by name, in the receiver's units (iTOW ms, lat and lon 1e-7 deg, mm, mm/s).

    `carrSoln` is the carrier solution out of `flags`: 0 none, 1 float, 2 fixed. Bytes between messages are another
    protocol's and are passed over, as the receiver's makers intend; a message whose checksum fails is an error. A last
    message that is cut off, as a receiver without power leaves it, is left out, and a note says so.

    Raises
    ------
    InputError : a checksum that fails, a message cut off that is not the last, no NAV-PVT
    """
    messages, notes = _messages(path)
    table, _ = _solutions(path, messages.get(_NAV_PVT, []), notes)
    columns = {f"NAV-PVT.{name}": table[name].astype(np.float64) for name in _PVT.names or ()}
    columns["NAV-PVT.carrSoln"] = (table["flags"] >> 6).astype(np.float64)
    return TextColumns(columns, tuple(notes))


def _messages(path: Path) -> tuple[dict[tuple[int, int], list[Message]], list[str]]:
    """All messages, by class and number, and a note where the last one is cut off.

    Raises
    ------
    InputError : a checksum that fails, a message that is longer than the file and not the last
    """
    data = read_plain(path)
    found: dict[tuple[int, int], list[Message]] = {}
    position = data.find(MAGIC)
    while position >= 0:
        place = f"byte {position}"
        size = int.from_bytes(data[position + 4 : position + 6], "little")
        end = position + 8 + size
        if position + 8 > len(data) or end > len(data):
            if _whole_after(data, position + 2):
                raise InputError(path, f"a message of {size} bytes that is cut off", "a whole message", place)
            return found, [f"the last message is cut off: its {len(data) - position} bytes left out"]
        if _checksum(data[position + 2 : end - 2]) != data[end - 2 : end]:
            raise InputError(path, "a checksum that fails", "an undamaged message", place)
        message = Message(data[position + 6 : end - 2], position)
        found.setdefault((data[position + 2], data[position + 3]), []).append(message)
        position = data.find(MAGIC, end)
    return found, []


def _whole_after(data: bytes, position: int) -> bool:
    """Whether there is a whole message from a byte on: the length of the one before is then wrong."""
    while (position := data.find(MAGIC, position)) >= 0:
        end = position + 8 + int.from_bytes(data[position + 4 : position + 6], "little")
        if end <= len(data) and _checksum(data[position + 2 : end - 2]) == data[end - 2 : end]:
            return True
        position += 2
    return False


def _solutions(
    path: Path, messages: Sequence[Message], notes: Sequence[str] = ()
) -> tuple[NDArray[np.void], FloatArray]:
    """The fields of NAV-PVT, and their times [s], which go on over the end of a week."""
    if not messages:
        raise InputError(path, "; ".join(["no NAV-PVT message", *notes]), "the receiver's own solution")
    for message in messages:
        if len(message.payload) != _PVT.itemsize:
            found = f"NAV-PVT of {len(message.payload)} bytes"
            raise InputError(path, found, f"{_PVT.itemsize} (protocol 15 or later)", f"byte {message.byte}")
    table = np.frombuffer(b"".join(message.payload for message in messages), _PVT)
    return table, np.unwrap(table["iTOW"] * 1e-3, period=_WEEK)


def read_receiver(path: Path, choice: Choice = FIRST) -> Recording:
    """The receiver's fixes in three dimensions with what it says of them, and its inertial sensor where it has one: a
    flight. A GPS alone is a recording, too, which `sinan convert` writes beside an IMU's own files; so is an IMU alone.
    The week of the clock is not told.

    Parameters
    ----------
    choice : `imu` of ESF-RAW and ESF-MEAS, in this order, where both are there

    Raises
    ------
    InputError : what `read_ubx` and `inertial` find wrong; neither a fix in three dimensions nor an inertial sensor
    """
    replace(choice, imu=0).require_none(path, "of one receiver")
    messages, notes = _messages(path)
    kinds = _inertial_in(messages)
    if choice.imu and choice.imu >= len(kinds):
        not_there(path, "imu", choice.imu, len(kinds))
    streams: dict[str, Stream] = {}
    times: dict[int, float] = {}
    if _NAV_PVT in messages or not kinds:
        solved = messages.get(_NAV_PVT, [])
        table, t = _solutions(path, solved, notes)
        times = {message.byte: float(at) for message, at in zip(solved, t, strict=True)}
        fixed = np.isin(table["fixType"], _IN_SPACE) & (table["flags"] % 2 == 1)
        gps = {name: table[field].astype(np.float64) * unit for name, (field, unit) in _GPS.items()}
        streams["gps"] = Stream(t, gps).rows(fixed)
        if not np.any(fixed) and not kinds:
            found = f"no gps, since no solution is a fix in three dimensions: {_why_none(table)}"
            raise InputError(path, found, "a receiver that solves for its position")
        if not np.all(fixed):
            notes.append(f"gps: {int(np.sum(~fixed))} of {len(t)} solutions without a fix left out")
    if kinds:
        kind = kinds[choice.imu]
        streams["imu"], said = inertial(path, KINDS[kind], messages[kind], times)
        notes += said
    there = ("NAV-PVT", *(KINDS[kind] for kind in kinds))
    return recording_of(path, streams, notes=notes, there=there, needs="imu" if kinds else "gps")


def _why_none(table: NDArray[np.void]) -> str:
    """How many solutions are of which kind, of those that are no fix in three dimensions."""
    valid = table["flags"] % 2 == 1
    counts = {
        f"{what} (fixType {kind})": int(np.sum(table["fixType"] == kind)) for kind, what in enumerate(_FIX_TYPES)
        if kind not in _IN_SPACE
    }  # fmt: skip
    counts["not within the receiver's own limits (gnssFixOK)"] = int(
        np.sum(np.isin(table["fixType"], _IN_SPACE) & ~valid)
    )
    counts["of an unknown fixType"] = int(np.sum(table["fixType"] >= len(_FIX_TYPES)))
    return ", ".join(f"{count} {what}" for what, count in counts.items() if count)


def _inertial_in(messages: Mapping[tuple[int, int], Sequence[Message]]) -> list[tuple[int, int]]:
    return [kind for kind in KINDS if kind in messages]


def receiver_facts(path: Path) -> Facts:
    """What a log of a receiver says of itself."""
    messages, notes = _messages(path)
    kinds = _inertial_in(messages)
    tables = [Table(KINDS[kind], len(messages[kind])) for kind in kinds]
    if _NAV_PVT in messages or not kinds:
        _, t = _solutions(path, messages.get(_NAV_PVT, []), notes)
        tables.insert(0, Table("NAV-PVT", len(t), (float(t[0]), float(t[-1])), _PVT.names or ()))
    instances = {"imu": len(kinds), "mag": 0, "baro": 0, "gps": int(_NAV_PVT in messages)}
    return Facts("u-blox UBX", tables=tuple(tables), instances=instances)


def _checksum(body: bytes) -> bytes:
    """The 8-bit Fletcher checksum: a = sum of the bytes, b = sum of the a's, both modulo 256."""
    numbers = np.frombuffer(body, np.uint8).astype(np.int64)
    a = int(numbers.sum())
    b = int((numbers * np.arange(len(numbers), 0, -1)).sum())
    return bytes((a & 0xFF, b & 0xFF))
