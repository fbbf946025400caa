"""When a reading was taken: the vehicle's own clock, brought to one that begins with the capture.

t = own + offset, where the offset is that of the fastest message of the first moment; what has no clock is stamped by
its arrival less the least delay. The vehicle's clock may begin anew (the autopilot was started again) or jump: then so
does the offset, and t goes on. A message that is merely late keeps its own time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sinan.sensors.formats.mavlink_streams import LONGEST_ON, OWN_CLOCKS, WRAP

#: How long messages are gathered before the offset is taken of them, and before a doubt is decided [s].
SETTLING, DOUBT = 0.3, 1.0
#: A clock that runs ahead of its messages by so much, or back against its own by so much, has jumped; behind by more
#: it has either jumped or the messages were held up [s].
AHEAD, BACK, LATE = 1.0, 0.5, 3.0
#: The least delay is that of the last one to two such spans: clocks drift by 1e-4 at most, 6 ms meanwhile [s].
_SPAN = 60.0


@dataclass
class Message:
    """A message as it came.

    Attributes
    ----------
    arrived : on this machine's clock [s]
    name : of its kind
    frame : its bytes
    own : the vehicle's clock when it was taken [s]; None: it has none
    t : on the recording's clock [s]
    """

    arrived: float
    name: str
    frame: bytes
    own: float | None = None
    t: float = 0.0


def own_clock(name: str, message: Any) -> float | None:
    """What a message of `pymavlink` says of its time [s]; None: nothing, or the time of the day."""
    if name == "SYSTEM_TIME":
        return None
    for part, unit in OWN_CLOCKS:
        value = getattr(message, part, None)
        if value is not None:
            return value * unit if 0.0 < value * unit < LONGEST_ON else None
    return None


class LiveClock:
    """Stamps messages in the order in which they come; those in doubt wait for the next ones.

    Parameters
    ----------
    start : when the capture began, on this machine's clock [s]
    say : is told where the vehicle's clock jumps
    """

    def __init__(self, start: float, say: Callable[[str], None]) -> None:
        self._start, self._say = start, say
        self._waiting: list[Message] = []
        self._since: float | None = None
        self._offset: float | None = None
        self._least: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of the span before, of this one, its beginning
        self._own: dict[str, float] = {}
        self._newest = 0.0
        self._latest = 0.0
        #: Messages whose clock fits nothing.
        self.wrong = 0
        #: How often the clock jumped.
        self.jumps = 0

    def stamp(self, message: Message) -> list[Message]:
        """The messages, in their order, whose time is now known."""
        if message.own is None and self._offset is None and not self._waiting:
            return [self._by_arrival(message)]
        if not self._waiting and self._offset is not None and self._fits(message):
            return [self._take(message)]
        if self._since is None:
            self._since = message.arrived
        self._waiting.append(message)
        return self.tick(message.arrived)

    def tick(self, now: float) -> list[Message]:
        """Those whose doubt has lasted long enough."""
        if self._since is None or now - self._since < (SETTLING if self._offset is None else DOUBT):
            return []
        return self.settle()

    def settle(self) -> list[Message]:
        """Decide on those that wait."""
        waiting, self._waiting, self._since = self._waiting, [], None
        if not waiting:
            return []
        if self._offset is None:
            self._begin(waiting)
            return [self._take(one) for one in waiting]
        timed = [one for one in waiting if one.own is not None]
        if not timed or self._fits(timed[-1]):
            return self._those(waiting, self._is_late)
        first = next(k for k, one in enumerate(waiting) if not self._fits(one))
        before = [self._take(one) for one in waiting[:first]]
        self._jump(waiting[first:])
        return before + self._those(waiting[first:], self._fits)

    def _those(self, messages: list[Message], fits: Callable[[Message], bool]) -> list[Message]:
        """Those that fit, one after the other; the others are counted."""
        taken = [self._take(one) for one in messages if fits(one)]
        self.wrong += len(messages) - len(taken)
        return taken

    def _fits(self, message: Message) -> bool:
        own = self._unwrapped(message)
        if own is None:
            return True
        delay = message.arrived - own - self._delay
        return -AHEAD <= delay <= LATE and own > self._own.get(message.name, own) - BACK

    def _is_late(self, message: Message) -> bool:
        """Whether a message fits, but for a delay."""
        own = self._unwrapped(message)
        late = own is not None and message.arrived - own - self._delay > LATE
        return self._fits(message) or (late and own is not None and own > self._own.get(message.name, own))

    def _unwrapped(self, message: Message) -> float | None:
        """The own clock, of 32 bits made whole."""
        if message.own is None or message.name != "SERVO_OUTPUT_RAW":
            return message.own
        return message.own + WRAP * round((message.arrived - self._delay - message.own) / WRAP)

    @property
    def _delay(self) -> float:
        """The least time from the vehicle's clock to this machine's [s], of two clocks that begin apart."""
        return min(self._least[:2])

    def _begin(self, messages: list[Message]) -> None:
        least = min((one.arrived - one.own for one in messages
                     if one.own is not None and one.name != "SERVO_OUTPUT_RAW"), default=self._start)  # fmt: skip
        self._least = least, least, messages[0].arrived
        self._offset = least - self._start
        self._own.clear()

    def _jump(self, messages: list[Message]) -> None:
        before = self._newest
        self._begin([one for one in messages if not self._fits(one)])
        owns = [one.own for one in messages if one.own is not None]
        assert self._offset is not None
        self._offset += max(self._latest - (min(owns) + self._offset), 0.0) if owns else 0.0
        self.jumps += 1
        after = owns[0] if owns else 0.0
        why = "it was started again, or its clock set back" if after < before else "it jumped"
        self._say(f"the vehicle's clock went from {before:.1f} s to {after:.1f} s: {why}")

    def _take(self, message: Message) -> Message:
        own = self._unwrapped(message)
        if own is None or self._offset is None:
            return self._by_arrival(message)
        delay, (before, least, since) = message.arrived - own, self._least
        if message.arrived - since > _SPAN:
            before, least, since = least, delay, message.arrived
        self._least = before, min(least, delay), since
        self._own[message.name] = max(own, self._own.get(message.name, own))
        self._newest = own
        message.t = own + self._offset
        self._latest = max(self._latest, message.t)
        return message

    def _by_arrival(self, message: Message) -> Message:
        offset = self._offset
        message.t = message.arrived - (self._start if offset is None else self._delay - offset)
        return message
