"""Seals: whether a number is right can be asked of them, but they do not have it.

An answer, right within a tolerance, lies in the middle of a cell that is twice as wide. The seal keeps where the even
grid of such cells lies, and a slow hash of the cell's number; a number is right if its cell has that hash. So the
tolerance is kept exactly, and who wants the number has to try the cells one by one, some milliseconds each.
"""

from __future__ import annotations

import hashlib
from base64 import b64encode
from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray

#: Of scrypt, memory 128 r n bytes: tens of milliseconds a try of an answer, ten times that one of a secret.
_TRY, _SECRET, _BLOCK = 2**13, 2**16, 8
#: The shift is kept to this share of a cell.
_DIGITS = 4


@dataclass(frozen=True)
class Seal:
    """An answer sealed.

    Attributes
    ----------
    shift : of the cells, for each number, in widths of a cell, between -0.5 and 0.5
    mark : hash of the numbers of the cells
    """

    shift: tuple[float, ...]
    mark: str


def sealed(value: FloatArray, width: float, salt: str) -> Seal:
    """Seal an answer (n,) with cells of a width, in its units."""
    shift = np.round(value / width - np.round(value / width), _DIGITS)
    return Seal(tuple(shift.tolist()), _mark(value, shift, width, salt))


def opens(seal: Seal, value: FloatArray, width: float, salt: str) -> bool:
    """Whether each of an answer's numbers (n,) is within half a width of the sealed one."""
    return len(seal.shift) == len(value) and _mark(value, np.array(seal.shift), width, salt) == seal.mark


def stretched(secret: str, salt: str) -> bytes:
    """(32 bytes) from a secret: guessing it costs some tenths of a second each."""
    memory = 2**20 + 256 * _BLOCK * _SECRET
    return hashlib.scrypt(secret.encode(), salt=salt.encode(), n=_SECRET, r=_BLOCK, p=1, maxmem=memory, dklen=32)


def _mark(value: FloatArray, shift: FloatArray, width: float, salt: str) -> str:
    cells = " ".join(str(int(c)) for c in np.floor(value / width - shift + 0.5))
    memory = 2**20 + 256 * _BLOCK * _TRY
    hashed = hashlib.scrypt(cells.encode(), salt=salt.encode(), n=_TRY, r=_BLOCK, p=1, maxmem=memory, dklen=15)
    return b64encode(hashed).decode()
