"""A capture: what comes over a link is stamped, written down and looked at, until it is enough."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sinan.experiments.autopilots.calibrated import parameter_names
from sinan.experiments.capture.clock import LiveClock, Message, own_clock
from sinan.experiments.capture.faces import FaceWatch
from sinan.experiments.capture.link import Link
from sinan.experiments.capture.poses import PoseWatch
from sinan.experiments.capture.streams import WHY, LiveStreams
from sinan.experiments.capture.vehicle import Vehicle
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.formats.growing import GrowingRecording
from sinan.sensors.formats.mavlink_streams import AUTOPILOTS
from sinan.sensors.formats.mwlog import MwlogWriter
from sinan.sensors.formats.units import FIELD_UNIT
from sinan.sensors.recording import ACCEL, GYRO, MAG, Environment, Stream
from sinan.sensors.rotation import rpy_from_quaternion

#: What is shown to a sensor; "flight": nothing, all that comes is written.
Shown = Literal["flight", "accel", "mag"]
#: How often rows are written [s]: a part of the second that a kill may cost.
_WRITING = 0.25
#: How long one look at the link takes at most [s].
_LOOK = 0.05
#: A link is called silent after so long [s].
_SILENT = 2.0
_STREAMS: dict[str, tuple[str, ...]] = {
    "flight": ("imu", "mag", "baro", "gps", "laser", "sonar", "power", "motors", "attitude"),
    "accel": ("imu",), "mag": ("imu", "mag"),
}  # fmt: skip
#: What is missed where it does not come; of the others not every vehicle has one.
_MISSED = {"flight": ("imu", "mag", "baro", "gps"), "accel": ("imu",), "mag": ("imu", "mag")}
#: Rates of what is slower than an IMU [1/s].
_SLOW = {"SCALED_PRESSURE": 10.0, "GPS_RAW_INT": 5.0, "DISTANCE_SENSOR": 10.0, "BATTERY_STATUS": 2.0,
         "SYS_STATUS": 1.0, "SERVO_OUTPUT_RAW": 10.0, "ATTITUDE": 10.0}  # fmt: skip
_SECOND = {1: ("SCALED_IMU2", "SCALED_PRESSURE2", "GPS2_RAW"), 2: ("SCALED_IMU3", "SCALED_PRESSURE3", "")}
_OUTPUTS = (*(f"SERVO{k}_FUNCTION" for k in range(1, 17)), "MOT_PWM_MIN", "MOT_PWM_MAX")
#: Signals of a record of the course's logs: e_acc1_A (reading, pose), e3_m_A (field), e4_A (reading, rate, roll,
#: pitch, time).
_SIGNALS = {"accel": 6, "mag": 3, "flight": 9}


@dataclass(frozen=True)
class Asked:
    """What a capture is to do.

    Attributes
    ----------
    out : folder of the recording
    shown : what is shown
    rate : of the IMU [1/s]
    seconds : how long; None: until it is complete, or ended
    choice : which of several sensors
    gravity : m/s^2, of poses; None: not declared
    mwlog : file for the course's log, or None
    """

    out: Path
    shown: Shown = "flight"
    rate: float = 50.0
    seconds: float | None = None
    choice: Choice = FIRST
    gravity: float | None = None
    mwlog: Path | None = None


@dataclass
class Session:
    """A capture that goes on.

    Attributes
    ----------
    events : when something happened [s], and what
    complete : all that was to be shown was shown
    """

    link: Link
    asked: Asked
    say: Callable[[str], None]
    events: list[tuple[float, str]] = field(default_factory=list)
    complete: bool = False

    def __post_init__(self) -> None:
        asked, self.start = self.asked, time.monotonic()
        kind: Literal["flight", "poses"] = "flight" if asked.shown == "flight" else "poses"
        environment = Environment(gravity=asked.gravity, field_unit=FIELD_UNIT)
        self.recording = GrowingRecording(asked.out, kind, environment)
        self.vehicle = Vehicle(_messages(asked), _parameters(asked, 0))
        self.clock = LiveClock(self.start, self._happened)
        wanted = _STREAMS[asked.shown]
        self.streams = LiveStreams(self.recording, wanted, asked.choice, self._happened)
        self.poses = PoseWatch(self._happened) if asked.shown == "accel" else None
        self.faces = FaceWatch(self._happened) if asked.shown == "mag" else None
        self._log = None if asked.mwlog is None else MwlogWriter(asked.mwlog, _SIGNALS[asked.shown])
        self._ready: list[Message] = []
        self._written = self._judged = self.start
        self._level = np.zeros(2)
        self._force: tuple[FloatArray, FloatArray] = np.empty(0), np.empty((0, 3))
        self._silent = False

    @property
    def elapsed(self) -> float:
        """Since the beginning [s]."""
        return time.monotonic() - self.start

    def _happened(self, text: str) -> None:
        self.events.append((round(self.elapsed, 3), text))
        self.say(text)

    def go(self, stopped: Callable[[], bool], shown: Callable[[Session], None]) -> None:
        """Capture until it is complete, its time is over, or somebody stops it; the recording is whole then.

        Parameters
        ----------
        shown : called several times a second

        Raises
        ------
        InputError : nothing came that could be written, or the disk does not take it
        """
        try:
            while not (stopped() or self._is_enough()):
                self.step()
                shown(self)
            self._finish()
        finally:
            self.link.close()
            if self._log is not None:
                self._log.close()

    def _is_enough(self) -> bool:
        over = self.asked.seconds is not None and self.elapsed >= self.asked.seconds
        if self.complete and self.vehicle.pending(list(self.streams.parameters)) and not over:
            return False  # what the parameters are now decides what they are to be
        return over or self.complete

    def step(self) -> None:
        """One look at the link."""
        for data in self.link.receive(_LOOK):
            now = time.monotonic()
            known = self.vehicle.who
            for message in self.vehicle.parsed(data, now):
                if known is None:
                    known = self._met()
                name, jumps = message.get_type(), self.clock.jumps
                one = Message(now, name, bytes(message.get_msgbuf()), own_clock(name, message))
                self._ready += self.clock.stamp(one)
                if self.clock.jumps > jumps:
                    self.vehicle.begins_anew()
        now = time.monotonic()
        self._ready += self.clock.tick(now)
        self._watch_silence(now)
        for out in self.vehicle.speak(now, list(self.streams.parameters)):
            self.link.send(out)
        if now - self._written >= _WRITING:
            self._written = now
            self._write(now)

    def _met(self) -> tuple[int, int] | None:
        """A vehicle was heard for the first time: whose it is tells what to ask for."""
        self._happened(f"heard: {self.vehicle.title}")
        self.vehicle.asked_parameters = list(_parameters(self.asked, self.vehicle.autopilot))
        return self.vehicle.who

    def _watch_silence(self, now: float) -> None:
        silent = self.vehicle.who is not None and now - self.vehicle.heard > _SILENT
        if silent and not self._silent:
            self._happened(f"silent: nothing comes any more{': ' + self.link.trouble if self.link.trouble else ''}")
        elif self._silent and not silent:
            self._happened("heard again")
            self.vehicle.begins_anew()
        self._silent = silent

    def _write(self, now: float, last: bool = False) -> None:
        ready, self._ready = self._ready, []
        found = self.streams.take(ready, now, self.vehicle.autopilot, last)
        self._log_course(found)
        if "imu" in found and len(found["imu"]):
            self._show(found["imu"])
        if self.faces is not None and "mag" in found and len(self._force[0]):
            mag = found["mag"]
            rows = np.clip(np.searchsorted(self._force[0], mag.t), 0, len(self._force[0]) - 1)
            for row, reading in zip(rows.tolist(), mag.array(MAG), strict=True):
                self.faces.add(self._force[1][row], reading)
            self.faces.update()
            self.complete = not self.faces.wanted

    def _show(self, imu: Stream) -> None:
        """Readings of the IMU, for what is shown to it."""
        self._force = imu.t, imu.array(ACCEL)
        if self.poses is None or self.complete:
            return
        for t, reading, rate in zip(imu.t.tolist(), imu.array(ACCEL), imu.array(GYRO), strict=True):
            pose = self.poses.add(t, reading, rate)
            if self._log is not None:
                self._log.write(np.concatenate([reading, np.zeros(3) if pose is None else pose.mean]))
            if pose is not None:
                row = {name: np.array([value]) for name, value in zip(ACCEL, pose.mean, strict=True)}
                self.recording.append("poses", Stream(np.array([pose.t]), row))
            if not self.poses.wanted:
                self.complete = True
                return

    def _log_course(self, found: dict[str, Stream]) -> None:
        """The course's log, but that of poses."""
        if self._log is None or self.poses is not None:
            return
        if self.faces is not None:
            if "mag" in found and len(found["mag"]):
                self._log.write(found["mag"].array(MAG))
            return
        if "attitude" in found and len(found["attitude"]):
            q = found["attitude"].array(("qw", "qx", "qy", "qz"))[-1]
            self._level = rpy_from_quaternion(q[None])[0, :2]
        if "imu" in found and len(found["imu"]):
            imu = found["imu"]
            level = np.tile(self._level, (len(imu), 1))
            self._log.write(np.column_stack([imu.array((*ACCEL, *GYRO)), level, 1e6 * imu.t]))

    def _finish(self) -> None:
        self._ready += self.clock.settle()
        self._write(time.monotonic(), last=True)
        if not self.recording.rows:
            why = "; ".join(self.missing(time.monotonic())) or "what came holds none"
            expected = f"readings: a vehicle that is on and sends to {self.link.name}, and time for it to be heard"
            raise InputError(self.asked.out, f"not one reading ({why})", expected)
        self.recording.finish()

    def missing(self, now: float) -> list[str]:
        """What does not come as it should, a sentence each."""
        if self.vehicle.who is None:
            trouble = f": {self.link.trouble}" if self.link.trouble else ""
            return [f"no vehicle has been heard on {self.link.name}{trouble}"]
        if self._silent:
            return [f"silent for {now - self.vehicle.heard:.0f} s"]
        found = []
        for name in _MISSED[self.asked.shown]:
            if name not in self.streams.readers:
                comes = self.vehicle.rate(_MESSAGE_OF[name], now) > 0.0
                found.append(f"{name}: {WHY.get(name, 'not yet')}" if comes else f"{name}: not sent")
        rate = max((self.vehicle.rate(name, now) for name in _IMUS), default=0.0)
        if "imu" in self.streams.readers and rate < 0.8 * self.asked.rate and self.elapsed > 5.0:
            found.append(f"imu: {rate:.0f} of {self.asked.rate:g} a second")
        return found

    def as_json(self) -> dict[str, Any]:
        """What was captured, for a file beside the recording."""
        vehicle = self.vehicle
        return {
            "format": 1, "link": self.link.name, "seconds": round(self.elapsed, 3),
            "autopilot": AUTOPILOTS.get(vehicle.autopilot, ""), "system": (vehicle.who or (None,))[0],
            "rows": dict(self.recording.rows), "rows_left_out": dict(self.recording.left_out),
            "messages": dict(sorted(vehicle.counts.items())), "lost": vehicle.lost, "damaged": vehicle.damaged,
            "wrong_clock": self.clock.wrong, "clock_jumps": self.clock.jumps,
            "events": [{"t": t, "text": text} for t, text in self.events], "parameters": dict(self.streams.parameters),
        }  # fmt: skip


_IMUS = ("HIGHRES_IMU", "RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3")
_MESSAGE_OF = {"imu": "RAW_IMU", "mag": "RAW_IMU", "baro": "SCALED_PRESSURE", "gps": "GPS_RAW_INT"}


def _messages(asked: Asked) -> dict[str, float]:
    """Rates of the messages that are asked for [1/s]: those of the IMU as they are wanted, others no faster."""
    fast = {"HIGHRES_IMU": asked.rate, "RAW_IMU": asked.rate}
    slow = dict(_SLOW) if asked.shown == "flight" else {}
    for number in {asked.choice.imu, asked.choice.mag} & set(_SECOND):
        fast[_SECOND[number][0]] = asked.rate
    if asked.choice.baro in _SECOND:
        slow[_SECOND[asked.choice.baro][1]] = _SLOW["SCALED_PRESSURE"]
    if asked.choice.gps == 1:
        slow["GPS2_RAW"] = _SLOW["GPS_RAW_INT"]
    return fast | {name: min(rate, asked.rate) for name, rate in slow.items()}


def _parameters(asked: Asked, autopilot: int) -> Sequence[str]:
    """Names of the parameters that are asked for."""
    name = AUTOPILOTS.get(autopilot, "").lower()
    if not name:
        return ()
    if asked.shown == "flight":
        return _OUTPUTS if name == "ardupilot" else ()
    number = asked.choice.imu if asked.shown == "accel" else asked.choice.mag
    return parameter_names(name, asked.shown, number)
