"""The inertial sensor in a u-blox receiver: UBX-ESF-RAW and UBX-ESF-MEAS as an IMU on the clock of the fixes.

A reading is 24 bits of two's complement and a type of 6 bits; several readings share a time tag. Units: gyroscope 2^-12
deg/s, accelerometer 2^-10 m/s^2, temperature 0.01 deg C; tags of ESF-MEAS in milliseconds. Source: u-blox F9 HPS
interface description (UBX-22010984), sections UBX-ESF-MEAS, UBX-ESF-RAW, "ESF Measurement Data". It names no unit for
the tags of ESF-RAW: they are taken for the clock of the chip (Bosch's BMI160 counts 25 600 a second), which fixes
confirm or refuse. The chip's axes are taken for x forward, y to the left, z up. Neither is checked on a measured log:
there is none here. A module that lies flat has to read accel_z = -9.8 m/s^2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import FloatArray, IntArray
from sinan.sensors.errors import InputError
from sinan.sensors.recording import ACCEL, GYRO, Stream

RAW, MEASURED = "ESF-RAW", "ESF-MEAS"
KINDS = {(0x10, 0x03): RAW, (0x10, 0x02): MEASURED}
#: Seconds a tag.
_TICK = {RAW: 1.0 / 25_600.0, MEASURED: 1e-3}
_DEG = np.pi / 180.0
#: Types and units of what the chip reads: its x forward, y to the left, z up, into x forward, y to the right, z down.
_READINGS = {
    "gyro_x": (14, 2.0**-12 * _DEG), "gyro_y": (13, -(2.0**-12) * _DEG), "gyro_z": (5, -(2.0**-12) * _DEG),
    "accel_x": (16, 2.0**-10), "accel_y": (17, -(2.0**-10)), "accel_z": (18, -(2.0**-10)), "temperature": (12, 1e-2),
}  # fmt: skip
#: A clock that is off by more than this part is of another unit: crystals are good to 1e-4, that of a chip to 0.03.
_OFF = 0.1
#: A rate is learnt from fixes over so long at least [s].
_LONG = 20.0


@dataclass(frozen=True)
class Message:
    """One message of the file: its payload, and at which byte it begins."""

    payload: bytes
    byte: int


@dataclass(frozen=True)
class _Words:
    """(n,) readings in the order of the file: tag (as it is), type, value, and the byte of their message."""

    tag: IntArray
    kind: IntArray
    value: IntArray
    byte: IntArray


def inertial(
    path: Path, kind: str, messages: Sequence[Message], fixes: Mapping[int, float]
) -> tuple[Stream, list[str]]:
    """Rates and specific forces with the temperature [rad/s, m/s^2, deg C], and what was done to the clock.

    Parameters
    ----------
    kind : `RAW` or `MEASURED`
    fixes : time of each solution [s], by the byte of its message

    The clock of the chip is brought to that of the fixes by a straight line through the tags that stand before them in
    the file. *Neglects* the delay of the output, some 0.1 s (`gps.latency`).

    Raises
    ------
    InputError : a message whose size is none; no complete reading of all axes; a clock of another unit
    """
    words = _measured(path, messages) if kind == MEASURED else _raw(path, messages)
    t = _unwrapped(words.tag) * _TICK[kind]
    found = {name: _series(t, words, number, unit) for name, (number, unit) in _READINGS.items()}
    missing = [name for name in (*ACCEL, *GYRO) if not len(found[name][0])]
    if missing:
        raise InputError(path, f"no {', '.join(missing)} in {kind}", "a receiver with an inertial sensor")
    at, columns = _together(found)
    slope, offset, said = _clock(path, kind, t, words.byte, fixes)
    return Stream(slope * at + offset, columns), [f"imu: {kind}, x forward, y to the right, z down", *said]


def _measured(path: Path, messages: Sequence[Message]) -> _Words:
    """ESF-MEAS: a tag (or, where it is valid, a calibrated one behind the readings) and up to 31 readings."""
    rows: list[tuple[int, int, int]] = []
    for message in messages:
        body = message.payload
        flags = int.from_bytes(body[4:6], "little")
        count, calibrated = flags >> 11, bool(flags & 0x8)
        size = 8 + 4 * count + 4 * calibrated
        if len(body) < 8 or len(body) != size:
            raise InputError(path, f"ESF-MEAS of {len(body)} bytes", f"{size}", f"byte {message.byte}")
        tag = int.from_bytes(body[-4:] if calibrated else body[:4], "little")
        rows += [(tag, int.from_bytes(body[k : k + 4], "little"), message.byte) for k in range(8, 8 + 4 * count, 4)]
    return _words(rows)


def _raw(path: Path, messages: Sequence[Message]) -> _Words:
    """ESF-RAW: readings, each with its tag."""
    rows: list[tuple[int, int, int]] = []
    for message in messages:
        body = message.payload
        if len(body) < 4 or len(body) % 8 != 4:
            raise InputError(path, f"ESF-RAW of {len(body)} bytes", "4 and 8 a reading", f"byte {message.byte}")
        rows += [
            (int.from_bytes(body[k + 4 : k + 8], "little"), int.from_bytes(body[k : k + 4], "little"), message.byte)
            for k in range(4, len(body), 8)
        ]
    return _words(rows)


def _words(rows: Sequence[tuple[int, int, int]]) -> _Words:
    tag, word, byte = np.array(rows, dtype=np.int64).reshape(-1, 3).T
    value = (word & 0xFFFFFF) - ((word & 0x800000) << 1)
    return _Words(tag, (word >> 24) & 0x3F, value, byte)


def _unwrapped(tag: IntArray) -> FloatArray:
    """Tags that begin anew at 2^24 or 2^32, whichever they stay below."""
    period = 2**24 if len(tag) and int(tag.max()) < 2**24 else 2**32
    back = np.cumsum(np.diff(tag, prepend=tag[:1]) < -period // 2)
    return (tag + period * back).astype(np.float64)


def _series(t: FloatArray, words: _Words, number: int, unit: float) -> tuple[FloatArray, FloatArray]:
    rows = words.kind == number
    at, first = np.unique(t[rows], return_index=True)
    return at, words.value[rows][first] * unit


def _together(found: Mapping[str, tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, dict[str, FloatArray]]:
    """All at the times of the gyroscope's axes, between the accelerometer's first and last: read there where both
    have it, else on the line between two readings.
    """
    at = found[GYRO[0]][0]
    for name in GYRO[1:]:
        at = np.intersect1d(at, found[name][0])
    first = max(float(found[name][0][0]) for name in ACCEL)
    last = min(float(found[name][0][-1]) for name in ACCEL)
    at = at[(at >= first) & (at <= last)]
    columns = {name: np.interp(at, *series) for name, series in found.items() if len(series[0])}
    return at, columns


def _clock(
    path: Path, kind: str, t: FloatArray, byte: IntArray, fixes: Mapping[int, float]
) -> tuple[float, float, list[str]]:
    """Slope and offset [s] that bring the chip's clock to that of the fixes, and what is said of it."""
    places = np.array(sorted(fixes), dtype=np.int64)
    before = np.searchsorted(byte, places) - 1
    times = np.array([fixes[int(place)] for place in places])[before >= 0]
    tags = t[before[before >= 0]]
    if not len(tags):
        return 1.0, 0.0, []
    slope = 1.0
    if np.ptp(times) >= _LONG and np.ptp(tags) > 0.0:
        slope = float(np.polyfit(tags - tags[0], times - times[0], 1)[0])
        if abs(slope - 1.0) > _OFF:
            found = f"tags of {kind} whose second is {slope:.3g} s of the fixes"
            raise InputError(path, found, f"tags of {_TICK[kind] * 1e6:g} us")
    offset = float(np.median(times - slope * tags))
    note = f"imu: its clock set to that of the fixes by their order in the file (rate {slope:.5f}), good to some 0.1 s"
    return slope, offset, [note]
