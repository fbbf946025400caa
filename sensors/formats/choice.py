"""Which of several sensors of a log are read, and whether the autopilot's own corrections are taken off again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import NoReturn

from sinan.sensors.errors import InputError


@dataclass(frozen=True)
class Choice:
    """What of a log that describes itself is read.

    Attributes
    ----------
    imu, mag, baro, gps : which of several, counted from 0 as autopilots do
    raw : take off the offsets, scales and compensation that the autopilot has put into the readings
    boot : which of several starts of the autopilot in one telemetry log, counted from 1; 0: the longest
    """

    imu: int = 0
    mag: int = 0
    baro: int = 0
    gps: int = 0
    raw: bool = False
    boot: int = 0

    @property
    def words(self) -> list[str]:
        """As they are typed behind a command; what is not chosen is not said."""
        words: list[str] = []
        for name in (one.name for one in fields(self)):
            value = getattr(self, name)
            words += [f"--{name}"] if value is True else [f"--{name}", f"{value}"] if value else []
        return words

    def require_none(self, path: Path, what: str) -> None:
        """Raise where something is chosen of a log that has no choice."""
        if self.words:
            raise InputError(" ".join(self.words), f"of {path}, {what}", "a log of an autopilot with several sensors")


FIRST = Choice()


def not_there(path: Path, sensor: str, number: int, there: Sequence[int] | int) -> NoReturn:
    """Raise for a sensor that is asked for and is not in the log.

    Parameters
    ----------
    there : which there are, or how many
    """
    known = list(range(there)) if isinstance(there, int) else list(there)
    expected = f"one of {', '.join(map(str, known))}" if known else "none: the log has no such sensor"
    raise InputError(path, f"no {sensor} number {number}", expected, f"--{sensor}")
