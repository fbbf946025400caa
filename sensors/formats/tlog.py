"""MAVLink telemetry logs as recordings: what a vehicle sent over its radio, as a ground station kept it.

Rates are those of the link and readings are rounded to what a message holds (1 mg, 1 mrad/s, 1 mGauss, but in
`HIGHRES_IMU`): the autopilot's own log is better where there is one. What the messages mean: `mavlink_streams`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.formats.facts import Facts, Table
from sinan.sensors.formats.logged import recording_of
from sinan.sensors.formats.mavlink_frames import Telemetry, read_telemetry
from sinan.sensors.formats.mavlink_streams import (
    AUTOPILOTS,
    IMU_MESSAGES,
    LONGEST_ON,
    OWN_CLOCKS,
    WRAP,
    autopilot_of,
    firmware_of,
    instances_of,
    parameters_of,
    readers_of,
)
from sinan.sensors.recording import Recording


def read_tlog(path: Path, choice: Choice = FIRST) -> Recording:
    """A telemetry log as a recording: IMU, magnetometer, barometer, GPS, range, supply, motors; attitude as reference.

    A reading is stamped by the autopilot's clock where its message has one, else by its arrival less the least delay of
    the IMU's. Neglected: velocities (`GPS_RAW_INT` has none downward), what the autopilot estimates but its attitude.

    Raises
    ------
    InputError : what `read_telemetry` finds wrong; no IMU, a sensor that is not there, `raw`
    """
    if choice.raw:
        raise InputError(path, "a telemetry log, which does not hold what was corrected", "no --raw", "--raw")
    log = read_telemetry(path)
    clock = _Clock(log)
    notes = list(log.notes)
    readers = readers_of(log, choice, parameters_of(log, autopilot_of(log)), notes)
    found = {name: reader(log, clock) for name, reader in readers.items()}
    attitude = found.pop("attitude", None)
    return recording_of(path, found, attitude, {}, notes, list(log.counts))


def tlog_facts(path: Path) -> Facts:
    """What a telemetry log says of itself."""
    log = read_telemetry(path)
    tables = []
    for name, count in log.counts.items():
        t = log.arrived(name)
        tables.append(Table(name, count, (float(np.min(t)), float(np.max(t)))))
    texts = tuple(log.texts("STATUSTEXT", "text")) if "STATUSTEXT" in log else ()
    autopilot = autopilot_of(log)
    name = AUTOPILOTS.get(autopilot, "")
    firmware = firmware_of(log, autopilot) or name
    parameters = parameters_of(log, autopilot)
    return Facts("MAVLink telemetry log", firmware, parameters, tuple(tables), instances_of(log), texts, autopilot=name)


class _Clock:
    """When readings were taken, on the autopilot's clock.

    Parameters
    ----------
    log : whose arrivals are brought to that clock by the least delay of its IMU's messages
    """

    def __init__(self, log: Telemetry) -> None:
        self.log = log
        delays = [
            float(np.min(log.arrived(name) - own)) for name, _ in IMU_MESSAGES
            if name in log and (own := self._own(name)) is not None
        ]  # fmt: skip
        self.offset = min(delays) if delays else float(np.min(log.arrived(next(iter(log.counts)))))

    def of(self, name: str) -> FloatArray:
        """(n,) of the messages of a kind [s]."""
        own = self._own(name)
        arrived = self.log.arrived(name) - self.offset
        if own is None:
            return arrived
        if name == "SERVO_OUTPUT_RAW":
            return np.asarray(arrived + np.mod(own - arrived + 0.5 * WRAP, WRAP) - 0.5 * WRAP)
        return own

    def _own(self, name: str) -> FloatArray | None:
        """(n,) what a message says itself; None: nothing, or a time of the day."""
        for part, unit in OWN_CLOCKS:
            if self.log.has(name, part):
                t = self.log.numbers(name, part) * unit
                return t if np.all((t > 0.0) & (t < LONGEST_ON)) else None
        return None


def arrival_clock(log: Telemetry, name: str) -> FloatArray:
    """(n,) when the messages of a kind were sent, on the clock of `read_tlog` before its first sample [s]."""
    return _Clock(log).of(name)
