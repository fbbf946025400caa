"""u-blox UBX: the receiver's own solution (NAV-PVT), every message checked by its checksum.

Source: u-blox F9 interface description (UBX-22008968), sections "UBX frame structure" and "UBX-NAV-PVT".
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.formats.facts import Facts, Table
from sinan.sensors.formats.logged import recording_of
from sinan.sensors.formats.packed import read_plain
from sinan.sensors.recording import Recording, Stream

MAGIC = b"\xb5\x62"
_NAV_PVT = (0x01, 0x07)
_WEEK = 604_800.0
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
    protocol's and are passed over, as the receiver's makers intend; a message whose checksum fails is an error.

    Raises
    ------
    InputError : a checksum that fails, a message cut off before the end, no NAV-PVT
    """
    data = read_plain(path)
    payloads: list[bytes] = []
    position = data.find(MAGIC)
    while position >= 0:
        place = f"byte {position}"
        size = int.from_bytes(data[position + 4 : position + 6], "little")
        end = position + 8 + size
        if position + 8 > len(data) or end > len(data):
            raise InputError(path, f"a message of {size} bytes that is cut off", "a whole message", place)
        if _checksum(data[position + 2 : end - 2]) != data[end - 2 : end]:
            raise InputError(path, "a checksum that fails", "an undamaged message", place)
        if (data[position + 2], data[position + 3]) == _NAV_PVT:
            if size != _PVT.itemsize:
                raise InputError(path, f"NAV-PVT of {size} bytes", f"{_PVT.itemsize} (protocol 15 or later)", place)
            payloads.append(data[position + 6 : end - 2])
        position = data.find(MAGIC, end)
    if not payloads:
        raise InputError(path, "no NAV-PVT message", "the receiver's own solution")
    table = np.frombuffer(b"".join(payloads), _PVT)
    columns = {f"NAV-PVT.{name}": table[name].astype(np.float64) for name in _PVT.names or ()}
    columns["NAV-PVT.carrSoln"] = (table["flags"] >> 6).astype(np.float64)
    return columns


def read_receiver(path: Path, choice: Choice = FIRST) -> Recording:
    """The receiver's fixes in three dimensions with what it says of them, as a recording of a GPS alone: what
    `sinan convert` writes lies beside an IMU's own files. The week of the clock is not told.

    Raises
    ------
    InputError : what `read_ubx` finds wrong; no fix in three dimensions
    """
    choice.require_none(path, "of one receiver")
    columns = {name.removeprefix("NAV-PVT."): values for name, values in read_ubx(path).items()}
    fixed = (columns["fixType"] >= 3) & (columns["fixType"] <= 4) & (columns["flags"].astype(np.int64) % 2 == 1)
    t = np.unwrap(columns["iTOW"] * 1e-3, period=_WEEK)
    gps = {name: columns[field] * unit for name, (field, unit) in _GPS.items()}
    notes = [f"gps: {int(np.sum(~fixed))} of {len(t)} solutions without a fix left out"] if not np.all(fixed) else []
    return recording_of(path, {"gps": Stream(t, gps).rows(fixed)}, notes=notes, there=("NAV-PVT",), needs="gps")


def receiver_facts(path: Path) -> Facts:
    """What a log of a receiver says of itself."""
    t = read_ubx(path)["NAV-PVT.iTOW"] * 1e-3
    table = Table("NAV-PVT", len(t), (float(t[0]), float(t[-1])), _PVT.names or ())
    return Facts("u-blox UBX", tables=(table,), instances={"imu": 0, "mag": 0, "baro": 0, "gps": 1})


def _checksum(body: bytes) -> bytes:
    """The 8-bit Fletcher checksum: a = sum of the bytes, b = sum of the a's, both modulo 256."""
    numbers = np.frombuffer(body, np.uint8).astype(np.int64)
    a = int(numbers.sum())
    b = int((numbers * np.arange(len(numbers), 0, -1)).sum())
    return bytes((a & 0xFF, b & 0xFF))
