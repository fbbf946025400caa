"""Bytes of a RINEX file: unpacking, lines, header, fixed-width numbers, calendar."""

from __future__ import annotations

import datetime
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.errors import InputError, with_extra
from sinan.sensors.formats.packed import Bounded, read_packed

ByteArray = npt.NDArray[np.uint8]

GPS_EPOCH = datetime.date(1980, 1, 6).toordinal()  # start of GPS week 0
DAY = 86400.0  # s
WEEK = 604800.0  # s
BDT_OFFSET = 14.0  # s, GPS time minus BeiDou time (BDS-SIS-ICD-B1I-3.0, 3.3)
#: First days (UTC) on which GPS time was ahead of UTC by one more second, from 1 s on (IERS Bulletin C).
LEAP_SECOND_DAYS = tuple(
    datetime.date(year, month, 1).toordinal()
    for year, month in (
        *((1981, 7), (1982, 7), (1983, 7), (1985, 7), (1988, 1), (1990, 1), (1991, 1), (1992, 7), (1993, 7), (1994, 7)),
        *((1996, 1), (1997, 7), (1999, 1), (2006, 1), (2009, 1), (2012, 7), (2015, 7), (2017, 1)),
    )
)
SYSTEMS = "GREJCIS"  # GPS, GLONASS, Galileo, QZSS, BeiDou, NavIC, SBAS (RINEX 4.00, table 1)
LABEL = slice(60, 80)  # columns of a header line's label
PADDING = 2048  # bytes behind the text: more than the longest line of a real file
COMPACT = b"CRINEX VERS   / TYPE"
MOST_LINES = 2**25  # ten hours of 40 satellites at 20 Hz


@dataclass(frozen=True)
class Text:
    """The unpacked file: bytes and where its lines are.

    Attributes
    ----------
    where : file, for messages
    data : (bytes,) followed by blanks, so that a gather beyond the end stays inside
    start, length : (lines,) of each line, without its end
    ended : whether the last line had a line end
    complaint : of the program that expanded it; empty: none
    """

    where: str
    data: ByteArray
    start: IntArray
    length: IntArray
    ended: bool
    complaint: str = ""

    def __len__(self) -> int:
        return len(self.start)

    def line(self, i: int) -> str:
        """Line i as text; bytes beyond ASCII become `?`."""
        a = int(self.start[i])
        return self.data[a : a + int(self.length[i])].tobytes().decode("ascii", "replace")

    def fields(self, lines: IntArray, first: IntArray, width: int) -> ByteArray:
        """(len(lines), len(first), width) the fields that start in the columns `first`, blank beyond the line's end.

        Parameters
        ----------
        lines : (n,) line numbers
        first : (f,) or (n, f) columns, below 2000
        """
        start = self.start[lines][:, None] + first
        field = np.lib.stride_tricks.sliding_window_view(self.data, width)[np.minimum(start, len(self.data) - width)]
        left = self.length[lines][:, None] - first
        if (left >= width).all():
            return np.asarray(field)
        return np.where(np.arange(width) < left[..., None], field, np.uint8(32))


def names_in(text: Text, lines: IntArray) -> npt.NDArray[np.str_]:
    """(len(lines),) the first three columns, satellite names in most lines: blanks as 0, what does not print as ?."""
    field = text.fields(lines, np.array([0]), 3)[:, 0]
    field = np.where(field == 32, np.uint8(48), np.where((field < 33) | (field > 126), np.uint8(63), field))
    return np.ascontiguousarray(field).view("S3")[:, 0].astype("<U3")


def unpack(path: Path | str) -> Text:
    """Read a file, plain or packed; compact RINEX through the library `hatanaka`.

    Raises
    ------
    InputError : cannot be opened, packed in a damaged way, unfolds to more than is read, or a library is needed and not
        installed
    """
    where = Path(path)
    raw = read_packed(where)
    if raw[LABEL] == COMPACT:
        raw, complaint = expand(where, raw)
        return lines_of(str(path), raw, complaint)
    return lines_of(str(path), raw)


def expand(where: Path, raw: bytes) -> tuple[bytes, str]:
    """The plain text of compact RINEX, never more than is read, and what its program complains of.

    The program of `hatanaka` is run here and not by the library, which takes what it writes however much that is.
    """
    try:
        import hatanaka.bin as programs
    except ImportError:
        found = "compact RINEX"
        raise InputError(where, found, f"plain RINEX, or {with_extra('gnss')}") from None
    program = Path(next(iter(programs.__path__))) / f"crx2rnx{'.exe' if sys.platform == 'win32' else ''}"
    text = Bounded(where)
    with tempfile.TemporaryFile() as source, tempfile.TemporaryFile() as complaints:
        source.write(raw)
        source.seek(0)
        with subprocess.Popen([program, "-"], stdin=source, stdout=subprocess.PIPE, stderr=complaints) as process:
            assert process.stdout is not None
            try:
                while part := process.stdout.read(2**16):
                    text.write(part)
            except InputError:
                process.kill()
                raise
        complaints.seek(0)
        complaint = " ".join(complaints.read(500).decode("ascii", "replace").split())
    if process.returncode not in (0, 2):  # 2: done, with warnings
        found = f"compact RINEX that cannot be expanded ({complaint or f'status {process.returncode}'})"
        raise InputError(where, found, "a complete file")
    return text.getvalue(), complaint


def lines_of(where: str, raw: bytes, complaint: str = "") -> Text:
    """Find the lines of a text with line ends LF or CR LF.

    Raises
    ------
    InputError : more lines than are read
    """
    count = raw.count(b"\n")
    if count > MOST_LINES:
        raise InputError(where, f"{count} lines", f"at most {MOST_LINES}: cut the file")
    ended = raw.endswith(b"\n") or not raw
    data = np.frombuffer(raw + (b"" if ended else b"\n") + b" " * PADDING, dtype=np.uint8)
    end = np.flatnonzero(data == 10)
    start = np.concatenate([[0], end[:-1] + 1]) if len(end) else np.zeros(0, dtype=np.int64)
    length = end - start
    carriage = (length > 0) & (data[np.maximum(end - 1, 0)] == 13)
    return Text(where, data, start.astype(np.int64), (length - carriage).astype(np.int64), ended, complaint)


@dataclass(frozen=True)
class Header:
    """What the header says.

    Attributes
    ----------
    version : RINEX version
    kind : "O" observations, "N" GPS or mixed navigation, "G" GLONASS and "H" SBAS navigation of RINEX 2
    system : letter of the satellite system, "M" mixed
    lines : (label, text of the 60 columns before it) in order
    size : number of lines, the end line included
    """

    version: float
    kind: str
    system: str
    lines: tuple[tuple[str, str], ...]
    size: int

    def get(self, label: str) -> list[str]:
        """Contents of all lines with this label."""
        return [text for name, text in self.lines if name == label]


def read_header(text: Text) -> Header:
    """Read the header.

    Raises
    ------
    InputError : no RINEX file, a version that is not known, or no END OF HEADER
    """
    first = text.line(0) if len(text) else ""
    expected = "RINEX 2.10 to 4: a first line that ends in `RINEX VERSION / TYPE`"
    if first[LABEL].strip() != "RINEX VERSION / TYPE":
        raise InputError(text.where, f"`{printable(first[:80])}`" if first else "an empty file", expected, "line 1")
    version = number(first[:9])
    if version is None or not 2.0 <= version < 5.0:
        raise InputError(text.where, f"version `{printable(first[:9]).strip()}`", "RINEX 2.10 to 4", "line 1")
    lines: list[tuple[str, str]] = []
    for i in range(1, len(text)):
        line = text.line(i)
        label = line[LABEL].strip()
        if label == "END OF HEADER":
            return Header(version, first[20:21].upper(), first[40:41].upper() or "G", tuple(lines), i + 1)
        lines.append((label, line[:60]))
    raise InputError(text.where, f"no END OF HEADER in {len(text)} lines", "a complete header", f"line {len(text)}")


def printable(text: str) -> str:
    """The text with everything that does not print as `?`."""
    return "".join(c if " " <= c <= "~" else "?" for c in text)


def number(text: str) -> float | None:
    """A Fortran number; None where there is none."""
    try:
        value = float(text.replace("D", "E").replace("d", "e"))
    except ValueError:
        return None
    return value if np.isfinite(value) else None


def gps_seconds(year: int, month: int, day: int, hour: int, minute: int) -> float | None:
    """Seconds from the start of GPS week 0 to a full minute (no leap seconds); None: no such instant, or before that.

    Hour 24 and minute 60 are accepted, as some writers round up to them.
    """
    if not (1 <= year <= 9998 and 0 <= hour <= 24 and 0 <= minute <= 60):
        return None
    try:
        days = datetime.date(year, month, day).toordinal() - GPS_EPOCH
    except ValueError:
        return None
    return days * DAY + hour * 3600.0 + minute * 60.0 if days >= 0 else None


def century(year: int) -> int:
    """The year of two digits: 80 to 99 are 1980 to 1999, 00 to 79 are 2000 to 2079 (RINEX 2.11, A1)."""
    return year + (1900 if 80 <= year <= 99 else 2000 if year < 80 else 0)


def leap_seconds(gps_time: float) -> float:
    """GPS time minus UTC [s] at a GPS time [s]."""
    day = GPS_EPOCH + gps_time / DAY
    return float(sum(day >= first for first in LEAP_SECOND_DAYS))


def calendar(gps_time: float) -> str:
    """A GPS time [s] as text."""
    days, seconds = divmod(round(gps_time, 3), DAY)
    minute, second = divmod(seconds, 60.0)
    day = datetime.date.fromordinal(GPS_EPOCH + int(days))
    return f"{day.isoformat()} {int(minute // 60):02d}:{int(minute % 60):02d}:{second:06.3f}"


#: Weights of the ten digits before the point and the three after it, in thousandths.
_PLACES = 10.0 ** np.array([12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0])


def fixed_point(field: ByteArray) -> tuple[FloatArray, BoolArray]:
    """Numbers in the Fortran format F14.3, exactly as `float` reads them.

    Parameters
    ----------
    field : (..., 14) characters

    Returns
    -------
    value : (...) NaN where the field is blank or damaged
    damaged : (...) fields that hold something else than a number with its point in column 11
    """
    digit = field - np.uint8(48)
    is_digit = digit < 10
    whole, is_blank, is_minus = field[..., :10], field[..., :10] == 32, field[..., :10] == 45
    blank = (field == 32).all(axis=-1)
    valid = (field[..., 10] == 46) & is_digit[..., 11:].all(axis=-1)
    valid &= (is_digit[..., :10] | is_blank | is_minus).all(axis=-1)
    valid &= ~(is_blank[..., 1:] & ~is_blank[..., :-1]).any(axis=-1)
    valid &= ~(is_minus[..., 1:] & ~is_blank[..., :-1]).any(axis=-1)
    digits = np.where(is_digit, digit, np.uint8(0))
    digits = np.concatenate([digits[..., :10], digits[..., 11:]], axis=-1)
    value = (digits.astype(np.float64) @ _PLACES) / 1000.0
    value = np.where((whole == 45).any(axis=-1), -value, value)
    return np.where(valid, value, np.nan), ~valid & ~blank
