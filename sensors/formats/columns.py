"""Any file as named columns: the reader is found by the content, the options come from a map."""

from __future__ import annotations

import csv
import gzip
import io
import zipfile
import zlib
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sensors.arrays import FloatArray
from sensors.errors import InputError
from sensors.formats import dataflash, matlab, mwlog, ubx, ulog
from sensors.formats.records import RecordLayout, read_records
from sensors.formats.text_table import TextTable, is_number

#: The most text that a compressed file may unfold to [bytes]: 10 h at 200 Hz are about 500 MB.
UNFOLDED_LIMIT = 2**30
_ZIP, _GZIP = b"PK\x03\x04", b"\x1f\x8b"
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


def content_of(path: Path) -> str:
    """What a file is, by its first bytes: mwlog, matlab, ulog, ubx, dataflash, zip, gzip, empty or text.

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
    magics = {
        mwlog.MAGIC: "mwlog", matlab.MAGIC_5: "matlab", ulog.MAGIC: "ulog", ubx.MAGIC: "ubx",
        _ZIP: "zip", _GZIP: "gzip",
    }  # fmt: skip
    for magic, content in magics.items():
        if head.startswith(magic):
            return content
    return "dataflash" if dataflash.MAGIC.encode() in head else "text"


def read_columns(path: Path, options: FileOptions, wanted: Collection[str]) -> dict[str, FloatArray]:
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
        return ulog.read_topics(path)
    if content == "ubx":
        return ubx.read_ubx(path)
    if content == "dataflash":
        return dataflash.read_dataflash(path, wanted)
    return _read_text(path, content, options, wanted)


def _read_text(path: Path, content: str, options: FileOptions, wanted: Collection[str]) -> dict[str, FloatArray]:
    data = _text_bytes(path, content, options)
    where = f"{path}({options.member})" if options.member else str(path)
    if options.skip_end:
        lines = data.rstrip(b"\r\n").rsplit(b"\n", options.skip_end)
        data = lines[0] + b"\n" if len(lines) > options.skip_end else b""
    names, delimiter = _layout(where, data, options)
    table = TextTable(where, lambda: io.BytesIO(data), names, delimiter, options.skip_lines + options.header)
    present = [name for name in names if name in wanted]
    columns = table.read(present)
    if columns is None:
        raise table.culprit(present)[1]
    return columns | {name: np.empty(0) for name in names if name not in columns}


def _text_bytes(path: Path, content: str, options: FileOptions) -> bytes:
    """The text of a file, unfolded where it is compressed."""
    too_large = f"more than {UNFOLDED_LIMIT >> 20} MiB of text once unfolded"
    try:
        if content == "zip":
            with zipfile.ZipFile(path) as archive:
                if options.member not in archive.namelist():
                    found = f"no member `{options.member}`" if options.member else "a zip"
                    members = ", ".join(archive.namelist()[:20])
                    raise InputError(path, found, f"member = one of {members}")
                with archive.open(options.member) as file:
                    data = file.read(UNFOLDED_LIMIT + 1)
        elif content == "gzip":
            with gzip.open(path) as file:
                data = file.read(UNFOLDED_LIMIT + 1)
        else:
            return path.read_bytes()
    except (zipfile.BadZipFile, EOFError, OSError, zlib.error, NotImplementedError, RuntimeError) as error:
        raise InputError(path, f"{type(error).__name__}: {error}", "an undamaged compressed file") from None
    if len(data) > UNFOLDED_LIMIT:
        raise InputError(path, too_large, "less: unpack it and cut it")
    return data


def _layout(where: str, data: bytes, options: FileOptions) -> tuple[list[str], str]:
    """The names of the columns and the delimiter, from the options or from the first lines."""
    lines = data.split(b"\n", options.skip_lines + 2)[options.skip_lines : options.skip_lines + 2]
    if not lines or not lines[0].strip():
        raise InputError(where, "no text", "rows of numbers", f"line {options.skip_lines + 1}")
    try:
        first = lines[0].decode("utf-8-sig" if options.skip_lines == 0 else "utf-8").rstrip("\r")
    except UnicodeDecodeError as error:
        found = f"byte 0x{error.object[error.start]:02x}"
        raise InputError(where, found, "UTF-8 text", f"line {options.skip_lines + 1}") from None
    if not all(letter.isprintable() or letter == "\t" for letter in first):
        raise InputError(where, "binary data", "text", f"line {options.skip_lines + 1}")
    delimiter = DELIMITERS[options.delimiter] if options.delimiter else _delimiter(first)
    cells = next(csv.reader([first], delimiter=delimiter, skipinitialspace=True)) if delimiter else first.split()
    if options.header:
        names = [cell.strip() or str(k + 1) for k, cell in enumerate(cells)]
    else:
        names = list(options.columns) or [str(k + 1) for k in range(len(cells))]
        if not options.columns and not any(is_number(cell) for cell in cells):
            hint = "numbers; `header = true` for a line of names, or `skip_lines`"
            raise InputError(where, f"`{first[:60]}`", hint, f"line {options.skip_lines + 1}")
    doubled = next((name for k, name in enumerate(names) if name in names[:k]), None)
    if doubled is not None:
        raise InputError(where, f"column {doubled} twice", "every column once", f"line {options.skip_lines + 1}")
    return names, delimiter


def _delimiter(line: str) -> str:
    return next((delimiter for delimiter in (";", ",", "\t") if delimiter in line), "")
