"""A table of text as pandas reads it, with errors that name the row and column that cannot be read."""

from __future__ import annotations

import csv
import io
import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from sensors.arrays import FloatArray
from sensors.errors import InputError


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
    """

    where: Path | str
    open: Callable[[], BinaryIO]
    names: Sequence[str]
    delimiter: str = ","
    skip_lines: int = 1

    def read(self, wanted: Sequence[str]) -> dict[str, FloatArray] | None:
        """The wanted columns, each (n,) and to the last bit of its text; None: something in them is no number."""
        import pandas as pd

        # The default of pandas 3 is exact; before, exact had to be asked for.
        exact = {"float_precision": "round_trip"} if int(pd.__version__.split(".")[0]) < 3 else {}
        kinds = {name: np.float64 if name in wanted else str for name in self.names}
        try:
            with warnings.catch_warnings(), self.open() as file:
                warnings.simplefilter("error")
                frame = pd.read_csv(
                    file, sep=self.delimiter or r"\s+", skiprows=self.skip_lines, header=None, names=list(self.names),
                    index_col=False, dtype=kinds, encoding="utf-8-sig", skipinitialspace=True, keep_default_na=False,
                    **exact,
                )  # fmt: skip
        except pd.errors.EmptyDataError:
            return {name: np.empty(0) for name in wanted}
        except (ValueError, OverflowError, Warning):
            return None
        return {name: frame[name].to_numpy(np.float64) for name in wanted}

    def culprit(self, wanted: Sequence[str]) -> tuple[str | None, InputError]:
        """The column and the error of the first row that `read` could not take."""
        count = f"{len(self.names)} columns ({', '.join(self.names)})"
        row = 0
        try:
            for row, line, cells in self._rows():
                place = f"row {row} (line {line})"
                if len(cells) != len(self.names):
                    return None, InputError(self.where, f"{len(cells)} columns", count, place)
                for name, cell in zip(self.names, cells, strict=True):
                    if name in wanted and not is_number(cell):
                        found = f"`{cell[:40]}`" if cell.strip() else "an empty cell"
                        return name, InputError(self.where, f"{found} in column {name}", "a number", place)
        except UnicodeDecodeError as error:
            found = f"byte 0x{error.object[error.start]:02x}"
            return None, InputError(self.where, found, "UTF-8 text", f"after row {row}")
        except (csv.Error, OSError) as error:
            return None, InputError(self.where, str(error), "a table of text", f"after row {row}")
        separated = f"separated by `{self.delimiter}`" if self.delimiter else "separated by blanks"
        return None, InputError(self.where, "rows that cannot be read", f"{count}, {separated}")

    def _rows(self) -> Iterator[tuple[int, int, list[str]]]:
        """Row number, line number and cells of every row."""
        row = 0
        with io.TextIOWrapper(self.open(), encoding="utf-8-sig", newline="") as text:
            for _ in range(self.skip_lines):
                text.readline()
            lines = csv.reader(text, delimiter=self.delimiter or " ", skipinitialspace=True)
            for cells in lines:
                found = cells if self.delimiter else " ".join(cells).split()
                if found and found != [""]:
                    row += 1
                    yield row, lines.line_num + self.skip_lines, found


def is_number(text: str) -> bool:
    """Whether a cell of text is a finite number as CSV writes one."""
    try:
        return "_" not in text and math.isfinite(float(text))
    except ValueError:
        return False
