"""A table whose columns are called by what they hold, `ax`, `gyro_x`, `mag x [uT]`, as a recording: CSV and Parquet.

Axes are taken as they are written, as the body's forward, right, down. Of an acceleration
that is told twice, with gravity and without, the first is the accelerometer's reading.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.constants import STANDARD_GRAVITY
from sinan.sensors.errors import InputError
from sinan.sensors.formats.coarse_clock import spread
from sinan.sensors.formats.column_names import FINE, FREE, GRAVITY, INDICATED, Meaning, meanings, says_unit, words_of
from sinan.sensors.formats.geodetic import to_ned
from sinan.sensors.formats.logged import goes_back, sound
from sinan.sensors.formats.plausible import HECTOPASCALS, check_field, check_units, sign_of_force
from sinan.sensors.formats.units import FIELD_UNIT, UNITS
from sinan.sensors.held import held
from sinan.sensors.recording import ACCEL, GEODETIC, GYRO, MAG, VELOCITY, Environment, Kind, Recording, Stream

_AS_INDICATED = tuple(one.replace(" ", "") for one in INDICATED)
#: Rows of poses are means over rests, none of which is shorter [s]: a hand has to turn the sensor between two.
SHORTEST_REST = 0.5
#: Nobody rests as long between two poses [s].
_LONGEST_REST = 1000.0
_DAY = 86_400.0  # s
#: How the note begins that names columns without a meaning.
UNREAD = "columns not read"
#: Steps between readings of an IMU whose log does not say their unit [s].
_STEP = (0.001, 0.1)
#: Part of gravity that z reads at least where it points up.
_UPWARD = 0.7


def describes_itself(names: Sequence[str]) -> bool:
    """Whether names of columns have three axes of an accelerometer or a magnetometer among them."""
    found = {one.column for one in meanings(names).values()}
    return any(set(three) <= found for three in (ACCEL, FREE, MAG))


def recording_of_names(path: Path, columns: Mapping[str, FloatArray]) -> Recording:
    """The columns that say what they are; a flight where there is a gyroscope, else poses, one a row.

    Raises
    ------
    InputError : a column twice, no time for a gyroscope; what `Recording` and the checks of units find wrong
    """
    known, left = _known(path, columns)
    values = {key: converted(_since_first(columns[name], one), one) for key, (name, one) in known.items()}
    _require_three_axes(path, known)
    notes = _one_force(values)
    _require_all_inertial(path, values, left)
    kind: Kind = "flight" if ("accel", "accel_x") in values and ("gyro", "gyro_x") in values else "poses"
    t = values.get(("", "t"))
    if t is None and kind == "flight":
        there = f"no time among the columns ({', '.join(list(columns)[:12])})"
        way = "a map whose `time` counts the rows: `time = { rate = 100 }` [Hz] (--map FILE.toml)"
        raise InputError(path, there, f"a column t [s], or {way}")
    if t is None:
        t = np.arange(len(next(iter(values.values()))), dtype=np.float64)
    if len(t) == 0:
        raise InputError(path, "no row", "rows of numbers below the header")
    clocked = kind == "flight" or ("accel", "accel_x") not in values  # poses may be as far apart as one likes
    if ("", "t") in values and clocked and not says_unit(known["", "t"][0]):
        factor, said = of_step(t, 1.0 if kind == "flight" else _LONGEST_REST, "".join(words_of(known["", "t"][0])))
        t, notes = factor * t, notes + said
    if ("baro", "pressure") in values and not says_unit(known["baro", "pressure"][0]):
        values["baro", "pressure"], said = in_pascal(values["baro", "pressure"])
        notes += said
    fields = {one.unit for _, one in known.values() if one.quantity == "field"}
    if len(fields) > 1:
        raise InputError(path, f"a magnetometer in {', '.join(sorted(fields))}", "one unit for all three axes")
    unread = f"{', '.join(left[:12])}{' ...' if len(left) > 12 else ''}"
    if kind == "poses":
        _require_rests(path, t, values, unread)
    notes += [f"{UNREAD}: {unread}"] if left else []
    indicated = "".join(words_of(known["air", "airspeed"][0])) if ("air", "airspeed") in known else ""
    if indicated.startswith(_AS_INDICATED):
        notes.append("air: an indicated airspeed stands for the true one, 5 % larger for each 1000 m of height")
    if kind == "flight":
        t, said = spread(t)
        notes += said
    found = _streams(kind, t, values)
    notes += _omitted(kind, values, found)
    mended = {name: sound(name, stream) for name, stream in found.items()}
    notes += [note for _, of_stream in mended.values() for note in of_stream]
    streams = {name: stream for name, (stream, _) in mended.items() if len(stream)}
    if not streams:
        raise InputError(path, "no row of numbers", "readings")
    start = min(float(stream.t[0]) for stream in streams.values())
    twice = tuple((begin - start, end - start) for begin, end in goes_back(found.values()))
    streams = {name: Stream(stream.t - start, stream.columns) for name, stream in streams.items()}
    streams, origin, chosen = to_ned(path, streams, None)
    notes += _axes(streams.get("imu"))
    environment = Environment(field_unit=FIELD_UNIT if fields and "" not in fields else "")
    recording = Recording(
        path.stem, kind, streams, environment=environment, origin=origin, source=str(path), notes=(*notes, *chosen),
        goes_back=twice,
    )  # fmt: skip
    check_units(recording)
    if environment.field_unit:
        check_field(recording)
    return recording.replace(notes=(*recording.notes, *sign_of_force(recording)))


def _known(path: Path, names: Iterable[str]) -> tuple[dict[tuple[str, str], tuple[str, Meaning]], list[str]]:
    """Which column is called what, by stream and column; and those that mean nothing."""
    known: dict[tuple[str, str], tuple[str, Meaning]] = {}
    meaning_of, left = meanings(list(names)), []
    for name in names:
        one = meaning_of.get(name)
        if one is None:
            left.append(name)
        elif (one.stream, one.column) in known:
            other = known[one.stream, one.column][0]
            raise InputError(path, f"columns `{other}` and `{name}` for {one.column}", "one of them, or a map")
        else:
            known[one.stream, one.column] = name, one
    return known, left


def _one_force(values: dict[tuple[str, str], FloatArray]) -> list[str]:
    """Leave one acceleration: what an accelerometer reads, else the sum of both its parts, else the one that there is.

    An app that tells the force in g (`gFx`) calls the acceleration without gravity `ax`.
    """
    ways = [
        [(stream, column) for column in columns] for stream, columns in (("g", ACCEL), ("accel", ACCEL), ("free", FREE))
    ]
    there = [way for way in ways if all(key in values for key in way)]
    gravity = [("gravity", column) for column in GRAVITY]
    found = [values[key] for key in there[0]] if there else []
    notes = []
    if there and there[0] == ways[2] and all(key in values for key in gravity):
        found = [one + values[key] for one, key in zip(found, gravity, strict=True)]
        notes = ["imu: the accelerometer is the sum of the acceleration without gravity and of gravity"]
    elif len(there) > 1:
        notes = ["imu: of an acceleration with gravity and one without, the first is read"]
    for key in (*ways[0], *ways[2], *gravity, *(ways[1] if there else ())):
        values.pop(key, None)
    return notes if not values.update(zip(ways[1], found, strict=False)) else []


def _require_three_axes(path: Path, known: Mapping[tuple[str, str], tuple[str, Meaning]]) -> None:
    """Raise where one axis of an accelerometer or a gyroscope is missing: the rest would be taken for less than it is.

    An accelerometer is whole, too, where one of the ways to tell it is.
    """
    forces = [(stream, columns) for stream, columns in (("g", ACCEL), ("accel", ACCEL), ("free", FREE))]
    for title, ways in (("an accelerometer", forces), ("a gyroscope", [("gyro", GYRO)])):
        there = [[(stream, column) in known for column in columns] for stream, columns in ways]
        if any(map(all, there)):
            continue
        for (stream, columns), axes in zip(ways, there, strict=True):
            if sum(axes) == len(columns) - 1:
                named = ", ".join(f"`{known[stream, one][0]}`" for one in columns if (stream, one) in known)
                found = f"{title} without {'xyz'[axes.index(False)]}: {named} alone"
                hint = "a third column beside them, or --map FILE.toml of what is to be read without them"
                raise InputError(path, found, hint, "stream imu")


def _require_all_inertial(path: Path, values: Mapping[tuple[str, str], FloatArray], left: Sequence[str]) -> None:
    """Raise where a table would be taken for less than it holds: columns that name an IMU and are not read."""
    missed = {"accelerometer": ("accel", "accel_x"), "gyro": ("gyro", "gyro_x"), "gyroscope": ("gyro", "gyro_x")}
    for name in left:
        words = words_of(re.sub(r"[\[(].*", "", name))
        sensor = next((one for one in missed if one in words), None) if words and words[-1] in "xyz" else None
        if sensor is not None and missed[sensor] not in values:
            found = f"column `{name}`, whose meaning or unit is not known"
            raise InputError(path, found, "gyro_x [deg/s], or --map FILE.toml")


def of_step(t: FloatArray, least: float = 1.0, name: str = "") -> tuple[float, list[str]]:
    """Seconds in the unit, which nobody said, of times of an IMU: that in which it reads 10 to 1000 times a second.

    Parameters
    ----------
    least : a smaller step may be one of seconds
    name : of the column, its words in lower case: Xsens' counts 0.1 ms, or us
    """
    step = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    units = {unit: UNITS["time"][unit][0] for unit in ("ms", "us", "ns")}
    for unit, factor in ({"0.1 ms": 1e-4, "us": 1e-6} if name == FINE else units).items():
        if step >= least and _STEP[0] <= step * factor <= _STEP[1]:
            return factor, [f"time: a step of {step:.6g} is taken for {unit}, which nobody says"]
    return 1.0, []


def in_pascal(pressure: FloatArray) -> tuple[FloatArray, list[str]]:
    """Pressures whose unit nobody said: hPa where no atmosphere has so few pascals."""
    middle = float(np.nanmedian(pressure)) if np.any(np.isfinite(pressure)) else 0.0
    if HECTOPASCALS[0] < middle < HECTOPASCALS[1]:
        return 100.0 * pressure, [f"baro: a pressure of {middle:.6g} is taken for hPa, which nobody says"]
    return pressure, []


def _axes(imu: Stream | None) -> list[str]:
    """That axes are as they are written; and what that means where z reads gravity upward, as most boards have it."""
    notes = ["axes are taken as they are written, as forward, right, down: `axes` of a map turns them"]
    if imu is not None and np.median(imu["accel_z"]) > _UPWARD * STANDARD_GRAVITY:
        axes = "axes: accel_z reads +g, so z points up (or gravity is logged, not force) and attitudes are those of a "
        notes.append(axes + "body on its back; with x forward, y left a map has axes = ['x', '-y', '-z']")
    return notes


def _require_rests(path: Path, t: FloatArray, values: Mapping[tuple[str, str], FloatArray], unread: str) -> None:
    """Raise where rows with an accelerometer follow each other faster than anyone turns it from rest to rest."""
    step = float(np.median(np.diff(t))) if len(t) > 1 else np.inf
    if ("accel", "accel_x") in values and 0.0 < step < SHORTEST_REST:
        found = f"an accelerometer every {step:.3g} s and no gyroscope: a recording of motion, not poses at rest"
        hint = "gyro_x, gyro_y, gyro_z [rad/s], a map that names them (--map FILE.toml), or poses at rest, one a row"
        raise InputError(path, f"{found}{f' ({UNREAD}: {unread})' if unread else ''}", hint)
    if step > _DAY:
        raise InputError(
            path, f"{step:.3g} s between two rows: another unit of time", "seconds, or a name that says it: t_ms"
        )


def converted(values: FloatArray, one: Meaning) -> FloatArray:
    """Readings in SI units, a field in gauss; times as the clock of the log has them."""
    if not one.unit:
        return values
    factor, offset = UNITS[one.quantity][one.unit]
    return np.asarray(factor * values + offset)


def _since_first(values: FloatArray, one: Meaning) -> FloatArray:
    """Times less the first: ns since 1970 have 19 digits."""
    return values - values[0] if one.column == "t" and len(values) else values


def _streams(kind: Kind, t: FloatArray, values: Mapping[tuple[str, str], FloatArray]) -> dict[str, Stream]:
    """The streams of a flight, or one of poses; what a slower sensor repeats left out."""
    whole = {"imu": (*ACCEL, *GYRO), "mag": MAG, "gps": GEODETIC[:2]}
    if kind == "flight":
        of = {"accel": "imu", "gyro": "imu"}
    else:  # a magnetometer alone is turned by hand, as fast as it reads
        of = dict.fromkeys(("accel", "mag", "imu"), "poses" if ("accel", "accel_x") in values else "mag")
    found: dict[str, dict[str, FloatArray]] = {}
    for (stream, column), one in values.items():
        if column != "t" and (kind == "flight" or stream in of):
            found.setdefault(of.get(stream, stream), {})[column] = one
    streams: dict[str, Stream] = {}
    for name, columns in found.items():
        if not set(whole.get(name, ())) <= set(columns):
            continue
        if name == "gps":
            columns = _of_fixes(columns)
        readings = _read_rows(Stream(t, columns), whole.get(name, ()))
        if name == "gps":
            readings = readings.rows(~_nowhere(readings.columns))
        fastest = name in ("imu", "poses") or kind == "poses"
        streams[name] = readings if fastest else readings.rows(~held(readings.array(list(readings.columns))))
    return streams


def _omitted(kind: Kind, values: Mapping[tuple[str, str], FloatArray], read: Mapping[str, Stream]) -> list[str]:
    """Which sensors that are there were not read, and why."""
    there: dict[str, list[str]] = {}
    for stream, column in values:
        if column != "t":
            there.setdefault(stream, []).append(column)
    if kind == "poses":
        others = sorted(there.keys() - {"accel", "mag", "imu"})
        return [f"no accelerometer with a gyroscope, so not read: {', '.join(others)}"] if others else []
    lost = int(np.sum(_nowhere({column: one for (stream, column), one in values.items() if stream == "gps"})))
    notes = [f"gps: {lost} rows left out: latitude and longitude are zero, no fix"] if lost and "gps" in read else []
    whole = {"mag": MAG, "gps": GEODETIC[:2]}
    missing = {name: [one for one in whole[name] if one not in there[name]] for name in whole if name in there}
    notes += [f"{name}: not read, without {', '.join(missing[name])}" for name in missing if name not in read]
    return notes + [f"{name}: not read, no row of it holds a number" for name in read if not len(read[name])]


def _of_fixes(columns: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Columns of a receiver without a velocity that lacks a component, and without a height that is never told."""
    left_out = set(VELOCITY) if not set(VELOCITY) <= set(columns) else set()
    if not np.any(np.isfinite(columns.get("height", np.nan))):
        left_out.add("height")
    return {column: one for column, one in columns.items() if column not in left_out}


def _nowhere(columns: Mapping[str, FloatArray]) -> BoolArray:
    """(n,) the fixes at latitude and longitude zero, which a receiver tells before it knows where it is."""
    place = [columns[name] == 0.0 for name in GEODETIC[:2] if name in columns]
    return np.asarray(np.all(place, axis=0) if len(place) == 2 else np.zeros(0, dtype=bool))


def _read_rows(stream: Stream, required: Sequence[str]) -> Stream:
    """The rows in which something was read, without those whose cells are all empty; a temperature of fewer rows is
    brought to the others.
    """
    must = [name for name in required if name in stream.columns] or list(stream.columns)
    stream = stream.rows(np.any(np.isfinite(stream.array(must)), axis=1))
    warmth = stream.columns.get("temperature")
    if required and warmth is not None and np.any(known := np.isfinite(warmth)):
        brought = np.interp(stream.t, stream.t[known], warmth[known])
        return Stream(stream.t, {**stream.columns, "temperature": brought})
    return stream
