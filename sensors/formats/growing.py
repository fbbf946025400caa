"""A plain recording that is written while it is made: what a process leaves that is killed is a part that can be read.

Each stream is a file to which whole rows are appended, none of them held back. `recording.toml` is there from the first
row on and says `unfinished = true`; `finish` puts in its place one that counts the rows.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sinan.sensors.errors import InputError
from sinan.sensors.files import cannot_write, resolved, write_text
from sinan.sensors.formats.plain import COVARIATES, HEADER_FILE, require_free
from sinan.sensors.formats.plain_text import growing_header
from sinan.sensors.recording import REQUIRED_COLUMNS, Environment, Kind, Stream


class GrowingRecording:
    """A recording in a folder of its own.

    Parameters
    ----------
    folder : new or empty
    kind, environment : of the recording
    reference : kind of the reference, whose rows go to `truth`

    Raises
    ------
    InputError : the folder is in use, or cannot be written
    """

    def __init__(self, folder: Path, kind: Kind, environment: Environment, reference: str = "autopilot") -> None:
        require_free(folder)
        self.folder, self.kind, self.environment, self.reference = Path(folder), kind, environment, reference
        self.rows: dict[str, int] = {}
        #: Rows that were not written, by stream: their time does not rise, or they hold no number.
        self.left_out: dict[str, int] = {}
        #: Time of the last row of each stream [s].
        self.last: dict[str, float] = {}
        self._columns: dict[str, tuple[str, ...]] = {}
        self._files: dict[str, int] = {}

    def append(self, name: str, stream: Stream) -> Stream:
        """Append the rows whose time rises and that hold all that they must; the first rows fix the columns.

        Parameters
        ----------
        name : of the stream, or `truth`
        stream : s on the recording's clock; rows that were written before, by their time, are passed over

        Returns
        -------
        The rows that were written

        Raises
        ------
        InputError : the disk does not take them
        """
        columns = self._columns.get(name, tuple(stream.columns))
        needed = {column for alternative in REQUIRED_COLUMNS.get(name, ((),)) for column in alternative}
        values = np.stack([stream.columns.get(column, np.full(len(stream), np.nan)) for column in columns], axis=-1)
        must = [column in needed or column in COVARIATES or name in ("motors", "truth") for column in columns]
        fresh = stream.t != self.last.get(name, -np.inf)
        keep = fresh & np.isfinite(stream.t) & np.all(np.isfinite(values[:, must]), axis=1)
        high = np.maximum.accumulate(np.where(keep, stream.t, -np.inf))
        before = np.concatenate([[-np.inf], high[:-1]])
        keep &= stream.t > np.maximum(before, self.last.get(name, -np.inf))
        if lost := int(np.sum(fresh & ~keep)):
            self.left_out[name] = self.left_out.get(name, 0) + lost
        if np.any(keep):
            self._write(name, columns, stream.t[keep], values[keep])
        return stream.rows(keep)

    def _write(self, name: str, columns: tuple[str, ...], t: np.ndarray, values: np.ndarray) -> None:
        lines = [",".join(map(repr, row)) for row in np.column_stack([t, values]).tolist()]
        try:
            if name not in self._files:
                self._begin(name, columns)
                lines = [",".join(("t", *columns)), *lines]
            _whole(self._files[name], ("\n".join(lines) + "\n").encode())
        except OSError as error:
            raise cannot_write(self.folder / f"{name}.csv", error, "a folder that can be written") from None
        self.rows[name] = self.rows.get(name, 0) + len(t)
        self.last[name] = float(t[-1])

    def _begin(self, name: str, columns: tuple[str, ...]) -> None:
        if not self._files:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._say(None)
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | getattr(os, "O_BINARY", 0)
        self._files[name] = os.open(self.folder / f"{name}.csv", flags, 0o666)
        self._columns[name] = columns

    def _say(self, rows: Mapping[str, int] | None) -> None:
        reference = self.reference if rows is None or "truth" in rows else ""
        text = growing_header(resolved(self.folder).name, self.kind, self.environment, reference, rows)
        write_text(self.folder / HEADER_FILE, text)

    def finish(self) -> None:
        """End it: the recording is whole.

        Raises
        ------
        InputError : there is no row, or the disk does not take the header
        """
        if not self._files:
            raise InputError(self.folder, "not one reading", "readings")
        for file in self._files.values():
            os.fsync(file)
            os.close(file)
        self._files.clear()
        self._say(self.rows)


def _whole(file: int, data: bytes) -> None:
    """Write all of it, in one call where the system takes it."""
    while data:
        data = data[os.write(file, data) :]
