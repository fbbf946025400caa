"""How a question was put, for the words of its answer; and what every answer can do."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.recording import Recording
from sinan.sensors.window import WHOLE, Span


@dataclass(frozen=True)
class Asked:
    """How the user calls a recording: what the command line knows of it, and a script does not.

    Attributes
    ----------
    called : name in the report; empty: the recording's own
    input : what a command is typed with; empty: the recording's file, else its name
    map_file, span, choice : how it was read
    """

    called: str = ""
    input: str = ""
    map_file: Path | None = None
    span: Span = WHOLE
    choice: Choice = FIRST

    def name_of(self, recording: Recording) -> str:
        """Name in the report."""
        return self.called or recording.name

    def input_of(self, recording: Recording) -> str:
        """What a command is typed with."""
        return self.input or recording.source or recording.name

    def call_of(self, recording: Recording, sensor: str | None = None) -> str:
        """The command that looks for what a model lacks; of what no file has the line of a script."""
        if not (self.input or recording.source):
            return "sinan.trace(recording)"
        from sinan.experiments.report.words import trace_call

        return trace_call(self.input_of(recording), self.map_file, sensor, self.span, self.choice)

    @property
    def window(self) -> list[float | None] | None:
        """The part that was asked for, as JSON has it."""
        return None if self.span == WHOLE else list(self.span)


#: Nothing is known but the recording.
PLAIN = Asked()


class Answer(ABC):
    """What every answer can do; ``print(answer)`` shows what the command line shows."""

    document: Mapping[str, Any]

    @abstractmethod
    def summary(self) -> str:
        """What the terminal shows, line by line."""

    @abstractmethod
    def to_html(self, path: str | Path) -> Path:
        """Write the page of the command's `--html`: one file that needs no other. Returns its path.

        Parameters
        ----------
        path : of the file; one that is there is replaced
        """

    def to_json(self, path: str | Path) -> Path:
        """Write `document`, the numbers of the command's `--json`. Returns the path.

        Parameters
        ----------
        path : of the file; one that is there is replaced
        """
        from sinan.experiments.report.files import write_json

        write_json(Path(path), self.document)
        return Path(path)

    def __str__(self) -> str:
        return self.summary()

    def __repr__(self) -> str:
        return self.summary()
