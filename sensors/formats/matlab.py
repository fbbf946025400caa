"""MATLAB files: numeric variables only, of version 5 and 7.3 (HDF5); nothing in them is run.

Version 5 is read here and not by scipy, whose reader ends the process on some damaged files: every size must fit into
what holds it, so that no header decides how much memory is taken. The numeric fields of a structure are variables of
their own, called `structure.field`; objects, functions, cells and arrays of structures are passed over. Source:
MAT-File Format, MathWorks, chapter 1.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.packed import MOST_COLUMNS, read_plain, require_numbers

MAGIC_5 = b"MATLAB 5.0 MAT-file"
MAGIC_HDF5 = b"\x89HDF\r\n\x1a\n"
#: The most that compressed or sparsely stored data may unfold to [bytes].
UNFOLDED_LIMIT = 2**29
#: The most variables of a file.
MOST_VARIABLES = 10_000

_COMPRESSED, _MATRIX = 15, 14
#: mxSTRUCT_CLASS. MAT-File Format, table 1-3.
_STRUCTURE = 2
#: Structures within structures are followed so far.
_DEPTH = 8
#: mxDOUBLE_CLASS to mxUINT64_CLASS: the array classes that hold plain numbers. MAT-File Format, MathWorks, table 1-3.
_NUMERIC = range(6, 16)
_COMPLEX_FLAG = 0x08
#: miINT8 to miUINT64: how numbers are stored, whatever their class. MAT-File Format, table 1-1.
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}


def is_hdf5(path: Path) -> bool:
    """Whether the HDF5 signature is where MATLAB 7.3 (byte 512) or any other HDF5 writer (byte 0) puts it."""
    with path.open("rb") as file:
        start = file.read(8)
        file.seek(512)
        return MAGIC_HDF5 in (start, file.read(8))


def read_matlab(path: Path) -> dict[str, FloatArray]:
    """The numeric variables of a file by name, scalars, vectors (n,) and matrices as they are.

    Raises
    ------
    InputError : neither MATLAB 5 nor 7.3, truncated, sizes that do not fit, more than 512 MiB unfolded, no numbers; in
        HDF5, a variable that lies in other files
    """
    arrays = _read_hdf5(path) if is_hdf5(path) else _read_5(path)
    if not arrays:
        raise InputError(path, "no variable that holds numbers", "at least one numeric array")
    return {name: _flat(array) for name, array in arrays.items()}


def _flat(array: FloatArray) -> FloatArray:
    return array.ravel() if array.ndim == 2 and 1 in array.shape else array


def _read_5(path: Path) -> dict[str, FloatArray]:
    """The numeric arrays of a version-5 file. A name given twice: the last one counts, as in MATLAB."""
    data = read_plain(path)
    if not data.startswith(MAGIC_5):
        raise InputError(path, f"it begins with {data[:8]!r}", "a MATLAB 5 or 7.3 file", "byte 0")
    if len(data) < 128 or data[126:128] not in (b"IM", b"MI"):
        raise InputError(path, "a header that is cut off or damaged", "128 bytes that end in IM or MI", "byte 126")
    order = "<" if data[126:128] == b"IM" else ">"
    arrays: dict[str, FloatArray] = {}
    position, unfolded = 128, 0
    while position < len(data):
        kind, body, end = _element(path, data, position, order)
        if kind == _COMPRESSED:
            inside = _unfold(path, body, UNFOLDED_LIMIT - unfolded, position)
            unfolded += len(inside)
            kind, body, _ = _element(path, inside, 0, order, position)
        if kind == _MATRIX:
            arrays.update(_matrix(path, body, order, position))
            _require_bounds(path, arrays, f"byte {position}")
        position = end
    return arrays


def _require_bounds(path: Path, arrays: Mapping[str, FloatArray], place: str) -> None:
    """Raise an `InputError` for more variables, or more numbers in them, than are read."""
    if len(arrays) > MOST_VARIABLES:
        raise InputError(path, f"more than {MOST_VARIABLES} variables", f"at most {MOST_VARIABLES}", place)
    require_numbers(path, sum(array.size for array in arrays.values()), place)


def _element(path: Path, data: bytes, at: int, order: str, position: int | None = None) -> tuple[int, bytes, int]:
    """Type and content of the element at a byte, and the byte after it (before padding)."""
    place = f"byte {at if position is None else position}"
    if at + 8 > len(data):
        raise InputError(path, f"{len(data) - at} bytes where an element begins", "at least 8", place)
    kind, size = struct.unpack_from(order + "II", data, at)
    start = at + 8
    if kind >> 16:  # small element: size and type share a word, the data are the next
        kind, size, start = kind & 0xFFFF, kind >> 16, at + 4
    if start + size > len(data) or (start == at + 4 and size > 4):
        found = f"an element of {size} bytes, {len(data) - start} are left"
        raise InputError(path, found, "an element within what holds it", place)
    return kind, data[start : start + size], start + size


def _unfold(path: Path, body: bytes, limit: int, position: int) -> bytes:
    unfolder = zlib.decompressobj()
    try:
        unfolded = unfolder.decompress(body, max(limit, 1))
    except zlib.error as error:
        raise InputError(path, str(error), "an element that can be decompressed", f"byte {position}") from None
    if unfolder.unconsumed_tail:
        raise InputError(path, "more than 512 MiB in compressed elements", "less", f"byte {position}")
    if not unfolder.eof:
        raise InputError(path, "a compressed element that is cut off", "a whole one", f"byte {position}")
    return unfolded


def _matrix(
    path: Path, body: bytes, order: str, position: int, called: str = "", depth: int = 0
) -> dict[str, FloatArray]:
    """A numeric array, or those of a structure, by name; nothing for any other class.

    Parts: flags, dimensions, name, numbers. A field of a structure has no name of its own: it is `called` something.
    """
    if not body:
        return {}  # an empty element stands for an empty array without a name
    parts = _parts(path, body, order, position)
    _, flags = next(parts)
    kind = _array_class(flags, order) if len(flags) >= 4 else -1
    if (kind not in _NUMERIC and kind != _STRUCTURE) or _is_complex(flags, order):
        return {}
    (_, dimensions), (_, own_name) = next(parts), next(parts)
    shape = [int(n) for n in np.frombuffer(dimensions[: len(dimensions) // 4 * 4], order + "i4")]
    name = called or own_name.decode("ascii", "replace")
    if not name:
        return {}  # what MATLAB keeps for its objects
    if kind == _STRUCTURE:
        one = len(shape) >= 2 and set(shape) == {1} and depth < _DEPTH
        return _fields(path, parts, order, position, name, depth) if one else {}
    stored, numbers = next(parts)
    dtype = np.dtype(order + _TYPES.get(stored, "V1"))
    count = math.prod(shape) if len(shape) >= 2 and min(shape) >= 0 else -1
    if stored not in _TYPES or count * dtype.itemsize != len(numbers):
        found = f"an array of {' x '.join(str(n) for n in shape)} in {len(numbers)} bytes of type {stored}"
        raise InputError(path, found, "numbers for all of it", f"byte {position}")
    require_numbers(path, count, f"byte {position}")
    return {name: np.frombuffer(numbers, dtype).astype(np.float64).reshape(shape, order="F")}


def _parts(path: Path, body: bytes, order: str, position: int) -> Iterator[tuple[int, bytes]]:
    """Type and content of each element within an array, one after the other; too early an end is an error."""
    at = 0
    while True:
        kind, part, end = _element(path, body, at, order, position)
        yield kind, part
        at += -(-(end - at) // 8) * 8


def _fields(
    path: Path, parts: Iterator[tuple[int, bytes]], order: str, position: int, name: str, depth: int
) -> dict[str, FloatArray]:
    """The numeric fields of one structure. Parts: length of a field's name, the names, an array for each."""
    (_, length), (_, names) = next(parts), next(parts)
    width = int.from_bytes(length[:4], "little" if order == "<" else "big")
    if not 0 < width <= max(len(names), 1) or len(names) % width:
        found = f"names of fields in {len(names)} bytes, {width} each"
        raise InputError(path, found, "whole names", f"byte {position}")
    arrays: dict[str, FloatArray] = {}
    for k in range(0, len(names), width):
        field = names[k : k + width].split(b"\0")[0].decode("ascii", "replace")
        kind, body = next(parts)
        if kind == _MATRIX:
            arrays.update(_matrix(path, body, order, position, f"{name}.{field}", depth + 1))
    return arrays


def _array_class(flags: bytes, order: str) -> int:
    return flags[0 if order == "<" else 3]


def _is_complex(flags: bytes, order: str) -> bool:
    return bool(flags[1 if order == "<" else 2] & _COMPLEX_FLAG)


def _read_hdf5(path: Path) -> dict[str, FloatArray]:
    import h5py

    arrays: dict[str, FloatArray] = {}
    unfolded = 0
    try:
        with h5py.File(path, "r") as file:
            for name in file:
                if not isinstance(file.get(name, getlink=True), h5py.HardLink):
                    continue  # a link to elsewhere is not followed
                dataset = file.get(name)
                if not isinstance(dataset, h5py.Dataset) or dataset.dtype.kind not in "fiub" or dataset.shape is None:
                    continue
                place = f"variable {name}"
                if dataset.is_virtual or dataset.external:
                    raise InputError(path, "numbers that lie in other files", "a file that holds its own", place)
                unfolded += dataset.size * max(dataset.dtype.itemsize, 8)
                if unfolded > UNFOLDED_LIMIT:
                    shape = " x ".join(str(n) for n in dataset.shape)
                    raise InputError(path, f"an array of {shape}", "less than 512 MiB as doubles, all together", place)
                # HDF5 lists the dimensions in the opposite order of MATLAB.
                arrays[name] = np.asarray(dataset[()], dtype=np.float64).T
                _require_bounds(path, arrays, place)
    except InputError:
        raise
    except Exception as error:  # h5py raises OSError, KeyError, RuntimeError and others on a damaged file
        raise InputError(path, f"{type(error).__name__}: {error}", "a whole MATLAB 7.3 (HDF5) file") from None
    return arrays


def columns_of(arrays: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Variables as columns: `name` for a vector, `name.1` to `name.k` for a matrix with one reading a row or a column.

    The longer side is the readings; a square matrix has one reading a column. The columns of an only matrix are also
    "1" to "k". A matrix of more than `MOST_COLUMNS` columns is no table of readings and is passed over.
    """
    columns: dict[str, FloatArray] = {}
    for name, array in arrays.items():
        if array.ndim <= 1:
            columns[name] = np.atleast_1d(array)
        elif array.ndim == 2 and min(array.shape) <= MOST_COLUMNS:
            rows = array if array.shape[1] >= array.shape[0] else array.T
            columns.update({f"{name}.{k + 1}": np.ascontiguousarray(row) for k, row in enumerate(rows)})
            if len(arrays) == 1:
                columns.update({f"{k + 1}": columns[f"{name}.{k + 1}"] for k in range(len(rows))})
    return columns
