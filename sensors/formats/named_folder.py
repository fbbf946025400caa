"""A folder of tables, one a sensor, whose file names say what they hold: what phones write, and loggers of their kind.

`Accelerometer.csv` with the columns `x`, `y`, `z` is read as `accelerometer x`, by the grammar of `named_columns`.
A phone's axes are x to the right of its screen, y to its top, z out of it (Android's sensor coordinates, which Apple's
are, too); its body here looks along the top of the screen, which faces up: forward y, right x, down -z. Apple's
accelerations have the opposite sign, which the program that wrote them tells or has taken off.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.formats.column_names import FREE, GRAVITY, meanings
from sinan.sensors.formats.columns import FileOptions, names_of, read_columns
from sinan.sensors.formats.facts import Facts, Table
from sinan.sensors.formats.logged import recording_of, turned
from sinan.sensors.formats.named_columns import converted, in_pascal, of_step
from sinan.sensors.formats.plausible import sign_of_force
from sinan.sensors.recording import ACCEL, GEODETIC, GYRO, MAG, Recording, Stream

#: Words of a file's name, and the sensor that its columns are then of; the first that fits.
_SENSORS: Sequence[tuple[frozenset[str], str]] = tuple((frozenset(words.split()), sensor) for words, sensor in (
    ("linear accelerometer", "linear acceleration"), ("linear acceleration", "linear acceleration"),
    ("gravity", "gravity"), ("total acceleration", "accelerometer"), ("accelerometer", "acceleration"),
    ("acceleration", "acceleration"), ("acc", "acceleration"), ("gyroscope", "gyro"), ("gyro", "gyro"),
    ("magnetometer", "mag"), ("magn", "mag"), ("mag", "mag"), ("barometer", "baro"), ("pressure", "baro"),
    ("location", "gps"), ("gps", "gps"),
))  # fmt: skip
#: Words of files that are of another device, or of a sensor read in another way.
_OTHERS = frozenset({"uncalibrated", "watch", "wrist", "headphone", "network", "annotation"})
#: Forward-right-down of a phone's axes.
FRD_OF_PHONE = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
#: What a phone says of a fix, and how it is called here.
_OF_FIX = {"horizontalaccuracy": "eph", "verticalaccuracy": "epv"}
_LARGEST_TEXT = 2**20


def holds_tables(path: Path) -> bool:
    """Whether a folder has a table of accelerations and one of rates."""
    there = set(_files(path))
    return "gyro" in there and bool(there & {"accelerometer", "acceleration", "linear acceleration"})


def _files(path: Path) -> dict[str, Path]:
    """The table of each sensor in a folder, by name."""
    found: dict[str, Path] = {}
    for file in sorted(path.glob("*.csv")):
        words = {word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", file.stem)}
        sensor = next((sensor for asked, sensor in _SENSORS if asked <= words), "")
        if sensor and not words & _OTHERS:
            found.setdefault(sensor, file)
    return found


def _of_apple(path: Path) -> bool:
    """Whether accelerations have Apple's sign, as `Metadata.csv` of Sensor Logger says."""
    if not (path / "Metadata.csv").is_file():
        return False
    with (path / "Metadata.csv").open(encoding="utf-8-sig", errors="replace", newline="") as file:
        said = next(csv.DictReader(file.read(_LARGEST_TEXT).splitlines()), {})
    return str(said.get("platform")).lower() == "ios" and str(said.get("standardisation")).lower() != "true"


def tables_facts(path: Path) -> Facts:
    """What a folder is, and how many rows its tables have."""
    tables = []
    for sensor, file in _files(path).items():
        t, _ = _table(file, sensor)
        tables.append(Table(file.name, len(t), (float(t[0]), float(t[-1])) if len(t) else (0.0, 0.0)))
    return Facts("folder of tables, one a sensor", "", {}, tuple(tables), {}, ())


def read_tables(path: Path, choice: Choice = FIRST) -> Recording:
    """The sensors of a folder on one clock; the accelerometer is brought to the stamps of the gyroscope.

    Raises
    ------
    InputError : no acceleration with gravity, a table that cannot be read
    """
    choice.require_none(path, "with one of each sensor")
    files = _files(path)
    phone = (path / "Metadata.csv").is_file() or (path / "meta" / "device.csv").is_file()
    C = FRD_OF_PHONE if phone else np.eye(3)
    force, notes = _force(files)
    gyro = _three(files["gyro"], "gyro", GYRO)
    gyro = gyro.rows((gyro.t >= force.t[:1]) & (gyro.t <= force.t[-1:]))
    f = np.stack([np.interp(gyro.t, force.t, force[name]) for name in ACCEL], axis=-1)
    axes = np.hstack([turned((-C if _of_apple(path) else C), f), turned(C, gyro.array(GYRO))])
    found: dict[str, Stream | None] = {"imu": Stream(gyro.t, dict(zip((*ACCEL, *GYRO), axes.T, strict=True)))}
    if "mag" in files:
        mag = _three(files["mag"], "mag", MAG, "uT" if phone else "")
        found["mag"] = Stream(mag.t, dict(zip(MAG, turned(C, mag.array(MAG)).T, strict=True)))
    found |= {name: _slow(files[name], name, notes) for name in ("baro", "gps") if name in files}
    factor, said = of_step(gyro.t)
    found = {name: one and Stream(one.t * factor, one.columns) for name, one in found.items()}
    axes_are = "forward is the top of the phone's screen, down its back" if phone else "as they are written"
    recording = recording_of(path, found, notes=[*notes, *said, f"axes: {axes_are}"])
    return recording.replace(notes=(*recording.notes, *sign_of_force(recording)))


def _force(files: Mapping[str, Path]) -> tuple[Stream, list[str]]:
    """What an accelerometer reads: a table with gravity, or one without it and one of gravity.

    Of two tables of acceleration the one that is called total, or not linear, has gravity. Where there is only one, and
    one of gravity, it has none: so Sensor Logger calls it.
    """
    free = next(name for name in ("linear acceleration", "acceleration", "accelerometer") if name in files)
    full = next(name for name in ("accelerometer", "acceleration", "linear acceleration") if name in files)
    if full != free or "gravity" not in files:
        return _three(files[full], "accelerometer", ACCEL), [f"imu: the accelerometer is {files[full].name}"]
    rest, gravity = _three(files[free], "linear acceleration", FREE), _three(files["gravity"], "gravity", GRAVITY)
    columns = {
        name: rest[one] + np.interp(rest.t, gravity.t, gravity[other])
        for name, one, other in zip(ACCEL, FREE, GRAVITY, strict=True)
    }
    names = f"{files[free].name} and {files['gravity'].name}"
    return Stream(rest.t, columns), [f"imu: the accelerometer is the sum of {names}"]


def _three(file: Path, sensor: str, columns: Sequence[str], unit: str = "") -> Stream:
    """Three axes of a table, on its clock.

    Raises
    ------
    InputError : an axis or the time is not there
    """
    t, table = _table(file, sensor, unit)
    if missing := [name for name in columns if name not in table]:
        raise InputError(file, f"no {', '.join(missing)}", "columns x, y, z", "line 1")
    return Stream(t, {name: table[name] for name in columns})


def _slow(file: Path, name: str, notes: list[str]) -> Stream | None:
    """A barometer or a receiver; None: neither a pressure nor a height, no position."""
    t, table = _table(file, name)
    if name == "baro" and "pressure" in table:
        pressure, said = in_pascal(table["pressure"])
        notes += said
        return Stream(t, {"pressure": pressure})
    if name == "gps" and set(GEODETIC) <= set(table):
        fixes = Stream(t, {column: table[column] for column in (*GEODETIC, "eph", "epv") if column in table})
        known = np.all([fixes[column] >= 0.0 for column in ("eph", "epv") if column in fixes] or [t == t], axis=0)
        notes += (
            [f"gps: {np.sum(~known)} fixes left out: their accuracy is negative, not known"] if not known.all() else []
        )
        return fixes.rows(known)
    return None


def _table(file: Path, sensor: str, unit: str = "") -> tuple[FloatArray, dict[str, FloatArray]]:
    """Times on the clock of the file, and the columns that say what they are; axes without a unit are in that given."""
    names = names_of(file)
    called = {name: _called(name, sensor, unit) for name in names}
    known = meanings(list(called.values()))
    wanted = [name for name in names if called[name] in (*known, *_OF_FIX.values())]
    numbers = read_columns(file, FileOptions(header=True), wanted)
    columns: dict[str, FloatArray] = {}
    for name in wanted:
        what = known.get(called[name])
        columns[what.column if what else called[name]] = converted(numbers[name], what) if what else numbers[name]
    if "t" not in columns:
        raise InputError(file, f"no time among the columns ({', '.join(names[:6])})", "a column of times", "line 1")
    return columns.pop("t"), columns


def _called(name: str, sensor: str, unit: str) -> str:
    """What a column of the table of a sensor is called in the grammar of names: `x` is `gyro x`."""
    bare = re.sub(r"\s*\(.*|[\s_]", "", name.lower())
    if bare in _OF_FIX:
        return _OF_FIX[bare]
    if re.match(r"[xyz]\b", name.strip().lower()) is None:
        return name
    return f"{sensor} {name.strip()}" + (f" [{unit}]" if unit and len(name.strip()) == 1 else "")
