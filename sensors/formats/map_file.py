"""Reads a map: the TOML file that says how a log is to be read, and nothing else. `docs/formats.md` is its manual."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import cast

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.formats.columns import DELIMITERS, FileOptions
from sinan.sensors.formats.header import read_header
from sinan.sensors.formats.map_rules import (
    DROPS,
    QUANTITIES,
    REFERENCE_QUANTITIES,
    Clock,
    Keep,
    Map,
    Quantity,
    StreamMap,
)
from sinan.sensors.formats.records import TYPES, RecordLayout
from sinan.sensors.formats.toml_table import Table, load_toml
from sinan.sensors.formats.units import COUNT, UNITS
from sinan.sensors.recording import TRUTH_KINDS, Kind

#: The most lines to pass over at either end of a text: an hour of them at 200 Hz, and more.
_MOST_SKIPPED = 10**6
#: What a column is called by: its name or its number.
COLUMN = ("string", "integer")


def read_map(path: Path) -> Map:
    """Read a map.

    Raises
    ------
    InputError : names the key, what was found, what was expected
    """
    return map_of(path, load_toml(path))


def map_of(path: Path, table: Table) -> Map:
    """The map that a table says; see `read_map`."""
    kind = table.text("kind", ("flight", "poses"))
    if kind is None:
        raise table.error("kind", "no such key", '"flight" or "poses"')
    name, note = table.text("name") or "", table.text("note")
    header = read_header(table)
    if header.effects:
        raise table.error("effects", "effects", "a map that says how to read, and declares none")
    files = _files(table)
    streams_table = table.table("streams")
    streams = tuple(
        _stream(streams_table.table(stream), stream, QUANTITIES.get(stream, QUANTITIES["gps"]), files)
        for stream in [*QUANTITIES, "base"]
        if stream in streams_table
    )
    streams_table.done()
    reference, kind_of_reference, aligned = None, "", False
    if "reference" in table:
        said = table.table("reference")
        kind_of_reference, aligned = said.text("kind", TRUTH_KINDS) or "other", said.flag("aligned") or False
        reference = _stream(said, "reference", REFERENCE_QUANTITIES, files)
    table.done()
    if not streams:
        raise table.error("streams", "no stream", "at least one of " + ", ".join(f"[streams.{s}]" for s in QUANTITIES))
    notes = (note,) if note else ()
    return Map(path, cast(Kind, kind), name, header, files, streams, reference, kind_of_reference, aligned, notes)


def _files(table: Table) -> dict[str, FileOptions]:
    files = {"": _file(table.table("file"))}
    several = table.table("files")
    for name in several.names():
        files[name] = _file(several.table(name))
    several.done()
    return files


def _file(table: Table) -> FileOptions:
    columns = _names(table, "columns") if "columns" in table else ()
    options = FileOptions(
        path=table.text("path") or "",
        member=table.text("member") or "",
        columns=columns,
        delimiter=table.text("delimiter", tuple(DELIMITERS)) or "",
        skip_lines=table.whole("skip_lines", at_most=_MOST_SKIPPED) or 0,
        skip_end=table.whole("skip_end", at_most=_MOST_SKIPPED) or 0,
        header=table.flag("header") or False,
        records=_records(table.table("records")) if "records" in table else None,
    )
    table.done()
    if options.header and columns:
        raise table.error("columns", "columns beside header = true", "one of the two")
    return options


def _records(table: Table) -> RecordLayout:
    fields, tail = _fields(table, "fields"), _fields(table, "tail")
    tail_if = table.text("tail_if") or ""
    layout = RecordLayout(fields, table.whole("magic"), tail, tail_if, table.flag("big_endian") or False)
    table.done()
    if not fields:
        raise table.error("fields", "no such key", 'a list of [name, type], as [["x", "int16"], ...]')
    if bool(tail) != bool(tail_if) or (tail_if and tail_if not in {name for name, _ in fields}):
        raise table.error("tail_if", repr(tail_if), "the field that says whether `tail` follows")
    return layout


def _fields(table: Table, key: str) -> tuple[tuple[str, str], ...]:
    pair = {"type": "array", "prefixItems": [{"type": "string"}, {"enum": [*TYPES]}], "minItems": 2, "maxItems": 2}
    value = table.get(key, "array", items=pair)
    if value is None:
        return ()
    expected = f"a list of [name, type], types {', '.join(TYPES)}, every name once"
    if not isinstance(value, list):
        raise table.wrong(key, expected)
    pairs = [tuple(entry) if isinstance(entry, list) else () for entry in value]
    good = all(len(pair) == 2 and isinstance(pair[0], str) and pair[1] in list(TYPES) for pair in pairs)
    if not good or "" in {pair[0] for pair in pairs} or len({pair[0] for pair in pairs}) < len(pairs):
        raise table.wrong(key, expected)
    return tuple((str(name), str(kind)) for name, kind in pairs)


def _stream(
    table: Table, name: str, quantities: Mapping[str, tuple[tuple[str, ...], str]], files: Mapping[str, FileOptions]
) -> StreamMap:
    file = _file_name(table, files)
    stream = StreamMap(
        name=name,
        file=file,
        clock=_clock(table, name),
        quantities={
            key: _quantity(table, key, outputs, dimension, files)
            for key, (outputs, dimension) in quantities.items()
            if key in table
        }
        | _covariates(table.table("covariates"), files),
        keep=tuple(_keep(entry) for entry in table.tables("keep")),
        drop=table.names_of("drop", DROPS) or (),
        skip_rows=table.whole("skip_rows") or 0,
        align=table.text("align", ("rows", "interpolate")) or "rows",
    )
    table.done()
    if not stream.quantities:
        raise table.error("quantities", "none", f"at least one of {', '.join(quantities)}")
    return stream


def _covariates(table: Table, files: Mapping[str, FileOptions]) -> dict[str, Quantity]:
    found = {name: _quantity(table, name, (name,), "number", files) for name in table.names()}
    table.done()
    return found


def _file_name(table: Table, files: Mapping[str, FileOptions]) -> str:
    name = table.text("file")
    if name is not None and name not in files:
        raise table.wrong("file", "a name of [files]: " + (", ".join(filter(None, files)) or "there is none"))
    return name or ""


def _clock(table: Table, name: str) -> Clock:
    value = table.get("time", *COLUMN)
    if isinstance(value, str | int) and not isinstance(value, bool):
        return Clock(column=str(value))
    if value is None:
        if name == "poses":
            return Clock(rate=1.0)
        raise table.error(
            "time", "no such key", 'the column of the time, as "t" or {column = "t", unit = "ms"}, or {rate = 100}'
        )
    clock = table.table("time")
    column, minus = (_names(clock, key, 1)[0] if key in clock else "" for key in ("column", "minus"))
    rate = clock.number("rate", above=0.0)
    unit = clock.text("unit", tuple(UNITS["time"])) or "s"
    zero, wrap, even = clock.number("zero") or 0.0, clock.number("wrap", above=0.0), clock.flag("even") or False
    result = Clock(column, minus, rate, unit, zero, wrap, even)
    clock.done()
    if not column and (rate is None or minus):
        raise table.wrong("time", "a column, or a rate [Hz] at which rows are counted")
    if rate is not None and "unit" in clock.data:
        raise table.wrong("time", "a unit, or a rate [Hz], not both")
    return result


def _quantity(
    table: Table, key: str, outputs: tuple[str, ...], dimension: str, files: Mapping[str, FileOptions]
) -> Quantity:
    if not isinstance(table.get(key, *COLUMN, "array", items={"type": [*COLUMN]}), dict):
        columns = _names(table, key, len(outputs) or None)
        return Quantity(outputs or _numbered(key, columns), columns)
    entry = table.table(key)
    if "polar" in entry:
        result = Quantity(outputs, _names(entry, "polar", 3), polar=True)
        entry.done()
        return result
    columns = _names(entry, "columns", len(outputs) or None)
    unit = entry.text("unit", (*UNITS[dimension], COUNT)) or ""
    factor, shift = UNITS[dimension].get(unit, (1.0, 0.0))
    undo, counts = entry.table("undo"), entry.table("counts")
    result = Quantity(
        outputs=outputs or _numbered(key, columns),
        columns=columns,
        minus=_names(entry, "minus", len(columns)) if "minus" in entry else (),
        file=_file_name(entry, files),
        factor=factor,
        shift=shift,
        unit=unit,
        undo_offset=_each(undo, "offset", len(columns), 0.0),
        undo_scale=_each(undo, "scale", len(columns), 1.0),
        zero=_each(counts, "zero", len(columns), 0.0),
        per_unit=_each(counts, "per_unit", len(columns), 1.0),
        axes=_axes(entry) if len(outputs) == 3 or key == "quaternion" else None,
        enu=entry.flag("enu") or False if key in ("quaternion", "position", "velocity") else False,
        inverse=entry.flag("inverse") or False if key == "quaternion" else False,
    )
    for part in (undo, counts, entry):
        part.done()
    return result


def _numbered(key: str, columns: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"{key}_{k + 1}" for k in range(len(columns)))


def _names(table: Table, key: str, size: int | None = None) -> tuple[str, ...]:
    """The names or numbers of columns; a single name stands for a variable with that many columns."""
    value = table.get(key, *COLUMN, "array", items={"type": [*COLUMN]})
    entries = value if isinstance(value, list) else [value]
    expected = "names or numbers of columns" if size is None else f"{size} names or numbers of columns"
    if not entries or any(isinstance(entry, bool) or not isinstance(entry, str | int) for entry in entries):
        raise table.wrong(key, expected)
    names = tuple(str(entry) for entry in entries)
    if size is not None and len(names) == 1 and size > 1 and isinstance(value, str):
        return tuple(f"{names[0]}.{k + 1}" for k in range(size))
    if size is not None and len(names) != size:
        raise table.wrong(key, expected)
    return names


def _each(table: Table, key: str, size: int, default: float) -> FloatArray:
    """One number, or one a column; what divides must not be zero."""
    several = isinstance(table.get(key, "number", "array", items={"type": "number"}), list)
    value = table.vector(key, size) if several else table.number(key)
    result = np.atleast_1d(np.asarray(default if value is None else value, dtype=np.float64))
    if key in ("scale", "per_unit") and np.any(result == 0.0):
        raise table.wrong(key, "numbers that are not zero")
    return result


def _axes(table: Table) -> FloatArray | None:
    """(3, 3) body = axes @ reading, from rows of numbers or from names as ["y", "x", "-z"]."""
    value = table.get("axes", "array", items={"type": ["string", "array"]}, minItems=3, maxItems=3)
    if value is None:
        return None
    expected = (
        'three of x, y, z with a sign, as ["y", "x", "-z"], or three rows of three numbers, that can be turned back'
    )
    if not isinstance(value, list) or len(value) != 3:
        raise table.wrong("axes", expected)
    rows = [_axis(entry) if isinstance(entry, str) else entry for entry in value]
    try:
        axes = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError):
        raise table.wrong("axes", expected) from None
    if axes.shape != (3, 3) or not np.all(np.isfinite(axes)) or abs(np.linalg.det(axes)) < 1e-6:
        raise table.wrong("axes", expected)
    return axes


def _axis(text: str) -> list[float]:
    letter, sign = text.removeprefix("-").removeprefix("+"), -1.0 if text.startswith("-") else 1.0
    return [sign * (letter == name) for name in "xyz"]


def _keep(table: Table) -> Keep:
    if "column" not in table:
        raise table.error("column", "no such key", "the column that decides")
    above, below = table.number("above"), table.number("below")
    keep = Keep(
        column=_names(table, "column", 1)[0],
        above=-np.inf if above is None else above,
        below=np.inf if below is None else below,
        equals=table.number("equals"),
    )
    table.done()
    return keep
