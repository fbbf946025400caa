"""What a log that describes itself says of its flight besides the readings: when it was armed, and in which mode.

Sources: PX4 message definitions `vehicle_status`, `actuator_armed`; ArduPilot `LogStructure.h`, `AP_Logger.h`
(LogEvent) and the modes of ArduCopter and ArduPlane; MAVLink common message set, `MAV_MODE_FLAG`,
`MAV_TYPE`; PX4 `px4_custom_mode.h`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray, edges_of_runs
from sinan.sensors.formats import what_is

_MICROSECOND = 1e-6
#: `vehicle_status.arming_state` of an armed vehicle, of every firmware.
_ARMED = 2
_PX4_MODES = {
    0: "manual", 1: "altitude", 2: "position", 3: "mission", 4: "hold", 5: "return", 6: "slow position", 10: "acro",
    12: "descend", 13: "termination", 14: "offboard", 15: "stabilized", 17: "takeoff", 18: "land", 19: "follow",
    20: "precision land", 21: "orbit",
}  # fmt: skip
#: `EV.Id`: what is armed and disarmed.
_EVENT_ARMED, _EVENT_DISARMED = 10, 11
_COPTER_MODES = {
    0: "stabilize", 1: "acro", 2: "altitude hold", 3: "auto", 4: "guided", 5: "loiter", 6: "return", 7: "circle",
    9: "land", 11: "drift", 13: "sport", 14: "flip", 15: "autotune", 16: "position hold", 17: "brake", 18: "throw",
    20: "guided without GPS", 21: "smart return",
}  # fmt: skip
_PLANE_MODES = {
    0: "manual", 1: "circle", 2: "stabilize", 3: "training", 4: "acro", 5: "fly by wire A", 6: "fly by wire B",
    7: "cruise", 8: "autotune", 10: "auto", 11: "return", 12: "loiter", 13: "takeoff", 15: "guided", 17: "hover hold",
    18: "hover", 19: "hover loiter", 20: "hover land", 21: "hover return",
}  # fmt: skip
#: `HEARTBEAT.base_mode`: safety armed.
_SAFETY_ARMED = 128
#: `HEARTBEAT.type` of what ArduCopter and ArduPlane fly.
_COPTERS, _PLANES = (2, 3, 4, 13, 14, 15, 29, 35), (1, 19, 20, 21, 22, 23, 24, 25)
#: `HEARTBEAT.custom_mode` of PX4: byte 2 is the mode, of an automatic one byte 3.
_PX4_AUTOMATIC = 4
_PX4_MAIN_MODES = {
    1: "manual", 2: "altitude", 3: "position", 4: "automatic", 5: "acro", 6: "offboard", 7: "stabilized",
}  # fmt: skip
_PX4_AUTOMATIC_MODES = {
    1: "ready", 2: "takeoff", 3: "hold", 4: "mission", 5: "return", 6: "land", 8: "follow", 9: "precision land",
}  # fmt: skip
#: Changes that are told; a log with more of them is damaged.
_MOST = 200


@dataclass(frozen=True)
class Happening:
    """Something that a log says of its flight.

    Attributes
    ----------
    kind : "armed" or "mode"
    start, stop : on the log's own clock [s]; `stop` is infinite where nothing says that it ended
    label : in words
    """

    kind: str
    start: float
    stop: float
    label: str


def happenings_of(path: Path) -> list[Happening]:
    """When the vehicle was armed, and its modes; empty of any other log, and where it says nothing.

    Of a telemetry log in which the autopilot was started several times: in the longest part.
    """
    content = what_is(path)
    if content in ("ulog", "topics"):
        return _of_ulog(path)
    if content in ("dataflash", "dataflash_binary"):
        return _of_dataflash(path)
    return _of_tlog(path) if content == "tlog" else []


def _of_ulog(path: Path) -> list[Happening]:
    from sinan.sensors.formats.ulog_tables import topics_of

    topics = topics_of(path)
    found: list[Happening] = []
    for name, armed in (("vehicle_status.arming_state", _ARMED), ("actuator_armed.armed", 1)):
        t = topics.get(f"{name.split('.')[0]}.timestamp")
        if t is not None and name in topics and not found:
            found = _armed(t * _MICROSECOND, topics[name] == armed)
    t, modes = topics.get("vehicle_status.timestamp"), topics.get("vehicle_status.nav_state")
    return found if t is None or modes is None else found + _modes(t * _MICROSECOND, modes, _PX4_MODES)


def _of_dataflash(path: Path) -> list[Happening]:
    from sinan.sensors.formats.dataflash_messages import read_messages

    log = read_messages(path)
    found: list[Happening] = []
    if log.has("ARM", "TimeUS", "ArmState"):
        found = _armed(log.raw("ARM", "TimeUS") * _MICROSECOND, log.raw("ARM", "ArmState") == 1)
    elif log.has("EV", "TimeUS", "Id"):
        number = log.raw("EV", "Id")
        changes = np.isin(number, (_EVENT_ARMED, _EVENT_DISARMED))
        found = _armed(log.raw("EV", "TimeUS")[changes] * _MICROSECOND, number[changes] == _EVENT_ARMED)
    if log.has("MODE", "TimeUS", "ModeNum"):
        texts = " ".join([*log.heading, *(log.texts("MSG", "Message") if log.has("MSG", "Message") else [])])
        names = _COPTER_MODES if "ArduCopter" in texts else _PLANE_MODES if "ArduPlane" in texts else {}
        found += _modes(log.raw("MODE", "TimeUS") * _MICROSECOND, log.raw("MODE", "ModeNum"), names)
    return found


def _of_tlog(path: Path) -> list[Happening]:
    from sinan.sensors.formats.mavlink_frames import read_telemetry
    from sinan.sensors.formats.mavlink_streams import AUTOPILOTS, autopilot_of
    from sinan.sensors.formats.tlog import arrival_clock, boot_of

    k, boots = boot_of(read_telemetry(path))
    log = boots[k]
    if not log.has("HEARTBEAT", "base_mode"):
        return []
    t, autopilot = arrival_clock(log, "HEARTBEAT"), autopilot_of(log)
    own = log.numbers("HEARTBEAT", "autopilot").astype(int) == autopilot  # a ground station's heart beats, too
    armed = (log.numbers("HEARTBEAT", "base_mode").astype(np.int64) & _SAFETY_ARMED) != 0
    found = _armed(t[own], armed[own])
    if not np.any(own):
        return found
    modes = log.numbers("HEARTBEAT", "custom_mode")[own].astype(np.int64)
    if AUTOPILOTS.get(autopilot) == "PX4":
        automatic = (modes >> 16) & 0xFF == _PX4_AUTOMATIC
        modes = (modes >> 16) & np.where(automatic, 0xFFFF, 0xFF)
        names = _PX4_MAIN_MODES | {kind << 8 | _PX4_AUTOMATIC: name for kind, name in _PX4_AUTOMATIC_MODES.items()}
    else:
        flown = int(log.numbers("HEARTBEAT", "type")[own][0])
        names = _COPTER_MODES if flown in _COPTERS else _PLANE_MODES if flown in _PLANES else {}
    return found + _modes(t[own], modes.astype(np.float64), names)


def _armed(t: FloatArray, armed: BoolArray) -> list[Happening]:
    """Each time that it was armed, until a message says otherwise."""
    good = np.isfinite(t)
    t, armed = t[good], armed[good]
    runs = edges_of_runs(armed)[:_MOST].tolist() if len(t) else []
    return [Happening("armed", float(t[a]), float(t[b]) if b < len(t) else np.inf, "armed") for a, b in runs]


def _modes(t: FloatArray, modes: FloatArray, names: dict[int, str]) -> list[Happening]:
    """Each mode until the next one begins."""
    good = np.isfinite(t) & np.isfinite(modes)
    t, modes = t[good], modes[good]
    if not len(t):
        return []
    first = np.concatenate([[0], np.flatnonzero(np.diff(modes)) + 1])[:_MOST]
    ends = [*t[first[1:]].tolist(), np.inf]
    numbers = modes[first].astype(int).tolist()
    return [
        Happening("mode", float(t[k]), float(stop), names.get(number, f"mode {number}"))
        for k, stop, number in zip(first, ends, numbers, strict=True)
    ]
