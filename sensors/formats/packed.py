"""Bytes of a file, plain or packed: never more than a bound, whatever a few compressed bytes may unfold to."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import struct
import zipfile
import zlib
from pathlib import Path
from typing import BinaryIO

from sinan.sensors.errors import InputError, with_extra

#: The most that a file may hold, unfolded where it is packed [bytes]: 10 h at 200 Hz are about 500 MB of text.
LARGEST = 2**30
#: The most numbers that a file may give: as many bytes of doubles.
MOST_NUMBERS = LARGEST // 8
#: The most columns of a table: a laser scan has one a beam, 1440 at 0.25 deg.
MOST_COLUMNS = 4096
#: The longest line of text [bytes]: every column with a number of 256 characters.
LONGEST_LINE = 2**20

_KINDS = {
    b"\x1f\x8b": "gzip", b"BZh": "bzip2", b"\xfd7zXZ\0": "xz", b"PK\x03\x04": "zip", b"\x1f\x9d": "compress",
}  # fmt: skip
_STEP = 2**16
#: Of a zip: bytes of a member's header, and flags of one that is encrypted, or whose LZMA data say where they end.
_LOCAL_HEADER, _ENCRYPTED, _END_MARKED = 30, 0x1, 0x2
_DAMAGED = (
    zipfile.BadZipFile, lzma.LZMAError, zlib.error, EOFError, OSError, NotImplementedError, RuntimeError, ValueError,
    struct.error, OverflowError,
)  # fmt: skip


def kind_of(head: bytes) -> str:
    """How a file is packed, by its first six bytes: gzip, bzip2, xz, zip, compress; or "" where it is not."""
    return next((kind for magic, kind in _KINDS.items() if head.startswith(magic)), "")


def size_shown(size: int) -> str:
    """A bound as messages say it."""
    return f"{size >> 20} MiB" if size >= 2**20 else f"{size} bytes"


def read_plain(path: Path, largest: int | None = None) -> bytes:
    """The bytes of a file as they are.

    Parameters
    ----------
    largest : the most that is read [bytes]; `LARGEST` if None

    Raises
    ------
    InputError : cannot be read; larger than that
    """
    limit = LARGEST if largest is None else largest
    try:
        with path.open("rb") as file:
            require_size(path, file.seek(0, io.SEEK_END), limit)
            file.seek(0)
            return file.read()
    except OSError as error:
        raise InputError(path, error.strerror or type(error).__name__, "a readable file") from None


def require_size(where: Path | str, size: int, largest: int | None = None) -> None:
    """Raise an `InputError` for a file of more bytes than are read."""
    limit = LARGEST if largest is None else largest
    if size > limit:
        raise InputError(where, f"more than {size_shown(limit)}", f"at most {size_shown(limit)}: cut it")


def require_numbers(where: Path | str, count: int, place: str = "") -> None:
    """Raise an `InputError` for more numbers than are read."""
    if count > MOST_NUMBERS:
        found = f"{count} numbers" if count < 10**15 else "numbers without end"
        raise InputError(where, found, f"at most {MOST_NUMBERS}: cut the log", place)


def require_columns(where: Path | str, count: int, place: str = "") -> None:
    """Raise an `InputError` for a table of more columns than are read."""
    if count > MOST_COLUMNS:
        raise InputError(where, f"{count} columns", f"at most {MOST_COLUMNS}", place)


def read_packed(path: Path, member: str | None = None) -> bytes:
    """The bytes of a file, unfolded where it is packed.

    Parameters
    ----------
    member : of a zip; None: the only one

    Raises
    ------
    InputError : cannot be read or unfolded, no such member, more than `LARGEST` bytes
    """
    raw = read_plain(path)
    return unfold(path, raw, member) if kind_of(raw[:6]) else raw


def unfold(where: Path, raw: bytes, member: str | None = None) -> bytes:
    """What packed bytes unfold to; see `read_packed`."""
    kind = kind_of(raw[:6])
    try:
        if kind == "compress":
            return _uncompress(where, raw)
        with _opened(where, kind, io.BytesIO(raw), member) as stream:
            return _bounded(where, stream)
    except InputError:
        raise
    except _DAMAGED as error:
        found = f"damaged {kind} data ({type(error).__name__}: {error})"
        raise InputError(where, found, "an undamaged compressed file") from None


def _opened(where: Path, kind: str, file: io.BytesIO, member: str | None) -> BinaryIO:
    if kind == "gzip":
        return gzip.GzipFile(fileobj=file)  # type: ignore[return-value]
    if kind == "bzip2":
        return bz2.BZ2File(file)  # type: ignore[return-value]
    if kind == "xz":
        return lzma.LZMAFile(file)  # type: ignore[return-value]
    archive = zipfile.ZipFile(file)
    names = archive.namelist()
    if member is None and len(names) == 1:
        member = names[0]
    if member not in names:
        found = f"no member `{member}`" if member else f"a zip of {len(names)} members"
        raise InputError(where, found, f"member = one of {', '.join(names[:20])}" if names else "a member in it")
    entry = archive.getinfo(member)
    if entry.compress_type in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA) and not entry.flag_bits & _ENCRYPTED:
        return _member(where, file.getvalue(), entry)  # the library's own reader unfolds all that it is given
    return archive.open(member)  # type: ignore[return-value]


def _member(where: Path, raw: bytes, entry: zipfile.ZipInfo) -> BinaryIO:
    """A member of a zip that is packed by bzip2 or LZMA. PKWARE's APPNOTE 6.3.10, 4.3.7 and 5.8.8.

    The local header ends with the lengths of a name and an extra field, which follow. LZMA data begin with a version,
    the length of the properties and these; with an unknown size behind them they are a file of xz's forerunner.
    """
    at = entry.header_offset + _LOCAL_HEADER
    name, extra = struct.unpack_from("<HH", raw, at - 4)
    start = at + name + extra
    body = raw[start : start + entry.compress_size]
    if entry.compress_type == zipfile.ZIP_LZMA:
        size = int.from_bytes(body[2:4], "little")
        length = 2**64 - 1 if entry.flag_bits & _END_MARKED else entry.file_size
        body = body[4 : 4 + size] + length.to_bytes(8, "little") + body[4 + size :]
    packed = io.BytesIO(body)
    with bz2.open(packed) if entry.compress_type == zipfile.ZIP_BZIP2 else lzma.open(packed) as stream:
        unfolded = _bounded(where, stream)  # type: ignore[arg-type]
    if zlib.crc32(unfolded) != entry.CRC:
        raise zipfile.BadZipFile("bad checksum")
    return io.BytesIO(unfolded)


def _bounded(where: Path, stream: BinaryIO) -> bytes:
    """All of a stream."""
    unfolded = Bounded(where)
    while part := stream.read(_STEP):
        unfolded.write(part)
    return unfolded.getvalue()


def _uncompress(where: Path, raw: bytes) -> bytes:
    try:
        from ncompress import decompress
    except ImportError:
        raise InputError(where, "a file packed by compress (.Z)", f"gzip, or {with_extra('gnss')}") from None
    unfolded = Bounded(where)
    decompress(raw, unfolded)
    return unfolded.getvalue()


class Bounded(io.BytesIO):
    """Bytes that are collected up to the bound.

    Parameters
    ----------
    where : of the file, for the message
    """

    def __init__(self, where: Path) -> None:
        super().__init__()
        self.where = where

    def write(self, part: bytes) -> int:  # type: ignore[override]
        if self.tell() + len(part) > LARGEST:
            found = f"more than {size_shown(LARGEST)} once unfolded"
            raise InputError(self.where, found, f"at most {size_shown(LARGEST)}: unpack it and cut it")
        return super().write(part)
