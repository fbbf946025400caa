"""A receiver with an inertial sensor, whose messages another implementation has written (pyubx2)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import pyubx2

from sinan.sensors.errors import InputError
from sinan.sensors.formats import facts_of, open_log
from sinan.sensors.formats.choice import Choice
from tests.sensors.test_formats_logs import solution

ROLL_RATE, TURN = np.radians(10.0), np.radians(-4.0)  # about x and, of the recording, about z down
READINGS = {14: 10.0 * 2**12, 13: 0.0, 5: 4.0 * 2**12, 16: 1.5 * 2**10, 17: -0.5 * 2**10, 18: 9.75 * 2**10, 12: 3125.0}
GYRO, ACCEL = (5, 13, 14, 12), (16, 17, 18)


def word(kind: int) -> int:
    return kind << 24 | round(READINGS[kind]) & 0xFFFFFF


def measured(ms: int, kinds: tuple[int, ...], calibrated: int | None = None) -> bytes:
    flags = len(kinds) << 11 | (0x8 if calibrated is not None else 0)
    words = [ms, flags | 0 << 16, *(word(kind) for kind in kinds), *([] if calibrated is None else [calibrated])]
    payload = b"".join(number.to_bytes(4, "little") for number in words)
    return bytes(pyubx2.UBXMessage("ESF", "ESF-MEAS", pyubx2.GET, payload=payload).serialize())


def raw(tags: list[int], kinds: tuple[int, ...] = (*GYRO, *ACCEL)) -> bytes:
    words = [number for tag in tags for kind in kinds for number in (word(kind), tag)]
    payload = b"".join(number.to_bytes(4, "little") for number in (0, *words))
    return bytes(pyubx2.UBXMessage("ESF", "ESF-RAW", pyubx2.GET, payload=payload).serialize())


def require_as_hidden(imu: object) -> None:
    for name, expected in {"gyro_x": ROLL_RATE, "gyro_y": 0.0, "gyro_z": TURN, "accel_x": 1.5, "accel_y": 0.5,
                           "accel_z": -9.75, "temperature": 31.25}.items():  # fmt: skip
        np.testing.assert_allclose(imu[name], expected, atol=1e-12, err_msg=name)  # type: ignore[index]


def test_the_second_implementation_reads_the_same_words() -> None:
    parsed = pyubx2.UBXReader.parse(measured(1000, (18, 16)))
    assert (parsed.numMeas, parsed.dataType_01, parsed.dataField_01) == (2, 18, round(9.75 * 2**10))
    parsed = pyubx2.UBXReader.parse(raw([77], (13, 12)))
    assert (int.from_bytes(parsed.data_02, "little"), int.from_bytes(parsed.sTag_02, "little")) == (word(12), 77)


def test_readings_of_two_messages_with_units_and_axes(tmp_path: Path) -> None:
    """Half a turn of the axes; the accelerometer speaks between two readings of the gyroscope."""
    log = b"".join(measured(k, GYRO) + measured(k + 50, ACCEL) for k in range(100_000, 103_000, 100))
    (tmp_path / "a.ubx").write_bytes(log)
    recording = open_log(tmp_path / "a.ubx")
    imu = recording.streams["imu"]
    require_as_hidden(imu)
    np.testing.assert_allclose(imu.t, 0.1 * np.arange(29), atol=1e-9)
    assert set(recording.streams) == {"imu"}


def test_raw_readings_are_on_the_clock_of_the_fixes(tmp_path: Path) -> None:
    """The chip's clock is 2 % slow, and its tags of 24 bits begin anew; the calibrated tag of ESF-MEAS counts."""
    log = b""
    for k in range(400):
        log += raw([round((600.0 + 0.1 * k + 0.02 * j) * 25_600 * 0.98) % 2**24 for j in range(5)])
        log += measured(7, (*GYRO, *ACCEL), calibrated=50_000 + 100 * k)
        log += solution(604_780_000 + 100 * k) if k % 10 == 9 else b""
    (tmp_path / "a.ubx").write_bytes(log)
    recording = open_log(tmp_path / "a.ubx")
    imu, gps = recording.streams["imu"], recording.streams["gps"]
    require_as_hidden(imu)
    assert len(imu) == 2000
    np.testing.assert_allclose(np.diff(imu.t), 0.02, atol=1e-4)
    np.testing.assert_allclose(gps.t[0] - imu.t[0], 0.98, atol=2e-3)
    assert any("ESF-RAW" in note for note in recording.notes)
    other = open_log(tmp_path / "a.ubx", choice=Choice(imu=1)).streams["imu"]
    assert len(other) == 400
    require_as_hidden(other)
    facts = facts_of(tmp_path / "a.ubx")
    assert facts is not None
    assert facts.instances == {"imu": 2, "mag": 0, "baro": 0, "gps": 1}
    with pytest.raises(InputError, match="no imu number 2"):
        open_log(tmp_path / "a.ubx", choice=Choice(imu=2))


@pytest.mark.parametrize(
    ("log", "expected"),
    [
        (measured(0, GYRO), "no accel_x, accel_y, accel_z in ESF-MEAS"),
        (b"".join(raw([100 * k]) + solution(1000 * k) for k in range(40)), "tags of ESF-RAW"),
        (bytes(pyubx2.UBXMessage("ESF", "ESF-MEAS", pyubx2.GET, payload=bytes((0, 0, 0, 0, 0, 8, 0, 0))).serialize()),
         "ESF-MEAS of 8 bytes; expected 12"),
        (bytes(pyubx2.UBXMessage("ESF", "ESF-MEAS", pyubx2.GET, payload=bytes(3)).serialize()), "ESF-MEAS of 3 bytes"),
    ],
)  # fmt: skip
def test_what_is_no_inertial_sensor_is_said(tmp_path: Path, log: bytes, expected: str) -> None:
    (tmp_path / "a.ubx").write_bytes(log)
    with pytest.raises(InputError, match=expected):
        open_log(tmp_path / "a.ubx")
