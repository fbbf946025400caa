"""All ways to name and sign three axes, and how a map has them."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np

from sinan.sensors.arrays import FloatArray

#: (48, 3, 3) signed permutations: 24 turns, and as many mirror images.
SIGNED = np.stack([np.diag(s)[list(p)] for p in permutations(range(3)) for s in product((1.0, -1.0), repeat=3)])


def words_of(axes: FloatArray) -> str:
    """As a map has it: three names with their signs, or three rows."""
    rows = [[f"{value:.4g}" for value in row + 0.0] for row in axes]
    if np.any((axes != 0.0) & (np.abs(axes) != 1.0)):
        return "[" + ", ".join(f"[{', '.join(row)}]" for row in rows) + "]"
    names = [("-" if np.sum(row) < 0.0 else "") + "xyz"[int(np.argmax(np.abs(row)))] for row in axes]
    return "[" + ", ".join(f'"{name}"' for name in names) + "]"
