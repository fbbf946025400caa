"""What a log says of itself besides its readings: who wrote it, its parameters, what it holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Table:
    """A kind of message or topic.

    Attributes
    ----------
    name : of it
    rows : how many
    span : first and last time [s], on the log's clock; None: without one
    fields, units : names of its columns, and their units where the log says them
    """

    name: str
    rows: int
    span: tuple[float, float] | None = None
    fields: tuple[str, ...] = ()
    units: tuple[str, ...] = ()

    @property
    def rate(self) -> float | None:
        """Rows a second; None: unknown."""
        if self.span is None or self.rows < 2 or not self.span[1] > self.span[0]:
            return None
        return (self.rows - 1) / (self.span[1] - self.span[0])


@dataclass(frozen=True)
class Facts:
    """What a log says of itself.

    Attributes
    ----------
    format : in words
    firmware : that wrote it; empty: nobody says
    parameters : of the autopilot, by name
    tables : what it holds
    instances : how many of each sensor there are: imu, mag, baro, gps
    messages : texts that it told its user
    vehicle : the number that its board has for good; empty: nobody says
    autopilot : "ArduPilot" or "PX4"; empty: nobody says
    """

    format: str
    firmware: str = ""
    parameters: Mapping[str, float] = field(default_factory=dict)
    tables: tuple[Table, ...] = ()
    instances: Mapping[str, int] = field(default_factory=dict)
    messages: tuple[str, ...] = ()
    vehicle: str = ""
    autopilot: str = ""
