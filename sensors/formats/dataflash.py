"""ArduPilot's text dataflash log: `FMT` lines name the columns of every other kind of line."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np

from sensors.arrays import FloatArray
from sensors.errors import InputError

MAGIC = "FMT, 128,"


def read_dataflash(path: Path, wanted: Collection[str]) -> dict[str, FloatArray]:
    """Columns by `TYPE.Field`, each as long as its kind has lines, and `TYPE.row` that counts them.

    Parameters
    ----------
    wanted : names of the columns to read; a field is a number only where it is asked for

    Raises
    ------
    InputError : no FMT lines, not UTF-8, a line with the wrong number of fields, a field that is no number
    """
    fields: dict[str, list[str]] = {}
    kinds = {name.split(".")[0] for name in wanted}
    rows: dict[str, list[tuple[int, list[str]]]] = {}
    try:
        with path.open(encoding="utf-8-sig") as file:
            for number, line in enumerate(file, 1):
                kind, *cells = [cell.strip() for cell in line.split(",")]
                if kind == "FMT" and len(cells) >= 4:
                    fields[cells[2]] = cells[4:]
                elif kind in kinds:
                    rows.setdefault(kind, []).append((number, cells))
    except UnicodeDecodeError as error:
        raise InputError(path, f"byte 0x{error.object[error.start]:02x}", "UTF-8 text", f"byte {error.start}") from None
    if not fields:
        raise InputError(path, "no FMT line", "a text dataflash log")
    columns = {f"{kind}.{field}": np.empty(0) for kind in fields for field in [*fields[kind], "row"]}
    for kind in kinds & set(rows):
        columns[f"{kind}.row"] = np.arange(len(rows[kind]), dtype=np.float64)
        for k, field in enumerate(fields.get(kind, [])):
            if f"{kind}.{field}" in wanted:
                columns[f"{kind}.{field}"] = _column(path, rows[kind], kind, field, k, len(fields[kind]))
    return columns


def _column(path: Path, rows: list[tuple[int, list[str]]], kind: str, field: str, k: int, count: int) -> FloatArray:
    values = np.empty(len(rows))
    for row, (number, cells) in enumerate(rows):
        if len(cells) != count:
            raise InputError(path, f"{len(cells)} fields in {kind}", f"{count}", f"line {number}")
        try:
            values[row] = float(cells[k])
        except ValueError:
            raise InputError(path, f"`{cells[k][:40]}` in {kind}.{field}", "a number", f"line {number}") from None
    return values
