"""The plain recording format: one folder, `recording.toml` and one CSV a stream; read to the last bit."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.files import can_be_replaced, cannot_replace, new_folder
from sinan.sensors.formats.csv_table import read_csv, read_header_line
from sinan.sensors.formats.geodetic import to_ned
from sinan.sensors.formats.header import Header, read_header
from sinan.sensors.formats.plausible import check_units
from sinan.sensors.formats.toml_table import Table, load_toml
from sinan.sensors.recording import (
    ACCEL,
    GEODETIC,
    GYRO,
    KNOWN_BY,
    MAG,
    POSITION,
    REQUIRED_COLUMNS,
    TRUTH_KINDS,
    Kind,
    Recording,
    Stream,
    Truth,
    check_rows,
    check_stream,
)
from sinan.sensors.registry import BySensor

FORMAT = 1
HEADER_FILE = "recording.toml"
TRUTH_FILE = "truth.csv"
POINTS_FILE = "points.csv"
KINDS = ("flight", "poses")
#: Of a place that a camera sees.
POINT_COLUMNS = ("point", *POSITION)

#: The format's own columns of each stream: they must be numbers. Every other column is a covariate.
_OWN_COLUMNS: Mapping[str, tuple[str, ...]] = BySensor(
    lambda entry: entry.all_columns,
    before={"imu": (*ACCEL, *GYRO, "temperature")},
    after={
        "power": ("current", "voltage"),
        "motors": (),
        "air": ("airspeed", "wind_north", "wind_east", "temperature"),
        "poses": (*ACCEL, *MAG, "temperature"),
    },
)
#: Streams with numbered columns: motor_1, range_0, ...
_NUMBERED: Mapping[str, str] = BySensor(lambda entry: entry.numbered, after={"motors": "motor_"})


def files() -> tuple[str, ...]:
    """The files of a recording, by the names of their streams."""
    return (*REQUIRED_COLUMNS, "truth")


def read_recording(folder: Path) -> Recording:
    """Read a plain recording.

    Parameters
    ----------
    folder : the folder that holds `recording.toml`

    Returns
    -------
    The recording in SI units, positions in NED at its origin; geodetic positions without `[origin]` are taken at the
    first fix, and `notes` says so. `poses.csv` without `t` has its row index as time.

    Raises
    ------
    InputError : names file, row or key, what was found and what was expected
    """
    folder = Path(folder)
    header = folder / HEADER_FILE
    if not header.is_file():
        raise InputError(folder, "no recording.toml" if folder.is_dir() else "no such folder", f"a {HEADER_FILE} in it")
    table = load_toml(header)
    said = read_declared(table)
    declared, rows, kind, goes_on = said.header, said.rows, said.kind, said.unfinished
    truth = _truth(folder, table, said)
    _check_there(folder, rows)
    streams, notes = _read_streams(folder, goes_on)
    if not streams:
        files = ", ".join(f"{stream}.csv" for stream in REQUIRED_COLUMNS)
        raise InputError(folder, "no stream", f"at least one of {files}")
    _check_whole(folder, rows, streams if truth is None else {**streams, "truth": truth.stream})
    if kind == "flight" and set(streams) == {"poses"}:
        raise table.error("kind", '"flight", with poses.csv alone', '"poses"')
    _check_base(folder, streams, declared.origin, declared.sensors.get("base"))
    streams, origin, chosen = to_ned(folder, streams, declared.origin)
    recording = Recording(
        name=said.name or folder.resolve().name,
        kind=kind,
        streams=streams,
        sensors=declared.sensors,
        environment=declared.environment,
        initial=declared.initial,
        origin=origin,
        effects=declared.effects,
        source=str(folder),
        notes=notes + chosen + _without_truth(folder, rows),
        truth=truth,
        points=_points(folder),
    )
    check_units(recording)
    return recording


@dataclass(frozen=True)
class Declared:
    """What `recording.toml` says: the header; rows by file; of `[truth]` kind, what is known, and whether aligned."""

    name: str
    kind: Kind
    unfinished: bool
    header: Header
    rows: Mapping[str, int]
    truth: tuple[str, tuple[str, ...] | None, bool]


def read_declared(table: Table) -> Declared:
    """What the tables of `recording.toml` say.

    Raises
    ------
    InputError : names the key, what was found, what was expected
    """
    version = table.get("format", const=FORMAT)
    if version != FORMAT or isinstance(version, bool):
        found = "no such key" if version is None else repr(version)
        raise table.error("format", found, f"format = {FORMAT}")
    kind = table.text("kind", KINDS)
    if kind is None:
        raise table.error("kind", "no such key", '"flight" or "poses"')
    of = table.table("truth")
    truth_kind = of.text("kind", TRUTH_KINDS) or ("other" if "truth" in table else "")
    truth = truth_kind, of.names_of("known", tuple(KNOWN_BY)), of.flag("aligned") or False
    of.done()
    name, unfinished = table.text("name") or "", table.flag("unfinished") or False
    declared = Declared(name, cast(Kind, kind), unfinished, read_header(table), _rows(table), truth)
    table.done()
    return declared


def _truth(folder: Path, table: Table, said: Declared) -> Truth | None:
    """`truth.csv`, with what `[truth]` says of it; None where it is not there.

    Raises
    ------
    InputError : something known that the columns do not hold; a fault in the file
    """
    kind, known, aligned = said.truth
    goes_on = said.unfinished
    path = folder / TRUTH_FILE
    if not path.is_file() or (goes_on and not _has_rows(path)):
        return None
    columns, _ = read_csv(path, _AllColumns(), cut_off=goes_on)
    stream = _timed(path, columns)
    check_rows(path, stream)
    truth = Truth.of(stream, kind, known, aligned)
    for name in known or ():
        if name not in truth.known:
            needed = " or ".join(", ".join(alternative) for alternative in KNOWN_BY[name])
            raise table.table("truth").error(
                "known", f'"{name}", of which {TRUTH_FILE} has no columns', f"columns {needed}"
            )
    return truth


def _points(folder: Path) -> FloatArray | None:
    """(k, 4) the places of `points.csv` that a camera sees: number, north, east, down [m]; None where it is not there.

    Raises
    ------
    InputError : a fault in the file
    """
    path = folder / POINTS_FILE
    if not path.is_file():
        return None
    columns, _ = read_csv(path, POINT_COLUMNS)
    lacking = [name for name in POINT_COLUMNS if name not in columns]
    if lacking:
        raise InputError(path, f"columns {', '.join(columns)}", f"also {', '.join(lacking)}", "line 1")
    return np.stack([columns[name] for name in POINT_COLUMNS], axis=-1)


def require_free(folder: Path, force: bool = False) -> None:
    """Raise unless a recording may be written to a folder: it is not there, empty, or to be replaced.

    Parameters
    ----------
    force : a recording that `write_recording` wrote may be replaced; anything else never is

    Raises
    ------
    InputError : the folder is in use
    """
    folder = Path(folder)
    if folder.is_file():
        raise InputError(folder, "a file", "a folder to be made")
    if not folder.is_dir():
        parent = folder.resolve().parent
        if parent.is_dir() and not os.access(parent, os.W_OK):
            raise InputError(folder, "in a folder without permission to write", "a folder that can be written")
        return
    if not any(folder.iterdir()):
        return
    header = folder / HEADER_FILE
    if header.is_symlink():
        raise InputError(header, "a link", "a recording that sinan wrote, a new or an empty folder")
    if not _is_ours(header):
        raise InputError(folder, "a folder with files that were not written by sinan", "a new or an empty folder")
    if not force:
        raise InputError(folder, "a recording that was written before", "another folder, or --force to replace it")
    if not can_be_replaced(folder):
        raise cannot_replace(folder)


def write_recording(recording: Recording, folder: Path) -> None:
    """Write a recording as a plain folder, so that reading it back gives the same bits: whole, or not at all.

    Parameters
    ----------
    recording : what to write; its `notes` and `source` are not written
    folder : made where it does not exist; a recording in it is replaced, other files stay

    Raises
    ------
    InputError : the folder cannot be written
    """
    from sinan.sensors.formats.plain_text import header_text

    streams = dict(recording.streams)
    if recording.truth is not None:
        streams["truth"] = recording.truth.stream
    with new_folder(Path(folder), [*(f"{name}.csv" for name in files()), POINTS_FILE, HEADER_FILE]) as beside:
        for name, stream in streams.items():
            _write_csv(beside / f"{name}.csv", stream)
        if recording.points is not None:
            import pandas as pd

            places = pd.DataFrame(recording.points, columns=list(POINT_COLUMNS))
            places.to_csv(beside / POINTS_FILE, index=False, lineterminator="\n")
        rows = {name: len(stream) for name, stream in streams.items()}
        (beside / HEADER_FILE).write_text(header_text(recording, rows), encoding="utf-8")


#: Columns that effects use wherever they stand, so that a gap in one is not passed over.
COVARIATES = ("temperature", "pressure", "current", "voltage", "airspeed")


_UNFINISHED = "a part: what wrote it was cut off, or goes on; rows that are not whole are left out"


class _AllColumns(tuple[str, ...]):
    """Every name is in it."""

    def __contains__(self, name: object) -> bool:
        return True


def _read_streams(folder: Path, goes_on: bool) -> tuple[dict[str, Stream], tuple[str, ...]]:
    streams: dict[str, Stream] = {}
    notes = [_UNFINISHED] if goes_on else []
    for path in sorted(folder.glob("*.csv")):
        name = path.stem
        if path.name in (TRUTH_FILE, POINTS_FILE):
            continue
        if name not in REQUIRED_COLUMNS:
            notes.append(f"{path.name} is not a stream of the format and was not read")
            continue
        if goes_on and not _has_rows(path):
            continue
        own = ("t", *_OWN_COLUMNS[name], *COVARIATES, *_numbered(path, _NUMBERED.get(name)))
        columns, left_out = read_csv(path, own, cut_off=goes_on)
        if left_out:
            notes.append(f"{path.name}: not numbers throughout, left out: {', '.join(left_out)}")
        if name == "poses" and "t" not in columns:
            columns["t"] = np.arange(len(next(iter(columns.values()), ())), dtype=np.float64)
        streams[name] = _timed(path, columns)
        check_stream(path, name, streams[name])
    return streams, tuple(notes)


def _has_rows(path: Path) -> bool:
    """Whether there is a whole line behind the header."""
    with path.open("rb") as file:
        return sum(file.readline().endswith(b"\n") for _ in range(2)) == 2


def _rows(table: Table) -> dict[str, int]:
    """How many rows each file has, by the name of its stream, as `[rows]` says; nothing of those it does not name."""
    rows = table.table("rows")
    counts = {name: rows.whole(name, at_least=1) for name in files() if name in rows}
    rows.done()
    return {name: count for name, count in counts.items() if count is not None}


def _check_there(folder: Path, rows: Mapping[str, int]) -> None:
    """Raise where a stream that `[rows]` counts has no file: what is there is a part."""
    missing = [f"no {name}.csv with its {count} rows" for name, count in rows.items()
               if name != "truth" and not (folder / f"{name}.csv").is_file()]  # fmt: skip
    if missing:
        raise _a_part(folder, missing)


def _check_whole(folder: Path, rows: Mapping[str, int], streams: Mapping[str, Stream]) -> None:
    """Raise where a file has another number of rows than `[rows]` says, or, written here, ends within its last one."""
    ours, wrong = _is_ours(folder / HEADER_FILE), []
    for name in (name for name in rows if name in streams):
        if len(streams[name]) != rows[name]:
            wrong.append(f"{name}.csv with {len(streams[name])} of {rows[name]} rows")
        elif ours and not _ends_whole(folder / f"{name}.csv"):
            wrong.append(f"{name}.csv whose last row has no end")
    if wrong:
        raise _a_part(folder, wrong)


def _a_part(folder: Path, what: list[str]) -> InputError:
    expected = f"what [rows] of {HEADER_FILE} counts; where rows were changed on purpose, delete their lines there"
    return InputError(folder, f"a part of a recording: {', '.join(what)}", expected)


def _is_ours(header: Path) -> bool:
    """Whether `write_recording` wrote a recording."""
    from sinan.sensors.formats.plain_text import WRITTEN_BY

    return header.is_file() and header.read_bytes().startswith(WRITTEN_BY.encode())


def _ends_whole(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read() in (b"\n", b"\r")


def _without_truth(folder: Path, rows: Mapping[str, int]) -> tuple[str, ...]:
    """A note where the truth that `[rows]` counts is not there: nothing is scored."""
    if "truth" not in rows or (folder / TRUTH_FILE).is_file():
        return ()
    return (f"no {TRUTH_FILE}, of which {HEADER_FILE} counts {rows['truth']} rows: nothing can be scored",)


def _numbered(path: Path, prefix: str | None) -> tuple[str, ...]:
    if prefix is None:
        return ()
    return tuple(name for name in read_header_line(path) if name.startswith(prefix))


def _timed(path: Path, columns: dict[str, FloatArray]) -> Stream:
    """A stream with its `t` taken out of the columns."""
    if "t" not in columns:
        raise InputError(path, f"columns {', '.join(columns)}", "a column t [s]", "line 1")
    return Stream(columns["t"], {name: values for name, values in columns.items() if name != "t"})


def _check_base(folder: Path, streams: Mapping[str, Stream], origin: object, base: object) -> None:
    """`base_position` is NED where there is no origin; with geodetic streams that frame would be anywhere."""
    geodetic = any(name in streams and streams[name].has(GEODETIC) for name in ("gps", "base"))
    if origin is None and geodetic and getattr(base, "base_position", None) is not None:
        raise InputError(
            folder / HEADER_FILE,
            "base_position and geodetic positions without an origin",
            "an [origin] with latitude, longitude, height, so that base_position means degrees",
            "[sensors.base] base_position",
        )


def _write_csv(path: Path, stream: Stream) -> None:
    import pandas as pd

    frame = pd.DataFrame({"t": stream.t, **stream.columns})
    frame.to_csv(path, index=False, lineterminator="\n")
