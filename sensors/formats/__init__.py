"""Readers of log formats: each turns one format into a `Recording`. `open_log` finds the reader by the content."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import NoReturn

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.formats.facts import Facts
from sinan.sensors.recording import ACCEL, MAG, Recording, Stream

#: Variables of a MATLAB file that say by their name what they are: one reading a column (or row).
POSE_VARIABLES = {"AccRaw": ACCEL, "acc": ACCEL, "MagRaw": MAG, "mag": MAG}
SELF_DESCRIBING = (
    "a ULog, a folder of its tables (ulog2csv), an ArduPilot log (.bin, .log), a MAVLink log (.tlog), a ROS bag, a "
    "table whose header says what it holds (ax, gyro_x [deg/s])"
)
#: What reads the logs that describe themselves, by `what_is`: module, reader, and what tells the facts. A module is
#: imported when it is asked for.
_READERS = {
    "ulog": ("ulog", "read_ulog", "ulog_facts"),
    "tlog": ("tlog", "read_tlog", "tlog_facts"),
    "ubx": ("ubx", "read_receiver", "receiver_facts"),
    "euroc": ("dataset_folders", "read_euroc", "folder_facts"),
    "kitti": ("dataset_folders", "read_kitti", "folder_facts"),
    "topics": ("ulog", "read_ulog", "ulog_facts"),
    "tables": ("named_folder", "read_tables", "tables_facts"),
    **dict.fromkeys(("dataflash", "dataflash_binary"), ("ardupilot", "read_ardupilot", "ardupilot_facts")),
    **dict.fromkeys(("rosbag", "rosbag2", "sqlite", "mcap"), ("rosbag", "read_rosbag", "rosbag_facts")),
}


def open_log(path: Path, map_file: Path | None = None, choice: Choice = FIRST) -> Recording:
    """Read a log, whatever its format.

    Parameters
    ----------
    path : (1) a folder with `recording.toml`, or that file; (2) a log that describes itself (ULog, dataflash); (3) a
        MATLAB file with one variable `AccRaw`, `acc`, `MagRaw` or `mag`, 3 x n or n x 3; (4) any other, with its map
    map_file : the map that says how to read it
    choice : which of several sensors of a log that describes itself, and whether corrections are taken off

    Raises
    ------
    InputError : says what was found and what would do
    """
    path = Path(path)
    if map_file is not None:
        from sinan.sensors.formats.map_file import read_map
        from sinan.sensors.formats.mapped import read_mapped

        choice.require_none(path, "which a map reads")
        rules = read_map(Path(map_file))
        return _with_axes(read_mapped(path, rules), rules.axes_of("gyro"), rules.axes_of("mag"))
    return _with_axes(_described(path, choice))


def _with_axes(recording: Recording, gyro: FloatArray | None = None, mag: FloatArray | None = None) -> Recording:
    """The recording with what is to be noted of the axes of gyroscope and compass; what its map has for them now."""
    from sinan.sensors.formats.compass_axes import note_of_axes
    from sinan.sensors.formats.gyro_axes import with_axes_of_force

    whole, said = with_axes_of_force(recording, gyro)
    return recording.replace(notes=(*recording.notes, *said, *note_of_axes(whole, mag)))


def _described(path: Path, choice: Choice) -> Recording:
    """A log that needs no map."""
    from sinan.sensors.formats.plain import HEADER_FILE, read_recording

    if path.name == HEADER_FILE or (path / HEADER_FILE).is_file():
        choice.require_none(path, "a plain recording")
        return read_recording(path if path.is_dir() else path.parent)
    content = what_is(path)
    if choice.boot and content != "tlog":
        raise InputError(path, "a log of one start of its autopilot", "a telemetry log (.tlog)", "--boot")
    if (reader := _reader_of(content)) is not None:
        return reader(path, choice)
    choice.require_none(path, "which has no choice")
    if content == "folder":
        return _nothing_in(path)
    if content == "matlab":
        return _of_matlab(path)
    from sinan.sensors.formats.columns import notes_of, read_named, seen_in

    if content in ("text", "parquet") and (columns := read_named(path)) is not None:
        from sinan.sensors.formats.named_columns import recording_of_names

        recording = recording_of_names(path, columns)
        return recording.replace(notes=(*notes_of(columns), *recording.notes))
    found = {
        "empty": "an empty file", "mwlog": "an MWLOGV01 log, which does not say what its signals are",
        "zip": "a zip", "text": "text or unknown data",
        "parquet": "a Parquet file whose columns do not say what they are",
    }.get(content, f"compressed data ({content})")  # fmt: skip
    if content == "text" and (seen := seen_in(path)):
        named = "names that say what the columns are (ax, gyro_x [deg/s]) in the first line, or --map FILE.toml (docs/"
        named += "formats.md, `A map in ten lines`)"
        raise InputError(path, f"{found}: {seen}", named)
    raise InputError(path, found, f"a folder with recording.toml, {SELF_DESCRIBING}, a .mat with one variable "
                     f"{', '.join(POSE_VARIABLES)}, or any log with --map FILE.toml")  # fmt: skip


def _nothing_in(path: Path) -> NoReturn:
    """Raise for a folder that is no log, naming what is in it."""
    inside = sorted(one.name for one in path.iterdir() if not one.name.startswith("."))
    if not inside:
        raise InputError(path, "an empty folder", f"a folder with recording.toml, or {SELF_DESCRIBING}")
    shown = ", ".join(inside[:4]) + (f" and {len(inside) - 4} more" if len(inside) > 4 else "")
    found = f"no recording.toml, and no log of several files that is known ({shown})"
    raise InputError(path, found, "one log in it, or --map FILE.toml; `sinan batch` takes all that need no map")


def what_is(path: Path) -> str:
    """What a path holds, as `columns.content_of` says it of a file; of a folder: what log it is, or "folder".

    Raises
    ------
    InputError : it is not there
    """
    if path.is_dir():
        if (path / "metadata.yaml").is_file():
            return "rosbag2"
        from sinan.sensors.formats.dataset_folders import kind_of_folder

        if known := kind_of_folder(path):
            return known
        from sinan.sensors.formats.named_folder import holds_tables
        from sinan.sensors.formats.ulog_tables import holds_topics

        if holds_topics(path):
            return "topics"
        return "tables" if holds_tables(path) else "folder"
    if not path.is_file():
        raise InputError(path, "no such file or folder", "a log")
    from sinan.sensors.formats.columns import content_of

    content = content_of(path)
    if content == "text" and path.suffix == ".csv":
        from sinan.sensors.formats.ulog_tables import holds_topics

        return "topics" if holds_topics(path) else content
    return content


def describes_itself(path: Path) -> bool:
    """Whether a path is a log that is read without being told how: a recording, or one of `_READERS`."""
    from sinan.sensors.formats.plain import HEADER_FILE

    return (path / HEADER_FILE).is_file() or what_is(path) in _READERS


def facts_of(path: Path) -> Facts | None:
    """What a log that describes itself says besides its readings; None of any other."""
    known = _READERS.get(what_is(path))
    if known is None:
        return None
    module, _, facts = known
    return getattr(import_module(f"sinan.sensors.formats.{module}"), facts)(path)


def _reader_of(content: str) -> Callable[[Path, Choice], Recording] | None:
    """What reads a log that describes itself."""
    known = _READERS.get(content)
    if known is None:
        return None
    module, reader, _ = known
    return getattr(import_module(f"sinan.sensors.formats.{module}"), reader)


def _of_matlab(path: Path) -> Recording:
    """The variables that are an accelerometer and a gyroscope, by their names; else poses of the one variable whose
    name says what it is: readings as they are, row index as time.
    """
    import numpy as np

    from sinan.sensors.formats.matlab import read_matlab
    from sinan.sensors.formats.named_columns import recording_of_names
    from sinan.sensors.formats.named_matlab import columns_of_flight
    from sinan.sensors.formats.plausible import check_units

    arrays = read_matlab(path)
    if (flight := columns_of_flight(arrays)) is not None:
        recording = recording_of_names(path, flight[0])
        return recording.replace(notes=(*flight[1], *recording.notes))
    known = [name for name in arrays if name in POSE_VARIABLES]
    if len(known) != 1:
        names = ", ".join(arrays)
        found = f"variables {names if len(names) < 200 else names[:200] + ' ...'}"
        names = f"one of {', '.join(POSE_VARIABLES)}; t, acc and gyr, or other names that say it"
        raise InputError(path, found, f"{names}; or --map FILE.toml")
    name, array = known[0], arrays[known[0]]
    if array.ndim == 1 and len(array) == 3:
        array = array[:, None]
    if array.ndim != 2 or 3 not in array.shape:
        shape = " x ".join(str(n) for n in array.shape)
        raise InputError(path, f"an array of {shape or 'no size'}", "3 x n or n x 3", f"variable {name}")
    rows = array.T if array.shape[0] == 3 else array
    stream = Stream(
        np.arange(len(rows), dtype=np.float64),
        dict(zip(POSE_VARIABLES[name], np.ascontiguousarray(rows.T), strict=True)),
    )
    recording = Recording(path.stem, "poses", {"poses": stream}, source=str(path))
    check_units(recording)
    return recording
