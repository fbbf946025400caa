"""The plain recording format: one folder, `recording.toml` and one CSV a stream; read to the last bit."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import cast

import numpy as np

from sensors.arrays import FloatArray
from sensors.errors import InputError
from sensors.formats.csv_table import read_csv, read_header_line
from sensors.formats.geodetic import to_ned
from sensors.formats.header import read_header
from sensors.formats.plausible import check_units
from sensors.formats.toml_table import load_toml
from sensors.recording import (
    ACCEL,
    GEODETIC,
    GYRO,
    MAG,
    POSITION,
    REQUIRED_COLUMNS,
    VELOCITY,
    Kind,
    Recording,
    Stream,
    check_rows,
    check_stream,
)

FORMAT = 1
HEADER_FILE = "recording.toml"
TRUTH_FILE = "truth.csv"
KINDS = ("flight", "poses")

#: The format's own columns of each stream: they must be numbers. Every other column is a covariate.
_OWN_COLUMNS: Mapping[str, tuple[str, ...]] = {
    "imu": (*ACCEL, *GYRO, "temperature"),
    "mag": MAG,
    "baro": ("height", "pressure", "temperature"),
    "sonar": ("range",),
    "laser": ("range",),
    "gps": (*POSITION, *GEODETIC, *VELOCITY),
    "base": (*POSITION, *GEODETIC, *VELOCITY),
    "power": ("current", "voltage"),
    "motors": (),
    "air": ("airspeed", "wind_north", "wind_east", "temperature"),
    "poses": (*ACCEL, *MAG, "temperature"),
}
#: Streams with numbered columns: motor_1, range_0, ...
_NUMBERED = {"motors": "motor_", "laser": "range_"}


def read_recording(folder: Path) -> Recording:
    """Read a plain recording, without its truth.

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
    version = table.get("format")
    if version != FORMAT or isinstance(version, bool):
        found = "no such key" if version is None else repr(version)
        raise table.error("format", found, f"format = {FORMAT}")
    name = table.text("name") or folder.resolve().name
    kind = table.text("kind", KINDS)
    if kind is None:
        raise table.error("kind", "no such key", '"flight" or "poses"')
    declared = read_header(table)
    table.done()
    streams, notes = _read_streams(folder)
    if not streams:
        files = ", ".join(f"{stream}.csv" for stream in REQUIRED_COLUMNS)
        raise InputError(folder, "no stream", f"at least one of {files}")
    if kind == "flight" and set(streams) == {"poses"}:
        raise table.error("kind", '"flight", with poses.csv alone', '"poses"')
    _check_base(folder, streams, declared.origin, declared.sensors.get("base"))
    streams, origin, chosen = to_ned(folder, streams, declared.origin)
    recording = Recording(
        name=name,
        kind=cast(Kind, kind),
        streams=streams,
        sensors=declared.sensors,
        environment=declared.environment,
        initial=declared.initial,
        origin=origin,
        effects=declared.effects,
        source=str(folder),
        notes=notes + chosen,
    )
    check_units(recording)
    return recording


def read_truth(folder: Path) -> Stream:
    """The truth of a recording, for scoring alone: nothing that estimates may call this.

    Returns
    -------
    `t` and the columns of `truth.csv`, SI units, NED

    Raises
    ------
    InputError : no truth, or a fault in it
    """
    path = Path(folder) / TRUTH_FILE
    if not path.is_file():
        raise InputError(path, "no such file", "a recording with truth")
    columns, _ = read_csv(path, _AllColumns())
    truth = _timed(path, columns)
    check_rows(path, truth)
    return truth


def require_free(folder: Path, force: bool = False) -> None:
    """Raise unless a recording may be written to a folder: it is not there, empty, or to be replaced.

    Parameters
    ----------
    force : a recording that `write_recording` wrote may be replaced; anything else never is

    Raises
    ------
    InputError : the folder is in use
    """
    from sensors.formats.plain_text import WRITTEN_BY

    folder = Path(folder)
    if folder.is_file():
        raise InputError(folder, "a file", "a folder to be made")
    if not folder.is_dir() or not any(folder.iterdir()):
        return
    header = folder / HEADER_FILE
    ours = header.is_file() and header.read_bytes().startswith(WRITTEN_BY.encode())
    if not ours:
        raise InputError(folder, "a folder with files that were not written by sinan", "a new or an empty folder")
    if not force:
        raise InputError(folder, "a recording that was written before", "another folder, or --force to replace it")


def write_recording(recording: Recording, folder: Path, truth: Stream | None = None) -> None:
    """Write a recording as a plain folder, so that reading it back gives the same bits.

    Parameters
    ----------
    recording : what to write; its `notes` and `source` are not written
    folder : made where it does not exist; its files are replaced
    truth : written as `truth.csv`

    Raises
    ------
    InputError : the folder cannot be written
    """
    from sensors.formats.plain_text import header_text

    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for stale in [*REQUIRED_COLUMNS, "truth"]:
            (folder / f"{stale}.csv").unlink(missing_ok=True)
        (folder / HEADER_FILE).write_text(header_text(recording), encoding="utf-8")
        for name, stream in recording.streams.items():
            _write_csv(folder / f"{name}.csv", stream)
        if truth is not None:
            _write_csv(folder / TRUTH_FILE, truth)
    except OSError as error:
        raise InputError(folder, error.strerror or type(error).__name__, "a folder that can be written") from None


#: Columns that effects use wherever they stand, so that a gap in one is not passed over.
COVARIATES = ("temperature", "pressure", "current", "voltage", "airspeed")


class _AllColumns(tuple[str, ...]):
    """Every name is in it."""

    def __contains__(self, name: object) -> bool:
        return True


def _read_streams(folder: Path) -> tuple[dict[str, Stream], tuple[str, ...]]:
    streams: dict[str, Stream] = {}
    notes: list[str] = []
    for path in sorted(folder.glob("*.csv")):
        name = path.stem
        if name == "truth":
            continue
        if name not in REQUIRED_COLUMNS:
            notes.append(f"{path.name} is not a stream of the format and was not read")
            continue
        own = ("t", *_OWN_COLUMNS[name], *COVARIATES, *_numbered(path, _NUMBERED.get(name)))
        columns, left_out = read_csv(path, own)
        if left_out:
            notes.append(f"{path.name}: not numbers throughout, left out: {', '.join(left_out)}")
        if name == "poses" and "t" not in columns:
            columns["t"] = np.arange(len(next(iter(columns.values()), ())), dtype=np.float64)
        streams[name] = _timed(path, columns)
        check_stream(path, name, streams[name])
    return streams, tuple(notes)


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
