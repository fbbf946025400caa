"""Any file as named columns: the reader is found by the content, the options come from a map."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError, with_extra
from sinan.sensors.formats import dataflash, dataflash_messages, matlab, mavlink_frames, mwlog, ubx, ulog_messages
from sinan.sensors.formats.column_names import INERTIAL, meanings
from sinan.sensors.formats.named_columns import describes_itself
from sinan.sensors.formats.packed import kind_of, read_packed, require_columns, require_numbers
from sinan.sensors.formats.records import RecordLayout, read_records
from sinan.sensors.formats.text_table import (
    NO_READING,
    TextColumns,
    TextTable,
    decimal_of,
    doubled_name,
    is_number,
    text_lines,
)

#: Names of columns that a message shows.
_SHOWN = 6
#: How texts begin that hold no table, as patterns, and what they are.
_PROGRAMS = {
    r"\$VN": "sentences of a VectorNav, one a line: its binary output exported as CSV, or a map with `columns`",
    r"[#%]\w+A,": "messages of a NovAtel receiver: those of one kind are a table, which a map reads by the numbers of "
    "its columns (`grep RAWIMUSA LOG | tr ';*' ','`, of the IMU's counts)",
    r".*RINEX VERSION / TYPE": "RINEX, which `sinan gnss OBS NAV` reads",
    r"\d\d?:\d\d:\d\d[.\d]* -> ": "lines of a serial monitor: `sed 's/ -> /,/'` makes cells, below names (time,ax [g])",
    r"[A-Za-z]\w*\s*[:=]\s*[-+.\d]+\s*[,;\t ]": "a name in every cell, which belong into one line above the numbers",
    r"\$G": "NMEA sentences: fixes of a receiver, without any other sensor",
    "H Product:Blackbox": "a Blackbox log: blackbox_decode makes the CSV that the map of docs/formats.md reads",
}
#: Times of day, with a date of some kind before them; dates of ISO 8601; lengths of time as MATLAB writes them.
_MOMENT = re.compile(r"(\d{1,4}[-/.](\d\d?|[A-Za-z]{3})[-/.]\d{1,4}[ T])?\d\d?:\d\d:\d\d")
_ISO, _SPAN = re.compile(r"\d{4}-\d\d-\d\d[ T]"), re.compile(r"\d+(\.\d+)?(e[-+]\d+)? sec")
#: Lines among which the names of the columns are looked for: programs write some about the device above them.
_HEAD_LINES = 30
DELIMITERS = {"comma": ",", "semicolon": ";", "tab": "\t", "blank": ""}


@dataclass(frozen=True)
class FileOptions:
    """How one file of a log is read; the defaults suit a file that describes itself.

    Attributes
    ----------
    path : of the file, relative to the log or its folder; empty: the log itself
    member : of the file inside a zip
    columns : names of the columns of text, in order; empty: from the header line, else "1", "2", ...
    delimiter : a key of `DELIMITERS`; empty: found from the first row
    skip_lines, skip_end : lines of text to pass over, before the header line if there is one, and at the end
    header : whether the first line after them names the columns
    records : layout of a binary log of fixed records
    """

    path: str = ""
    member: str = ""
    columns: tuple[str, ...] = ()
    delimiter: str = ""
    skip_lines: int = 0
    skip_end: int = 0
    header: bool = False
    records: RecordLayout | None = None


#: First bytes of a file, and what it then is.
MAGICS = {
    mwlog.MAGIC: "mwlog", matlab.MAGIC_5: "matlab", ulog_messages.MAGIC: "ulog", ubx.MAGIC: "ubx",
    dataflash_messages.MAGIC: "dataflash_binary", b"#ROSBAG V2.0": "rosbag", b"SQLite format 3\0": "sqlite",
    b"\x89MCAP0\r\n": "mcap", b"PAR1": "parquet",
}  # fmt: skip


def content_of(path: Path) -> str:
    """What a file is, by its first bytes: mwlog, matlab, ulog, ubx, dataflash, dataflash_binary, rosbag, sqlite,
    mcap, parquet, tlog, empty, text, or how it is packed.

    Raises
    ------
    InputError : the file cannot be read
    """
    try:
        with path.open("rb") as file:
            head = file.read(1024)
        if matlab.is_hdf5(path):
            return "matlab"
    except OSError as error:
        raise InputError(path, error.strerror or type(error).__name__, "a readable file") from None
    if not head:
        return "empty"
    for magic, content in MAGICS.items():
        if head.startswith(magic):
            return content
    if mavlink_frames.is_telemetry(head):
        return "tlog"
    return kind_of(head) or ("dataflash" if dataflash_messages.MAGIC_TEXT.search(head) else "text")


def notes_of(columns: Mapping[str, FloatArray]) -> tuple[str, ...]:
    """What a reader of `read_columns` could not read and passed over."""
    known = ulog_messages.Topics | dataflash_messages.Columns | TextColumns
    return columns.notes if isinstance(columns, known) else ()


def read_columns(path: Path, options: FileOptions, wanted: Collection[str]) -> Mapping[str, FloatArray]:
    """The columns of a file by name, each (n,); columns of one table have one length.

    Parameters
    ----------
    path : of the log, a file or a folder
    options : how to read it
    wanted : the names that will be asked for; of text only these are read as numbers

    Raises
    ------
    InputError : what the reader of that content finds wrong
    """
    path = (path if path.is_dir() else path.parent) / options.path if options.path else path
    if not path.is_file():
        raise InputError(path, "a folder" if path.is_dir() else "no such file", "a file")
    if options.records is not None:
        return read_records(path, options.records)
    content = content_of(path)
    if content == "empty":
        raise InputError(path, "an empty file", "readings")
    if content == "mwlog":
        return mwlog.read_mwlog(path)
    if content == "matlab":
        return matlab.columns_of(matlab.read_matlab(path))
    if content == "ulog":
        return ulog_messages.read_topics(path)
    if content == "ubx":
        return ubx.read_ubx(path)
    if content == "dataflash_binary":
        return dataflash_messages.Columns(dataflash_messages.read_messages(path))
    if content == "dataflash":
        return dataflash.read_dataflash(path, wanted)
    if content == "parquet":
        return read_parquet(path)
    return _read_text(path, options, wanted)


def read_named(path: Path) -> dict[str, FloatArray] | None:
    """The columns of a text with a header, or of Parquet, that say what they are; None: none does, or another content.

    Raises
    ------
    InputError : what the reader of that content finds wrong
    """
    content = content_of(path)
    if content == "parquet":
        columns = read_parquet(path)
        return columns if describes_itself(list(columns)) else None
    options = _head(path)
    if options is None:
        return None
    names, delimiter = _layout(str(path), _text(path, options), options)
    wanted = list(meanings(names))
    table = TextTable(path, _text(path, options), names, delimiter, options.skip_lines + options.header, NO_READING)
    table, notes = table.without_cut_line()
    moments = {name for name, what in meanings(names).items() if what.column == "t" and _is_moment(table.first(name))}
    numbers = [name for name in wanted if name not in moments]
    found = table.read(numbers)
    if found is None:
        raise table.culprit(numbers)[1]
    found |= {name: _moments(path, name, table.texts(name)) for name in moments}
    for name, what in meanings(names).items():
        if (what.column == "t" or what.stream in INERTIAL) and not np.all(np.isfinite(found[name])):
            raise replace(table, gaps=()).culprit([name])[1]
    return TextColumns({name: found.get(name, np.empty(0)) for name in names}, notes)


def _is_moment(cell: str) -> bool:
    """Whether a cell is a date with a time of day, or a time of day."""
    return _MOMENT.match(cell) is not None or _SPAN.fullmatch(cell) is not None


def _moments(path: Path, name: str, cells: list[str]) -> FloatArray:
    """(n,) seconds after the first of times of day, with or without a date: as ISO 8601 has it, or in another way that
    changes once a day; or of lengths of time, `0.01 sec`.
    """
    import pandas as pd

    try:
        column = pd.Series(cells)
        if _ISO.match(cells[0]):
            times = pd.to_datetime(column, format="ISO8601", utc=True)
        else:
            parts = [cell.rsplit(" ", 1) if _MOMENT.match(cell) else ["", cell] for cell in cells]
            days = np.cumsum([0] + [a[:-1] != b[:-1] for a, b in pairwise(parts)])
            times = pd.to_timedelta([part[-1] for part in parts]).to_series(index=column.index)
            times += pd.to_timedelta(days, unit="D")
    except (ValueError, OverflowError) as error:
        raise InputError(path, f"{str(error)[:80]} in column {name}", "2023-05-05 12:00:00.123 in every row") from None
    return np.asarray((times - times.iloc[0]) / pd.Timedelta(1, "s"), dtype=np.float64)


def _head(path: Path) -> FileOptions | None:
    """Where the line stands whose names say what the columns hold, among the first; their units may be the next."""
    try:
        with text_lines(_text(path, FileOptions())(), path) as lines:
            first = [lines.readline().decode("utf-8-sig").rstrip("\r\n") for _ in range(_HEAD_LINES)]
    except (InputError, UnicodeDecodeError, OSError):
        return None
    for k, line in enumerate(first[:-1]):
        names = [cell or str(number) for number, cell in enumerate(_cells(line), 1)]
        if not describes_itself(names) or doubled_name(names) is not None:
            continue
        if any(len(_cells(above, _delimiter(line))) == len(names) for above in first[:k]):
            return None  # names of two lines belong together
        units = [cell.replace("(", "").replace(")", "") for cell in _cells(first[k + 1], _delimiter(line))]
        numbers = any(map(is_number, _points(units, _delimiter(line))))
        if len(units) != len(names) or numbers or not any(units) or any(map(_is_moment, units)):
            return FileOptions(header=True, skip_lines=k)
        named = tuple(f"{name} [{unit}]" if unit.strip("-") else name for name, unit in zip(names, units, strict=True))
        separated = next(key for key, mark in DELIMITERS.items() if mark == _delimiter(line))
        return FileOptions(columns=named, skip_lines=k + 2, delimiter=separated)
    return None


def _cells(line: str, delimiter: str | None = None) -> list[str]:
    """The cells of a line of text; none of one that is binary."""
    if not all(letter.isprintable() or letter == "\t" for letter in line):
        return []
    delimiter = _delimiter(line) if delimiter is None else delimiter
    try:
        cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), []) if delimiter else line.split()
    except csv.Error:
        return []
    return [cell.strip() for cell in cells]


def seen_in(path: Path) -> str:
    """What the first lines of a text look like, in words; empty: no table.

    Names that stand in two lines are told, and how a map passes over them.
    """
    try:
        with text_lines(_text(path, FileOptions())(), path) as lines:
            written = [lines.readline() for _ in range(2)]
        first, second = (line.decode("utf-8-sig").strip() for line in written)
    except UnicodeDecodeError:
        return _encoded(written[0])
    except (InputError, OSError):
        return ""
    if not first or not all(letter.isprintable() or letter == "\t" for letter in first + second):
        return ""
    if program := next((told for begin, told in _PROGRAMS.items() if re.match(begin, first)), ""):
        return program
    delimiter = _delimiter(first)
    heads = [[cell.strip() for cell in line.split(delimiter or None)] for line in (first, second)]
    if len(heads[0]) > 3 and all(map(is_number, heads[0])):
        row = ", ".join(heads[0][:_SHOWN])
        return f"{len(heads[0])} numbers a line and no names ({row}), which a map counts from 1 or its `columns` name"
    if len(heads[0]) < 2 or any(map(is_number, heads[0])):
        return ""
    shown = [", ".join(cells[:_SHOWN]) + (", ..." if len(cells) > _SHOWN else "") for cells in heads]
    if len(heads[1]) == len(heads[0]) and not any(map(is_number, heads[1])):
        names = f"two lines of names (`{shown[0]}`; `{shown[1]}`)"
        return f"{names}, which a map passes over with skip_lines = 2 and its own `columns`"
    doubled = doubled_name(heads[0])
    what = f"column {doubled} twice" if doubled else "no accelerometer or magnetometer"
    return f"{what} among the columns `{shown[0]}`"


def _encoded(line: bytes) -> str:
    """How a line is written that is not UTF-8; empty: it may be no text."""
    if line.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "UTF-16, not UTF-8, as which an editor or `iconv -f utf-16 -t utf-8` writes it"
    text = line.decode("latin-1").rstrip("\r\n")
    if not all(letter.isprintable() or letter == "\t" for letter in text):
        return ""
    return f"not UTF-8 (`{text[:60]}`), as which an editor or `iconv -f latin1 -t utf-8` writes it"


def names_of(path: Path) -> list[str]:
    """The names in the first line of a text.

    Raises
    ------
    InputError : no text, a name twice
    """
    return list(table_of(path).names)


def table_of(path: Path, gaps: Collection[str] = ()) -> TextTable:
    """A text whose first line names its columns.

    Parameters
    ----------
    gaps : texts that cells may hold instead of numbers

    Raises
    ------
    InputError : no text, a name twice
    """
    options = FileOptions(header=True)
    names, delimiter = _layout(str(path), _text(path, options), options)
    return TextTable(path, _text(path, options), names, delimiter, gaps=gaps)


def read_parquet(path: Path) -> dict[str, FloatArray]:
    """The columns of numbers of a Parquet file; times become seconds since 1970, missing numbers NaN.

    Raises
    ------
    InputError : no `pyarrow`, a damaged file, more numbers than are read
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet as parquet
    except ImportError:
        raise InputError(path, "a Parquet file", with_extra("parquet")) from None
    try:
        with parquet.ParquetFile(path) as file:
            fields = [field for field in file.schema_arrow
                      if pa.types.is_integer(field.type) or pa.types.is_floating(field.type)
                      or pa.types.is_timestamp(field.type)]  # fmt: skip
            require_columns(path, len(fields))
            require_numbers(path, file.metadata.num_rows * len(fields))
            table = file.read([field.name for field in fields], use_threads=False)
            return {field.name: _numbers_of(table.column(k), field.type) for k, field in enumerate(fields)}
    except InputError:
        raise
    except Exception as error:  # the library lets through what the bytes make it stumble over
        raise InputError(path, f"damaged Parquet ({type(error).__name__}: {error})", "a whole Parquet file") from None


def _numbers_of(column: Any, kind: Any) -> FloatArray:
    import pyarrow as pa

    if pa.types.is_timestamp(kind):
        seconds = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[kind.unit]
        whole = column.cast(pa.int64()).to_numpy(zero_copy_only=False) if hasattr(column, "cast") else column
        return np.asarray(whole, dtype=np.float64) * seconds
    return np.asarray(column.to_numpy(), dtype=np.float64)


def _read_text(path: Path, options: FileOptions, wanted: Collection[str]) -> dict[str, FloatArray]:
    where = f"{path}({options.member})" if options.member else str(path)
    text = _text(path, options)
    names, delimiter = _layout(where, text, options)
    table = TextTable(where, text, names, delimiter, options.skip_lines + options.header)
    table, notes = table.without_cut_line()
    present = [name for name in names if name in wanted]
    columns = table.read(present)
    if columns is None:
        raise table.culprit(present)[1]
    return TextColumns(columns | {name: np.empty(0) for name in names if name not in columns}, notes)


def _text(path: Path, options: FileOptions) -> Callable[[], BinaryIO]:
    """What opens the text of a file: unfolded where it is packed, without the lines to leave out at its end."""
    with path.open("rb") as file:
        packed = kind_of(file.read(6))
    if not packed and not options.skip_end:
        return lambda: path.open("rb")
    data = read_packed(path, options.member if packed == "zip" else None)
    if options.skip_end:
        lines = data.rstrip(b"\r\n").rsplit(b"\n", options.skip_end)
        data = lines[0] + b"\n" if len(lines) > options.skip_end else b""
    return lambda: io.BytesIO(data)


def _layout(where: str, text: Callable[[], BinaryIO], options: FileOptions) -> tuple[list[str], str]:
    """The names of the columns and the delimiter, from the options or from the first line."""
    place = f"line {options.skip_lines + 1}"
    with text_lines(text(), where) as lines:
        for _ in range(options.skip_lines):
            if not lines.readline():
                break
        line = lines.readline()
    if not line.strip():
        raise InputError(where, "no text", "rows of numbers", place)
    try:
        first = line.decode("utf-8-sig" if options.skip_lines == 0 else "utf-8").rstrip("\r\n")
    except UnicodeDecodeError as error:
        raise InputError(where, f"byte 0x{error.object[error.start]:02x}", "UTF-8 text", place) from None
    if not all(letter.isprintable() or letter == "\t" for letter in first):
        raise InputError(where, "binary data", "text", place)
    delimiter = DELIMITERS[options.delimiter] if options.delimiter else _delimiter(first)
    try:
        cells = next(csv.reader([first], delimiter=delimiter, skipinitialspace=True)) if delimiter else first.split()
    except csv.Error as error:
        raise InputError(where, str(error), "a row of cells", place) from None
    require_columns(where, len(cells), place)
    if options.header:
        names = [cell.strip() or str(k + 1) for k, cell in enumerate(cells)]
    else:
        names = list(options.columns) or [str(k + 1) for k in range(len(cells))]
        if not options.columns and not any(map(is_number, _points(cells, delimiter))):
            hint = "numbers; `header = true` for a line of names, or `skip_lines`"
            raise InputError(where, f"`{first[:60]}`", hint, place)
    doubled = doubled_name(names)
    if doubled is not None:
        raise InputError(where, f"column {doubled} twice", "every column once", place)
    return names, delimiter


def _points(cells: Sequence[str], delimiter: str) -> list[str]:
    """Cells of a row, whose numbers have points where they had commas."""
    decimal = "." if delimiter == "," else decimal_of(cells)
    return [cell.replace(decimal, ".") for cell in cells]


def _delimiter(line: str) -> str:
    """What separates the cells of a line: of semicolons and tabs one that has at most two commas to each, which are the
    points of numbers, else the comma.
    """
    counts = {mark: line.count(mark) for mark in (";", "\t", ",")}
    apart = next((mark for mark in (";", "\t") if counts[mark] and counts[","] <= 2 * counts[mark]), "")
    return apart or ("," if counts[","] else "")
