"""ArduPilot's text dataflash log: `FMT` lines name the columns of every other kind of line."""

from __future__ import annotations

import io
from array import array
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.packed import require_columns, require_numbers
from sinan.sensors.formats.text_table import doubled_name, text_lines


def read_dataflash(path: Path, wanted: Collection[str]) -> dict[str, FloatArray]:
    """Columns by `TYPE.Field`, each as long as its kind has lines, and `TYPE.row` that counts them.

    Parameters
    ----------
    wanted : names of the columns to read; a field is a number only where it is asked for

    Raises
    ------
    InputError : no FMT lines, not UTF-8, a line with the wrong number of fields or before its FMT line, a field that
        is no number
    """
    fields: dict[str, list[str]] = {}
    kinds = {name.split(".")[0] for name in wanted if "." in name}
    values: dict[str, array[float]] = {name: array("d") for name in wanted}
    rows = dict.fromkeys(kinds, 0)
    number = numbers = 0
    try:
        with io.TextIOWrapper(text_lines(path.open("rb"), path), encoding="utf-8-sig") as file:
            for number, line in enumerate(file, 1):
                kind = line.partition(",")[0].strip()
                if kind != "FMT" and kind not in kinds:
                    continue
                cells = [cell.strip() for cell in line.split(",")[1:]]
                if kind == "FMT" and len(cells) >= 4:
                    fields[cells[2]] = cells[4:]
                    if (doubled := doubled_name(cells[4:])) is not None:
                        raise InputError(path, f"field {doubled} twice", "every field once", f"line {number}")
                if kind in kinds:
                    rows[kind] += 1
                    numbers += _add_row(path, values, kind, fields.get(kind), cells, number)
                    require_numbers(path, numbers, f"line {number}")
    except UnicodeDecodeError as error:
        found = f"byte 0x{error.object[error.start]:02x}"
        raise InputError(path, found, "UTF-8 text", f"after line {number}") from None
    if not fields:
        raise InputError(path, "no FMT line", "a text dataflash log")
    require_columns(path, sum(map(len, fields.values())), "FMT lines")
    columns = {f"{kind}.{field}": np.empty(0) for kind in fields for field in [*fields[kind], "row"]}
    for kind in kinds & set(fields):
        columns[f"{kind}.row"] = np.arange(rows[kind], dtype=np.float64)
    return columns | {name: np.array(values[name]) for name in wanted if name in columns and not name.endswith(".row")}


def _add_row(
    path: Path, values: Mapping[str, array[float]], kind: str, names: list[str] | None, cells: list[str], number: int
) -> int:
    """Take the wanted numbers of a line; how many they are."""
    place = f"line {number}"
    if names is None:
        raise InputError(path, f"{kind} before the FMT line that names its fields", "FMT lines first", place)
    if len(cells) != len(names):
        raise InputError(path, f"{len(cells)} fields in {kind}", f"{len(names)}", place)
    count = 0
    for field, cell in zip(names, cells, strict=True):
        column = values.get(f"{kind}.{field}")
        if column is None:
            continue
        try:
            column.append(float(cell))
        except ValueError:
            raise InputError(path, f"`{cell[:40]}` in {kind}.{field}", "a number", place) from None
        count += 1
    return count
