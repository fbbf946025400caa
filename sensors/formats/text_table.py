"""A table of text as pandas reads it, with errors that name the row and column that cannot be read."""

from __future__ import annotations

import csv
import io
import math
import re
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.packed import LONGEST_LINE, require_numbers, size_shown

#: Cells that are read at once, those of columns that nobody asked for among them.
_CELLS = 2**20
#: How programs write a number that is none; how spreadsheets and merged tables leave a cell without a reading.
NOT_A_NUMBER = ("nan", "NaN")
NO_READING = (*NOT_A_NUMBER, "", "NA", "None", "null")
#: How a column is called that holds nothing, since rows end in a separator: no name of a column.
_NOTHING = "\n"
#: A number with a comma for the point, and one with the point; rows among which one is looked for.
_COMMA, _POINT, _FIRST_ROWS = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?"), re.compile(r"[-+]?\d*\.\d+.*"), 20


class _Lines(io.RawIOBase):
    """Bytes of text whose lines are bounded: a table with one endless row would take any memory.

    Parameters
    ----------
    file : of text
    where : of the file, for messages
    """

    def __init__(self, file: BinaryIO, where: Path | str) -> None:
        self._file, self._where = file, where
        self._length = 0  # of the line that is not yet ended

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        part = self._file.read(len(buffer))
        end = part.rfind(b"\n")
        self._length = len(part) - end - 1 if end >= 0 else self._length + len(part)
        if self._length > LONGEST_LINE:
            found = f"a line of more than {size_shown(LONGEST_LINE)}"
            raise InputError(self._where, found, f"lines of at most {size_shown(LONGEST_LINE)}")
        buffer[: len(part)] = part
        return len(part)

    def close(self) -> None:
        self._file.close()
        super().close()


class _Beginning(io.RawIOBase):
    """The first bytes of a file.

    Parameters
    ----------
    file : of text
    size : so many of it
    """

    def __init__(self, file: BinaryIO, size: int) -> None:
        self._file, self._left = file, size

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        part = self._file.read(min(len(buffer), self._left))
        self._left -= len(part)
        buffer[: len(part)] = part
        return len(part)

    def close(self) -> None:
        self._file.close()
        super().close()


class TextColumns(dict[str, FloatArray]):
    """The columns of a text by name, each (n,), and `notes` of what of it was not read."""

    def __init__(self, columns: Mapping[str, FloatArray], notes: tuple[str, ...] = ()) -> None:
        super().__init__(columns)
        self.notes = notes


def text_lines(file: BinaryIO, where: Path | str) -> io.BufferedReader:
    """A file of text, as bytes, that gives no line of more than `LONGEST_LINE`.

    Raises
    ------
    InputError : when reading, a longer line
    """
    return io.BufferedReader(_Lines(file, where), 2**16)


@dataclass(frozen=True)
class TextTable:
    """Rows of text.

    Attributes
    ----------
    where : of the file, for messages
    open : opens the text as bytes, anew each time
    names : of the columns, in order
    delimiter : one character; empty: any run of blanks
    skip_lines : lines before the first row
    gaps : texts that a cell may hold instead of a number, as programs write what they do not know, or infinities

    Rows may all end in a separator after which there is nothing, and which the line of names lacks.
    """

    where: Path | str
    open: Callable[[], BinaryIO]
    names: Sequence[str]
    delimiter: str = ","
    skip_lines: int = 1
    gaps: Collection[str] = ()

    @cached_property
    def _width(self) -> int:
        """Cells of a row: the named ones, and an empty one where the first row ends in a separator."""
        try:
            first = next((cells for _, _, cells in self._cells()), [])
        except (UnicodeDecodeError, csv.Error, OSError):
            first = []
        return len(self.names) + (len(first) == len(self.names) + 1 and not first[-1].strip())

    def without_cut_line(self) -> tuple[TextTable, tuple[str, ...]]:
        """The table without a last line that lost its end, as a logger without power leaves it, and a note of it.

        Such a line has no end of line and fewer cells than a row has; one with all of them is a row.
        """
        with self.open() as file:
            size = file.seek(0, io.SEEK_END)
            file.seek(max(0, size - LONGEST_LINE))
            end = file.read(LONGEST_LINE)
        before, mark, last = end.rpartition(b"\n")
        if not mark or not last.strip() or (len(end) == size and before.count(b"\n") + 1 < self.skip_lines):
            return self, ()
        try:
            text = last.decode("utf-8")
            rows = (
                csv.reader([text], delimiter=self.delimiter, skipinitialspace=True)
                if self.delimiter
                else [text.split()]
            )
            cells = len(next(iter(rows), []))
        except (UnicodeDecodeError, csv.Error):
            return self, ()
        if cells >= self._width:
            return self, ()
        whole = replace(self, open=lambda: cast(BinaryIO, _Beginning(self.open(), size - len(last))))
        return whole, (f"the last line is cut off after {cells} of {self._width} columns, left out",)

    def read(self, wanted: Sequence[str]) -> dict[str, FloatArray] | None:
        """The wanted columns, each (n,) and to the last bit of its text; None: something in them is no number.

        Raises
        ------
        InputError : an endless line, more numbers than are read
        """
        import pandas as pd

        parts: list[dict[str, FloatArray]] = [{name: np.empty(0) for name in wanted}]
        rows, ends_early = 0, False
        try:
            with warnings.catch_warnings(), self._past_the_head() as file:
                warnings.simplefilter("error")
                for frame in self._frames(file, wanted):
                    rows += len(frame)
                    if self._width > len(self.names) and bool((frame.pop(_NOTHING).str.strip() != "").any()):
                        return None
                    ends_early |= bool(self.gaps) and bool(frame.iloc[:, -1].isna().any())
                    require_numbers(self.where, rows * len(wanted), f"after row {rows - len(frame)}")
                    parts.append({name: frame[name].to_numpy(np.float64) for name in wanted})
        except pd.errors.EmptyDataError:
            return parts[0]
        except InputError:
            raise
        except (ValueError, OverflowError, OSError, Warning) as error:
            if isinstance(error, pd.errors.ParserError) and "out of memory" in str(error):
                raise MemoryError(str(error)) from error
            return None
        if ends_early and any(len(cells) != len(self.names) for _, _, cells in self._rows()):
            return None  # a row that is cut off is not one whose last cell is empty
        return {name: np.concatenate([part[name] for part in parts]) for name in wanted}

    def read_numbers(self, own: Collection[str] = ()) -> tuple[dict[str, FloatArray], dict[str, InputError]]:
        """All columns that hold numbers, each (n,); and why any other does not.

        Parameters
        ----------
        own : the columns that must be numbers

        Raises
        ------
        InputError : rows that do not fit the names, a cell of `own` that is no number
        """
        others: dict[str, InputError] = {}
        wanted = list(self.names)
        if (columns := self.read(wanted)) is None:
            for column, error in self.culprits(wanted):
                if column is None or column in own:
                    raise error
                others[column] = error
            wanted = [name for name in wanted if name not in others]
            columns = self.read(wanted)
        if columns is None:
            raise self.culprit(wanted)[1]
        return columns, others

    def first(self, name: str) -> str:
        """The cell of a column in the first row; empty: there is none."""
        try:
            row = next((cells for _, _, cells in self._rows()), [])
        except (UnicodeDecodeError, csv.Error, OSError):
            return ""
        return row[self.names.index(name)] if len(row) == len(self.names) else ""

    def texts(self, name: str) -> list[str]:
        """The cells of a column, as they are written; empty where a row ends before it.

        Raises
        ------
        InputError : not UTF-8, no table
        """
        k = self.names.index(name)
        try:
            return [cells[k] if k < len(cells) else "" for _, _, cells in self._rows()]
        except (UnicodeDecodeError, csv.Error, OSError) as error:
            raise InputError(self.where, f"{type(error).__name__} in column {name}", "a table of UTF-8 text") from None

    def _past_the_head(self) -> io.BufferedReader:
        """The text from the first row on."""
        file = text_lines(self.open(), self.where)
        for _ in range(self.skip_lines):
            if not file.readline():
                break
        return file

    def _frames(self, file: io.BufferedReader, wanted: Collection[str]) -> Any:
        """The rows as tables of pandas, some at a time."""
        import pandas as pd

        names = [*self.names, _NOTHING][: self._width]
        # The default of pandas 3 is exact; before, exact had to be asked for.
        exact = {"float_precision": "round_trip"} if int(pd.__version__.split(".")[0]) < 3 else {}
        return pd.read_csv(
            file, sep=self.delimiter or r"\s+", header=None, names=names, index_col=False,
            dtype={name: np.float64 if name in wanted else str for name in names}, encoding="utf-8-sig",
            skipinitialspace=True, keep_default_na=False, na_values=dict.fromkeys(self.names, sorted(self.gaps)),
            decimal=self._decimal(), chunksize=max(1, _CELLS // len(self.names)), **exact,
        )  # fmt: skip

    def culprit(self, wanted: Sequence[str]) -> tuple[str | None, InputError]:
        """The column and the error of the first row that `read` could not take."""
        return next(self.culprits(wanted))

    def culprits(self, wanted: Sequence[str]) -> Iterator[tuple[str | None, InputError]]:
        """The columns that `read` could not take, each once with the error of its first row; last what ends the table.

        A column of None is an error of the table, and the last one.
        """
        count = f"{len(self.names)} columns ({', '.join(self.names)})"
        good, asked, decimal = set(wanted), len(set(wanted)), self._decimal()
        row = 0
        try:
            for row, line, cells in self._rows():
                place = f"row {row} (line {line})"
                if len(cells) != len(self.names):
                    yield None, InputError(self.where, f"{len(cells)} columns", count, place)
                    return
                for name, cell in zip(self.names, cells, strict=True):
                    if name in good and not self._holds(cell, decimal):
                        good.remove(name)
                        found = f"`{cell[:40]}`" if cell.strip() else "an empty cell"
                        yield name, InputError(self.where, f"{found} in column {name}", "a number", place)
        except UnicodeDecodeError as error:
            found = f"byte 0x{error.object[error.start]:02x}"
            yield None, InputError(self.where, found, "UTF-8 text", f"after row {row}")
            return
        except (csv.Error, OSError) as error:
            yield None, InputError(self.where, str(error), "a table of text", f"after row {row}")
            return
        if len(good) == asked:
            separated = f"separated by `{self.delimiter}`" if self.delimiter else "separated by blanks"
            yield None, InputError(self.where, "rows that cannot be read", f"{count}, {separated}")

    def _holds(self, cell: str, decimal: str) -> bool:
        """Whether a cell is a number, or one of the texts that stand for none."""
        return is_number(cell.replace(decimal, ".")) or bool(self.gaps and cell.lstrip("+-") in (*self.gaps, "inf"))

    def _decimal(self) -> str:
        """What stands for the point of numbers: a comma, where cells have one and none has a point."""
        if self.delimiter not in (";", "\t"):
            return "."
        try:
            cells = [cell for _, _, row in islice(self._rows(), _FIRST_ROWS) for cell in row]
        except (UnicodeDecodeError, csv.Error, OSError):
            return "."
        return decimal_of(cells)

    def _rows(self) -> Iterator[tuple[int, int, list[str]]]:
        """Row number, line number and cells of every row, but for an empty one after the last separator."""
        for row, line, cells in self._cells():
            nothing = len(cells) == self._width > len(self.names) and not cells[-1].strip()
            yield row, line, cells[:-1] if nothing else cells

    def _cells(self) -> Iterator[tuple[int, int, list[str]]]:
        """Row number, line number and all cells of every row."""
        row = 0
        with io.TextIOWrapper(self._past_the_head(), encoding="utf-8-sig", newline="") as text:
            lines = csv.reader(text, delimiter=self.delimiter or " ", skipinitialspace=True)
            for cells in lines:
                found = cells if self.delimiter else " ".join(cells).split()
                if found and found != [""]:
                    row += 1
                    yield row, lines.line_num + self.skip_lines, found


def decimal_of(cells: Collection[str]) -> str:
    """What stands for the point of numbers, in cells that no comma separates."""
    return "," if any(map(_COMMA.fullmatch, cells)) and not any(map(_POINT.fullmatch, cells)) else "."


def doubled_name(names: Sequence[str]) -> str | None:
    """The first name that is given twice; None: there is none."""
    seen: set[str] = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return None


def is_number(text: str) -> bool:
    """Whether a cell of text is a finite number as CSV writes one."""
    try:
        return text.isascii() and "_" not in text and math.isfinite(float(text))
    except ValueError:
        return False
