"""MATLAB files: numeric variables only, of version 5 (scipy) and 7.3 (HDF5), nothing in them is run.

A version-5 file is walked through first: every size in it must fit into what holds it, so that no header decides how
much memory is taken. Objects, functions, cells and structures are passed over.
"""

from __future__ import annotations

import struct
import warnings
import zlib
from pathlib import Path

import numpy as np
import numpy.typing as npt

from sensors.arrays import FloatArray
from sensors.errors import InputError

MAGIC_5 = b"MATLAB 5.0 MAT-file"
MAGIC_HDF5 = b"\x89HDF\r\n\x1a\n"
#: The most that compressed or sparsely stored data may unfold to [bytes].
UNFOLDED_LIMIT = 2**29

_COMPRESSED, _MATRIX = 15, 14
#: mxDOUBLE_CLASS to mxUINT64_CLASS: the array classes that hold plain numbers. MAT-File Format, MathWorks, table 1-3.
_NUMERIC = range(6, 16)
_COMPLEX_FLAG = 0x08


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
    InputError : neither MATLAB 5 nor 7.3, truncated, sizes that do not fit, more than 512 MiB unfolded, no numbers
    """
    if is_hdf5(path):
        arrays = _read_hdf5(path)
    else:
        arrays = _read_5(path)
    if not arrays:
        raise InputError(path, "no variable that holds numbers", "at least one numeric array")
    return {name: _flat(array) for name, array in arrays.items()}


def _flat(array: npt.NDArray[np.generic]) -> FloatArray:
    numbers = np.asarray(array, dtype=np.float64)
    return numbers.ravel() if numbers.ndim == 2 and 1 in numbers.shape else numbers


def _read_5(path: Path) -> dict[str, npt.NDArray[np.generic]]:
    import scipy.io

    data = path.read_bytes()
    if not data.startswith(MAGIC_5):
        raise InputError(path, f"it begins with {data[:8]!r}", "a MATLAB 5 or 7.3 file", "byte 0")
    if len(data) < 128 or data[126:128] not in (b"IM", b"MI"):
        raise InputError(path, "a header that is cut off or damaged", "128 bytes that end in IM or MI", "byte 126")
    names = _numeric_variables(path, data, "<" if data[126:128] == b"IM" else ">")
    if not names:
        return {}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a name given twice: the last one counts, as in MATLAB
            loaded = scipy.io.loadmat(
                path, variable_names=names, struct_as_record=True, verify_compressed_data_integrity=True
            )
    except Exception as error:  # scipy raises whatever its parser meets in a damaged file
        raise InputError(path, f"{type(error).__name__}: {error}", "a whole MATLAB 5 file") from None
    return {
        name: loaded[name]
        for name in names
        if isinstance(loaded.get(name), np.ndarray) and loaded[name].dtype.kind in "fiub"
    }


def _numeric_variables(path: Path, data: bytes, order: str) -> list[str]:
    """The names of the numeric variables; every size checked against what holds it."""
    names: list[str] = []
    position, unfolded = 128, 0
    while position < len(data):
        if position + 8 > len(data):
            raise InputError(
                path, f"{len(data) - position} bytes after the last element", "an element", f"byte {position}"
            )
        kind, size = struct.unpack_from(order + "II", data, position)
        end = position + 8 + size
        if end > len(data):
            found = f"an element of {size} bytes, {len(data) - position - 8} are left"
            raise InputError(path, found, "an element within the file", f"byte {position}")
        body = data[position + 8 : end]
        if kind == _COMPRESSED:
            body = _unfold(path, body, UNFOLDED_LIMIT - unfolded, position)
            unfolded += len(body)
            kind, size = struct.unpack_from(order + "II", body) if len(body) >= 8 else (0, 0)
            if size > len(body) - 8:
                found = f"a compressed element that says {size} bytes and holds {len(body) - 8}"
                raise InputError(path, found, "an element that fits", f"byte {position}")
            body = body[8 : 8 + size]
        if kind == _MATRIX:
            name = _matrix_name(path, body, order, position)
            if name:
                names.append(name)
        position = end
    return names


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


def _matrix_name(path: Path, body: bytes, order: str, position: int) -> str:
    """The name of a numeric array whose parts fit into its element; empty for any other class."""
    parts: list[tuple[int, bytes]] = []
    at = 0
    while at + 8 <= len(body) and len(parts) < 5:
        kind, size = struct.unpack_from(order + "II", body, at)
        if kind >> 16:  # small element: size and type share a word, the data the next
            kind, size, start, step = kind & 0xFFFF, kind >> 16, at + 4, 8
            if size > 4:
                raise InputError(path, f"a small element of {size} bytes", "at most 4", f"byte {position}")
        else:
            start, step = at + 8, 8 + -(-size // 8) * 8
        if len(parts) == 0 and (size != 8 or body[at + 8 + (0 if order == "<" else 3)] not in _NUMERIC):
            return ""
        if start + size > len(body):
            raise InputError(
                path, f"a part of {size} bytes in an array of {len(body)}", "a part that fits", f"byte {position}"
            )
        parts.append((kind, body[start : start + size]))
        at += step
    if len(parts) < 4 or len(parts[1][1]) % 4 or parts[0][1][1 if order == "<" else 2] & _COMPLEX_FLAG:
        return ""
    shape = np.frombuffer(parts[1][1], order + "i4").astype(np.float64)
    if len(shape) < 2 or np.any(shape < 0) or np.prod(shape) > len(parts[3][1]):
        found = f"an array of {' x '.join(f'{n:.0f}' for n in shape)} in {len(parts[3][1])} bytes"
        raise InputError(path, found, "numbers for all of it", f"byte {position}")
    return parts[2][1].decode("ascii", "replace")


def _read_hdf5(path: Path) -> dict[str, npt.NDArray[np.generic]]:
    import h5py

    arrays: dict[str, npt.NDArray[np.generic]] = {}
    unfolded = 0
    try:
        with h5py.File(path, "r") as file:
            for name in file:
                if not isinstance(file.get(name, getlink=True), h5py.HardLink):
                    continue  # a link to elsewhere is not followed
                dataset = file.get(name)
                if not isinstance(dataset, h5py.Dataset) or dataset.dtype.kind not in "fiub" or dataset.shape is None:
                    continue
                unfolded += dataset.size * dataset.dtype.itemsize
                if unfolded > UNFOLDED_LIMIT:
                    shape = " x ".join(str(n) for n in dataset.shape)
                    raise InputError(path, f"an array of {shape}", "less than 512 MiB", f"variable {name}")
                # HDF5 lists the dimensions in the opposite order of MATLAB.
                arrays[name] = np.asarray(dataset[()]).T
    except InputError:
        raise
    except Exception as error:  # h5py raises OSError, KeyError, RuntimeError and others on a damaged file
        raise InputError(path, f"{type(error).__name__}: {error}", "a whole MATLAB 7.3 (HDF5) file") from None
    return arrays


def columns_of(arrays: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Variables as columns: `name` for a vector, `name.1` to `name.k` for a matrix with one reading a row or a column.

    The longer side is the readings; a square matrix has one reading a column. The columns of an only matrix are also
    "1" to "k".
    """
    columns: dict[str, FloatArray] = {}
    for name, array in arrays.items():
        if array.ndim <= 1:
            columns[name] = np.atleast_1d(array)
        elif array.ndim == 2:
            rows = array if array.shape[1] >= array.shape[0] else array.T
            columns.update({f"{name}.{k + 1}": np.ascontiguousarray(row) for k, row in enumerate(rows)})
            if len(arrays) == 1:
                columns.update({f"{k + 1}": columns[f"{name}.{k + 1}"] for k in range(len(rows))})
    return columns
