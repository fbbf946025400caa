"""CSV with a header line and numbers: read by pandas, with errors that name file, row and column."""

from __future__ import annotations

import csv
import math
import warnings
from collections.abc import Collection
from pathlib import Path

import numpy as np

from sensors.arrays import FloatArray
from sensors.errors import InputError

#: The longest header line that is read [characters]: a binary file must not be taken for one endless name.
_HEADER_LIMIT = 100_000


def read_csv(path: Path, own: Collection[str]) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """The columns of a CSV file, in its order, each (n,) and to the last bit of its text.

    Parameters
    ----------
    path : of the file
    own : the columns that must be numbers; any other column that is not is left out

    Returns
    -------
    columns : by name
    left_out : the other columns that are not numbers throughout

    Raises
    ------
    InputError : unreadable, not UTF-8, no header, a name given twice, a row of the wrong length, a cell of `own` that is
        no number; rows count from 1, the first row of data
    """
    names = read_header_line(path)
    keep = list(names)
    while True:
        columns = _numbers(path, names, keep)
        if columns is not None:
            break
        column, error = _culprit(path, names, keep)
        if column is None or column in own:
            raise error
        keep.remove(column)
    finite = {name: values for name, values in columns.items() if name in own or np.all(np.isfinite(values))}
    return finite, tuple(name for name in names if name not in finite)


def _numbers(path: Path, names: list[str], keep: list[str]) -> dict[str, FloatArray] | None:
    """The columns to keep, or None where pandas cannot take them: it does not say where."""
    import pandas as pd

    # The default of pandas 3 is exact; before, exact had to be asked for.
    exact = {"float_precision": "round_trip"} if int(pd.__version__.split(".")[0]) < 3 else {}
    kinds = {name: np.float64 if name in keep else str for name in names}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            frame = pd.read_csv(
                path, skiprows=1, header=None, names=names, index_col=False, dtype=kinds, encoding="utf-8-sig",
                skipinitialspace=True, keep_default_na=False, **exact,
            )  # fmt: skip
    except pd.errors.EmptyDataError:
        return {name: np.empty(0) for name in keep}
    except (ValueError, OverflowError, Warning):
        return None
    return {name: frame[name].to_numpy(np.float64) for name in keep}


def read_header_line(path: Path) -> list[str]:
    """The names in the first line of a CSV file.

    Raises
    ------
    InputError : unreadable, not UTF-8, binary, a column without a name or with one given twice, numbers for names
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            line = file.readline(_HEADER_LIMIT)
    except UnicodeDecodeError as error:
        raise InputError(path, f"byte 0x{error.object[error.start]:02x}", "UTF-8 text", "line 1") from None
    except OSError as error:
        raise InputError(path, error.strerror or type(error).__name__, "a readable CSV file") from None
    names = [name.strip() for name in next(csv.reader([line]), [])] if "\0" not in line else ["\0"]
    if not any(names):
        raise InputError(path, "empty first line", "a header that names the columns", "line 1")
    if not all(name.isprintable() for name in names) or len(line) >= _HEADER_LIMIT:
        raise InputError(path, "binary data", "a header that names the columns", "line 1")
    for k, name in enumerate(names):
        if not name:
            raise InputError(path, f"no name for column {k + 1}", "a header that names the columns", "line 1")
        if name in names[:k]:
            raise InputError(path, f"column {name} twice", "every column once", "line 1")
    if all(is_number(name) for name in names):
        raise InputError(path, f"numbers ({names[0]} ...)", "a header that names the columns", "line 1")
    return names


def _culprit(path: Path, names: list[str], keep: list[str]) -> tuple[str | None, InputError]:
    """The column and the error of the first row that pandas could not take."""
    count = f"{len(names)} columns ({', '.join(names)})"
    row = 0
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = csv.reader(file, skipinitialspace=True)
            next(lines)
            for cells in lines:
                if not cells or cells == [""]:
                    continue
                row += 1
                place = f"row {row} (line {lines.line_num})"
                if len(cells) != len(names):
                    return None, InputError(path, f"{len(cells)} columns", count, place)
                for name, cell in zip(names, cells, strict=True):
                    if name in keep and not is_number(cell):
                        found = f"`{cell[:40]}`" if cell.strip() else "an empty cell"
                        return name, InputError(path, f"{found} in column {name}", "a number", place)
    except UnicodeDecodeError as error:
        return None, InputError(path, f"byte 0x{error.object[error.start]:02x}", "UTF-8 text", f"after row {row}")
    except (csv.Error, OSError) as error:
        return None, InputError(path, str(error), "CSV", f"after row {row}")
    return None, InputError(path, "rows that cannot be read", f"{count}, separated by commas")


def is_number(text: str) -> bool:
    """Whether a cell of text is a finite number as CSV writes one."""
    try:
        return "_" not in text and math.isfinite(float(text))
    except ValueError:
        return False
