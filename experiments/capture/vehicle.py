"""The other side of a link: which vehicle is heard, what it is asked for, and what it has said of itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sinan.sensors.errors import InputError, with_extra
from sinan.sensors.formats.mavlink_streams import AUTOPILOTS

#: This side: a ground station's numbers, whose heartbeat keeps a vehicle sending.
_SYSTEM, _COMPONENT = 255, 190
_GROUND_STATION, _NO_AUTOPILOT = 6, 8
_HEARTBEAT = 1.0
#: A request is repeated so often, after so long each time; a message at less than this part of its rate is asked for
#: again, after a longer time.
_TRIES, _AGAIN, _TOO_SLOW, _LATER = 3, 0.8, 0.6, 5.0
#: So many parameters are asked for at once: a slow radio takes a tenth of a second for them.
_AT_ONCE = 8
_SET_MESSAGE_INTERVAL, _ACCEPTED = 511, 0
#: What REQUEST_DATA_STREAM knows instead: RAW_SENSORS, EXTENDED_STATUS, RC_CHANNELS, POSITION, EXTRA1, 2 and 3.
_GROUPS = {1: ("RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3", "HIGHRES_IMU", "SCALED_PRESSURE"),
           2: ("SYS_STATUS", "GPS_RAW_INT", "GPS2_RAW"), 3: ("SERVO_OUTPUT_RAW",),
           10: ("ATTITUDE", "ATTITUDE_QUATERNION"), 12: ("BATTERY_STATUS", "DISTANCE_SENSOR")}  # fmt: skip


@dataclass
class Wanted:
    """A message that is asked for.

    Attributes
    ----------
    rate : [1/s]
    tries, asked : how often and when it was asked for, since the vehicle last began
    came : when it came last
    """

    name: str
    rate: float
    tries: int = 0
    asked: float = -np.inf
    came: float = -np.inf


@dataclass
class Rate:
    """Messages of one kind over the last seconds."""

    window: float = 5.0
    times: list[float] = field(default_factory=list)

    def add(self, now: float) -> None:
        """One more."""
        self.times.append(now)
        if len(self.times) > 64 and self.times[0] < now - self.window:
            self.times = [t for t in self.times if t >= now - self.window]

    def at(self, now: float) -> float:
        """[1/s]."""
        recent = [t for t in self.times if t >= now - self.window]
        if len(recent) < 2:
            return 0.0
        return len(recent) / max(min(self.window, now - self.times[0]), 0.2)


class Vehicle:
    """What is heard of one vehicle, and said to it.

    Parameters
    ----------
    wanted : rates [1/s] by message
    parameters : names that are asked for

    Raises
    ------
    InputError : no `pymavlink`
    """

    def __init__(self, wanted: dict[str, float], parameters: Sequence[str] = ()) -> None:
        try:
            from pymavlink.dialects.v20 import ardupilotmega
        except ImportError:
            raise InputError(Path("--link"), "MAVLink, which `pymavlink` speaks", with_extra("mavlink")) from None
        self._mav = ardupilotmega.MAVLink(None, srcSystem=_SYSTEM, srcComponent=_COMPONENT)
        self._mav.robust_parsing = True
        self._ids = {kind.msgname: number for number, kind in ardupilotmega.mavlink_map.items()}
        self.wanted = {name: Wanted(name, rate) for name, rate in wanted.items()}
        self.asked_parameters = list(parameters)
        self._tries: dict[str, tuple[int, float]] = {}
        self.who: tuple[int, int] | None = None
        self.autopilot = 0
        self.heard = -np.inf
        self.rates: dict[str, Rate] = {}
        self.counts: dict[str, int] = {}
        self.lost, self.received, self.damaged = 0, 0, 0
        self._sequence: int | None = None
        self._accepted = 0
        self._out: list[bytes] = []
        self._beat = -np.inf

    @property
    def title(self) -> str:
        """Who it is, in words."""
        if self.who is None:
            return "no vehicle"
        return f"{AUTOPILOTS.get(self.autopilot, 'a vehicle')} (system {self.who[0]})"

    def parsed(self, data: bytes, now: float) -> list[Any]:
        """The whole messages of the vehicle among these bytes; others and damaged ones are passed over."""
        found = []
        for message in self._mav.parse_buffer(data) or []:
            if message.get_type() == "BAD_DATA":
                self.damaged += 1
            elif not message.get_type().startswith("UNKNOWN") and self._is_ours(message, now):
                found.append(message)
        return found

    def _is_ours(self, message: Any, now: float) -> bool:
        who, name = (message.get_srcSystem(), message.get_srcComponent()), message.get_type()
        if self.who is None:
            if name != "HEARTBEAT" or message.type == _GROUND_STATION or message.autopilot == _NO_AUTOPILOT:
                return False
            self.who, self.autopilot = who, message.autopilot
        if who != self.who:
            return False
        self._count(message.get_seq())
        self.heard = now
        self.counts[name] = self.counts.get(name, 0) + 1
        self.rates.setdefault(name, Rate()).add(now)
        if name in self.wanted:
            self.wanted[name].came = now
        if name == "COMMAND_ACK" and message.command == _SET_MESSAGE_INTERVAL:
            self._accepted += message.result == _ACCEPTED
        return True

    def _count(self, sequence: int) -> None:
        """Messages that are missing, by their numbers, which begin again after 255."""
        self.received += 1
        if self._sequence is not None:
            missing = (sequence - self._sequence - 1) % 256
            self.lost += missing if missing < 128 else 0  # else one that came late, or a number that began anew
        self._sequence = sequence

    def begins_anew(self) -> None:
        """The vehicle was started again, or was away: it is asked for everything once more."""
        self._accepted, self._sequence = 0, None
        for one in self.wanted.values():
            one.tries, one.asked = 0, -np.inf

    def speak(self, now: float, known: Sequence[str] = ()) -> list[bytes]:
        """What is to be sent now.

        Parameters
        ----------
        known : parameters that have been told
        """
        self._out = []
        if now - self._beat >= _HEARTBEAT:
            self._beat = now
            self._send(self._mav.heartbeat_encode(_GROUND_STATION, _NO_AUTOPILOT, 0, 0, 4))
        if self.who is not None:
            self._ask_for_messages(now)
            self._ask_for_parameters(now, known)
        return self._out

    def _send(self, message: Any) -> None:
        self._out.append(bytes(message.pack(self._mav)))
        self._mav.seq = (self._mav.seq + 1) % 256

    def _ask_for_messages(self, now: float) -> None:
        assert self.who is not None
        for one in self.wanted.values():
            slow = self.rate(one.name, now) < _TOO_SLOW * one.rate
            if not slow or now - one.asked < (_AGAIN if one.tries < _TRIES else _LATER):
                continue
            if one.tries >= _TRIES - 1 and not self._accepted:  # it does not know how to set an interval
                self._ask_for_group(one)
            self._send(self._mav.command_long_encode(
                *self.who, _SET_MESSAGE_INTERVAL, 0, self._ids[one.name], round(1e6 / one.rate), 0, 0, 0, 0, 0
            ))  # fmt: skip
            one.tries, one.asked = one.tries + 1, now

    def _ask_for_group(self, one: Wanted) -> None:
        assert self.who is not None
        for group, names in _GROUPS.items():
            if one.name in names:
                rate = max(other.rate for other in self.wanted.values() if other.name in names)
                self._send(self._mav.request_data_stream_encode(*self.who, group, round(rate), 1))

    def _ask_for_parameters(self, now: float, known: Sequence[str]) -> None:
        assert self.who is not None
        asked = 0
        for name in self.asked_parameters:
            tries, before = self._tries.get(name, (0, -np.inf))
            if name in known or tries >= _TRIES or now - before < _AGAIN or asked >= _AT_ONCE:
                continue
            self._send(self._mav.param_request_read_encode(*self.who, name.encode(), -1))
            self._tries[name], asked = (tries + 1, now), asked + 1

    def pending(self, known: Sequence[str]) -> bool:
        """Whether a parameter may still be told."""
        return any(name not in known and self._tries.get(name, (0, 0.0))[0] < _TRIES for name in self.asked_parameters)

    def rate(self, name: str, now: float) -> float:
        """Of a message over the last seconds [1/s]."""
        return self.rates[name].at(now) if name in self.rates else 0.0
