"""The array type that the packages exchange, and the check that names what is wrong with one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]


def as_floats(name: str, value: object, shape: Sequence[int | None], hint: str = "") -> FloatArray:
    """Return `value` as a float64 array of the given shape.

    Parameters
    ----------
    name : what the value is called in the message
    value : anything numpy can turn into an array
    shape : expected lengths; None leaves a length free
    hint : what to pass instead, for the message

    Raises
    ------
    ValueError : wrong shape, or not finite; names the argument, what arrived, what was expected
    """
    array = np.asarray(value, dtype=np.float64)
    expected = "(" + ", ".join("n" if k is None else str(k) for k in shape) + ")"
    advice = f": {hint}" if hint else ""
    if array.ndim != len(shape) or any(k is not None and k != m for k, m in zip(shape, array.shape, strict=True)):
        raise ValueError(f"`{name}` has shape {array.shape}; expected {expected}{advice}")
    if not np.all(np.isfinite(array)):
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise ValueError(f"`{name}` is not finite at index {index}; expected numbers{advice}")
    return array


def edges_of_runs(mask: npt.ArrayLike) -> IntArray:
    """(k, 2) rows [start, stop) of each run of true values; `mask` (n,)."""
    changes = np.diff(np.concatenate([[0], np.asarray(mask, dtype=np.int8), [0]]))
    return np.flatnonzero(changes).reshape(-1, 2)


def runs_of(mask: npt.ArrayLike) -> list[tuple[int, int]]:
    """Rows [start, stop) of each run of true values; `mask` (n,)."""
    return [(start, stop) for start, stop in edges_of_runs(mask).tolist()]


def zero_unless_finite(values: FloatArray) -> FloatArray:
    """The values, zero where they are not finite: a beam above the horizon has no prediction, nor does it change."""
    return np.where(np.isfinite(values), values, 0.0)


def integral(t: FloatArray, values: FloatArray) -> FloatArray:
    """(n, ...) integral of values (n, ...) from the first instant t to each, by trapezia."""
    total = np.zeros(values.shape)
    h = np.diff(t).reshape(-1, *(1,) * (values.ndim - 1))
    total[1:] = np.cumsum(0.5 * h * (values[1:] + values[:-1]), axis=0)
    return total


def finite_or_none(value: float) -> float | None:
    """The number, None where it is not finite: JSON has no such number."""
    return float(value) if np.isfinite(value) else None
