"""CSV with a header line that names its columns: what the plain format is made of."""

from __future__ import annotations

import csv
import io
from collections.abc import Collection
from pathlib import Path
from typing import BinaryIO

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.packed import require_columns
from sinan.sensors.formats.text_table import TextTable, doubled_name, is_number

#: The longest header line that is read [characters]: a binary file must not be taken for one endless name.
_HEADER_LIMIT = 100_000


def read_csv(path: Path, own: Collection[str], cut_off: bool = False) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """The columns of a CSV file, in its order, each (n,) and to the last bit of its text.

    Parameters
    ----------
    path : of the file
    own : the columns that must be numbers; any other column that is not is left out
    cut_off : a last line without an end is a part of one, and is left out

    Returns
    -------
    columns : by name
    left_out : the other columns that are not numbers throughout

    Raises
    ------
    InputError : unreadable, not UTF-8, no header, a name given twice, a row of the wrong length, a cell of `own` that
        is no number; rows count from 1, the first row of data
    """
    names = read_header_line(path)
    table = TextTable(path, lambda: _whole_lines(path) if cut_off else path.open("rb"), names)
    columns, _ = table.read_numbers(own)
    finite = {name: values for name, values in columns.items() if name in own or np.all(np.isfinite(values))}
    return finite, tuple(name for name in names if name not in finite)


def _whole_lines(path: Path) -> BinaryIO:
    content = path.read_bytes()
    return io.BytesIO(content[: content.rfind(b"\n") + 1])


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
    if all(is_number(name) for name in names):
        raise InputError(path, f"numbers ({names[0]} ...)", "a header that names the columns", "line 1")
    require_columns(path, len(names), "line 1")
    if "" in names:
        found = f"no name for column {names.index('') + 1}"
        raise InputError(path, found, "a header that names the columns", "line 1")
    if (doubled := doubled_name(names)) is not None:
        raise InputError(path, f"column {doubled} twice", "every column once", "line 1")
    return names
