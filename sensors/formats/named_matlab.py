"""Variables of a MATLAB file that say by their names what they hold, as columns: `t`, `acc` (n x 3), `gx`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.formats.column_names import meanings, words_of
from sinan.sensors.recording import ACCEL, GYRO

#: What the one number is called that counts the readings a second, its words without gaps.
_RATES = frozenset({"fs", "rate", "samplerate", "samplingrate", "samplingfrequency", "samplefrequency"})


def columns_of_flight(arrays: Mapping[str, FloatArray]) -> tuple[dict[str, FloatArray], tuple[str, ...]] | None:
    """The columns of an accelerometer, a gyroscope and what has as many readings, and notes; None: one of the two is
    not there.

    A variable of a structure is called by its own name; three rows or three columns are its axes. Where no variable is
    a time, a number that is called a rate makes one.
    """
    columns: dict[str, FloatArray] = {}
    for name, array in arrays.items():
        own = name.rsplit(".", 1)[-1]
        if array.ndim == 2 and 3 in array.shape and array.shape != (3, 3):
            rows = array if array.shape[0] == 3 else array.T
            found = {f"{own}_{axis}": row for axis, row in zip("xyz", rows, strict=True)}
        else:
            found = {own: np.ravel(array)} if array.ndim < 2 or 1 in array.shape else {}
        if columns.keys() & found.keys():
            return None  # two structures with fields of one name
        columns |= found
    known = meanings(list(columns))
    inertial = [name for name, what in known.items() if what.column in (*ACCEL, *GYRO)]
    count = len(columns[inertial[0]]) if inertial else 0
    if {known[name].column for name in inertial if len(columns[name]) == count} != {*ACCEL, *GYRO}:
        return None
    table = {name: np.ascontiguousarray(values) for name, values in columns.items() if len(values) == count}
    rates = [
        name for name, one in columns.items() if len(one) == 1 and "".join(words_of(name)) in _RATES and one[0] > 0
    ]
    if len(rates) != 1 or any(known[name].column == "t" for name in table if name in known):
        return table, ()
    rate = float(columns[rates[0]][0])
    return {**table, "t (s)": np.arange(count) / rate}, (
        f"time: readings are counted, {rate:.6g} a second by {rates[0]}",
    )
