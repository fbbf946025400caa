"""Messages as they come, part by part, into the streams of a recording."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from sinan.experiments.capture.clock import Message
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import Choice
from sinan.sensors.formats.growing import GrowingRecording
from sinan.sensors.formats.mavlink_frames import Telemetry, telemetry_of
from sinan.sensors.formats.mavlink_streams import FINDERS, Reader, parameters_of
from sinan.sensors.recording import Stream

#: How long a stream is looked at before it is decided which message it is read from, and which columns it has [s].
SETTLING = 0.5
#: What has come meanwhile is kept for so long [s].
_KEPT = 2.5
#: A time of the day for frames that a telemetry log would stamp: any of this century [us].
_EPOCH = 1_700_000_000_000_000
_BATTERY = "BATTERY_STATUS"
#: Why a stream may be missing though its messages come.
WHY = {"gps": "no fix in three dimensions", "mag": "the field is zero"}


class _Stamps:
    """The times that messages were given, as a `Clock`."""

    def __init__(self, messages: Sequence[Message]) -> None:
        self._t: dict[str, list[float]] = {}
        for one in messages:
            self._t.setdefault(one.name, []).append(one.t)

    def of(self, name: str) -> FloatArray:
        """(n,) of the messages of a kind [s]."""
        return np.array(self._t[name])


class LiveStreams:
    """Finds the streams in what has come, and appends their rows to a recording.

    Parameters
    ----------
    recording : that grows
    wanted : streams that are written; `attitude` goes to the reference
    choice : which of several sensors
    say : is told what was chosen
    """

    def __init__(
        self, recording: GrowingRecording, wanted: Sequence[str], choice: Choice, say: Callable[[str], None]
    ) -> None:
        self.recording, self.wanted, self._choice, self._say = recording, tuple(wanted), choice, say
        self.parameters: dict[str, float] = {}
        self.readers: dict[str, Reader] = {}
        self._first: dict[str, float] = {}
        self._kept: deque[Message] = deque()
        self._batteries: dict[int, Message] = {}

    def take(self, messages: Sequence[Message], now: float, autopilot: int, last: bool = False) -> dict[str, Stream]:
        """The rows of a part, appended, by stream.

        Parameters
        ----------
        messages : with their times
        now : on this machine's clock [s]
        autopilot : whose messages they are
        last : nothing more will come: what is there is enough
        """
        found: dict[str, Stream] = {}
        if messages:
            part, stamps = _part(self._with_batteries(messages)), _Stamps(self._with_batteries(messages))
            self.parameters |= parameters_of(part, autopilot)
            for name, reader in self.readers.items():
                stream = reader(part, stamps)
                if stream is not None and len(stream):
                    found[name] = self._append(name, stream)
            self._remember(messages)
        if any(name not in self.readers for name in self.wanted):
            found |= self._look(now, last)
        return found

    def _append(self, name: str, stream: Stream) -> Stream:
        return self.recording.append("truth" if name == "attitude" else name, stream)

    def _with_batteries(self, messages: Sequence[Message]) -> Sequence[Message]:
        """With the last message of each battery before: what several say stands in one row."""
        if len(self._batteries) < 2 or not any(one.name == _BATTERY for one in messages):
            return messages
        return [*self._batteries.values(), *messages]

    def _remember(self, messages: Sequence[Message]) -> None:
        for one in messages:
            if one.name == _BATTERY:
                self._batteries[_battery(one)] = one
        self._kept.extend(messages)

    def _look(self, now: float, last: bool) -> dict[str, Stream]:
        """Streams that have been there for long enough to say what they are."""
        while self._kept and self._kept[0].arrived < now - _KEPT:
            self._kept.popleft()
        if not self._kept:
            return {}
        kept = list(self._kept)
        part, stamps = _part(kept), _Stamps(kept)
        found = {}
        for name in self.wanted:
            if name in self.readers:
                continue
            notes: list[str] = []
            with suppress(InputError):  # a sensor that is asked for and has not come yet
                reader = FINDERS[name](part, self._choice, self.parameters, notes)
                rows = None if reader is None else reader(part, stamps)
                if reader is None or rows is None or not len(rows):
                    continue
                if last or now - self._first.setdefault(name, now) >= SETTLING:
                    self.readers[name] = reader
                    found[name] = self._append(name, rows)
                    for note in notes:
                        self._say(note)
        return found


def _battery(message: Message) -> int:
    part = _part([message])
    return int(part.numbers(_BATTERY, "id")[0])


def _part(messages: Sequence[Message]) -> Telemetry:
    """Frames as a piece of a telemetry log."""
    stamped = (round(_EPOCH + 1e6 * one.arrived).to_bytes(8, "big") + one.frame for one in messages)
    return telemetry_of(b"".join(stamped), Path("the link"))
