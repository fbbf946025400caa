"""What the loop said of one measured log, for the gallery."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sinan.experiments.measured.logs import Entry


@dataclass
class TracedLog:
    """What the loop said of one log.

    Attributes
    ----------
    entry, name : of the log
    document : the report of the trace; empty where it did not finish
    notes : what was taken from the log
    references : label, before and after, words of the unit
    undecided : sentences
    known_otherwise : what others published of an effect's parameters, or the reference's rates show of the gyroscope
    seconds : of the processor, for the trace
    failure : why it did not finish; empty where it did
    """

    entry: Entry
    name: str
    document: Mapping[str, Any] = field(default_factory=dict)
    notes: Sequence[str] = ()
    references: Sequence[tuple[str, float, float, str]] = ()
    undecided: Sequence[str] = ()
    known_otherwise: str = ""
    seconds: float = 0.0
    failure: str = ""

    @property
    def command(self) -> str:
        """What repeats it."""
        given = f"'{self.entry.input}'" if " " in self.entry.input or "#" in self.entry.input else self.entry.input
        return f"sinan trace {given}" + (f" --sensor {self.entry.sensor}" if self.entry.sensor else "")
