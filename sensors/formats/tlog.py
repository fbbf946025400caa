"""MAVLink telemetry logs as recordings: what a vehicle sent over its radio, as a ground station kept it.

Rates are those of the link and readings are rounded to what a message holds (1 mg, 1 mrad/s, 1 mGauss, but in
`HIGHRES_IMU`): the autopilot's own log is better where there is one. What the messages mean: `mavlink_streams`.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import FloatArray, IntArray
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

#: Messages of which most must agree: a wrong stamp is no start of the autopilot.
_TOGETHER = 5
#: By how much the autopilot's clock goes back at its start [s]; the messages of one instant do not come in its order.
_BACK = 1.0
#: By how much it is late for good where it does not go back [s]: a link keeps messages for some seconds, and a ground
#: station that listens again after a start has missed the start itself.
_LATE = 30.0


def read_tlog(path: Path, choice: Choice = FIRST) -> Recording:
    """A telemetry log as a recording: IMU, magnetometer, barometer, GPS, range, supply, motors; attitude as reference.

    A reading is stamped by the autopilot's clock where its message has one, else by its arrival less the least delay of
    the IMU's. Each start of the autopilot begins that clock anew, and is a recording of its own.
    Neglected: velocities (`GPS_RAW_INT` has none downward), what the autopilot estimates but its attitude.

    Raises
    ------
    InputError : what `read_telemetry` finds wrong; no IMU, a sensor or a boot that is not there, `raw`
    """
    if choice.raw:
        raise InputError(path, "a telemetry log, which does not hold what was corrected", "no --raw", "--raw")
    whole = read_telemetry(path)
    notes = list(whole.notes)
    log, parameters = _one_boot(whole, choice.boot, notes)
    clock = _Clock(log)
    readers = readers_of(log, choice, parameters, notes)
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


def boots_of(log: Telemetry) -> list[Telemetry]:
    """The parts of a log between two starts of the autopilot, by its IMU's messages; one where nothing says so.

    A start sets the autopilot's clock back to zero, and not that of the ground station: what is to be added to the one
    to have the other, constant but for the link's delay, grows and stays so.
    Parts are cut where nothing came for longest.
    """
    own, arrived, places = _imu_clocks(log)
    if len(own) < 2 * _TOGETHER:
        return [log]
    own, offset = _without_single(own), _without_single(arrived - own)
    least_from_here = np.minimum.accumulate(offset[::-1])[::-1]
    new = 1 + np.flatnonzero((np.diff(own) < -_BACK) | (least_from_here[1:] - offset[:-1] > _LATE))
    if not len(new):
        return [log]
    every = np.concatenate([log.places(name) for name in log.counts])
    order = np.argsort(every)
    every, came = every[order], np.concatenate([log.arrived(name) for name in log.counts])[order]
    cuts = [0]
    for k in new.tolist():
        a, b = np.searchsorted(every, places[k - 1 : k + 1]).tolist()
        cuts.append(int(every[a + 1 + int(np.argmax(np.diff(came[a : b + 1])))]))
    return [log.between(start, stop) for start, stop in pairwise([*cuts, int(every[-1]) + 1])]


def boot_of(log: Telemetry, number: int = 0) -> tuple[int, list[Telemetry]]:
    """The place of a boot among those of a log, and all of them; of number 0 it is the longest.

    Raises
    ------
    InputError : there is no such boot
    """
    boots = boots_of(log)
    if number > len(boots):
        raise InputError(log.path, f"no boot number {number}", f"1 to {len(boots)}, or none", "--boot")
    return (number or 1 + int(np.argmax([_length(boot) for boot in boots]))) - 1, boots


def _one_boot(log: Telemetry, number: int, notes: list[str]) -> tuple[Telemetry, dict[str, float]]:
    """The messages of one boot, and the parameters as they were told last by its end, or first after it."""
    autopilot = autopilot_of(log)
    k, boots = boot_of(log, number)
    if len(boots) > 1:
        lengths = ", ".join(f"{_length(boot):.0f}" for boot in boots)
        which = f"{k + 1}" if number else f"{k + 1}, the longest"
        notes.append(f"the autopilot was started {len(boots)} times ({lengths} s of its IMU): boot {which}, is read; "
                     "`sinan convert LOG OUT --boot N` keeps another")  # fmt: skip
    last = max(int(boots[k].places(name)[-1]) for name in boots[k].counts)
    return boots[k], parameters_of(log, autopilot) | parameters_of(log.between(0, last + 1), autopilot)


def _length(boot: Telemetry) -> float:
    """How long the IMU's messages of a boot last [s]."""
    own = _imu_clocks(boot)[0]
    return float(np.ptp(own)) if len(own) else 0.0


def _imu_clocks(log: Telemetry) -> tuple[FloatArray, FloatArray, IntArray]:
    """Of the IMU's messages in the order of the log: the autopilot's clock, when they came [s], where they stand."""
    found = [(log.numbers(name, part) * unit, log.arrived(name), log.places(name)) for name, _ in IMU_MESSAGES
             for part, unit in OWN_CLOCKS if log.has(name, part)]  # fmt: skip
    if not found:
        return np.empty(0), np.empty(0), np.empty(0, dtype=np.int64)
    own, arrived, places = (np.concatenate(parts) for parts in zip(*found, strict=True))
    order = np.argsort(places)
    order = order[(own[order] > 0.0) & (own[order] < LONGEST_ON)]
    return own[order], arrived[order], places[order]


def _without_single(values: FloatArray) -> FloatArray:
    """(n,) the medians about each value: one or two that are wrong move none, and a step stays where it is."""
    around = np.lib.stride_tricks.sliding_window_view(np.pad(values, _TOGETHER // 2, mode="edge"), _TOGETHER)
    return np.asarray(np.median(around, axis=1))
