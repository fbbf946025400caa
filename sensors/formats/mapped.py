"""A log and its map make a recording: columns become quantities in SI units, in the body's axes, on one clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.constants import SEA_LEVEL_TEMPERATURE, ZERO_CELSIUS
from sinan.sensors.errors import InputError
from sinan.sensors.formats.coarse_clock import spread
from sinan.sensors.formats.columns import notes_of, read_columns
from sinan.sensors.formats.geodetic import ned_columns, to_ned
from sinan.sensors.formats.map_rules import Clock, Keep, Map, Quantity, StreamMap
from sinan.sensors.formats.plausible import check_field, check_units
from sinan.sensors.formats.units import FIELD_UNIT, UNITS
from sinan.sensors.recording import GEODETIC, QUATERNION, Environment, Recording, Stream, Truth, check_rows
from sinan.sensors.rotation import quaternion_from_matrix, quaternion_from_rpy, quaternion_multiply

Columns = Mapping[str, FloatArray]
#: A quaternion whose norm is off one by more was interpolated, component by component, through its change of sign: from
#: q to -q the norm falls to zero, where it may mean any attitude; between neighbours of one sign it stays nearer.
_UNIT = 0.01
#: A reading printed or stored to seven digits is the mean of its neighbours to within this part of the largest.
_ROUNDING = 1e-7
#: NED axes of a vector given in east, north, up.
_ENU_TO_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def read_mapped(path: Path, rules: Map) -> Recording:
    """Read a log by its map.

    Parameters
    ----------
    path : the log, a file or a folder of files
    rules : the map

    Raises
    ------
    InputError : names the file or the key of the map, what was found and what was expected
    """
    if not path.exists():
        raise InputError(path, "no such file or folder", "a log")
    log = _Log(path, rules)
    notes = list(rules.notes)
    streams: dict[str, Stream] = {}
    for stream_map in rules.streams:
        stream, dropped = _stream(log, stream_map)
        streams[stream_map.name] = _with_derived(stream_map.name, stream)
        notes += [f"{stream_map.name}: {entry}" for entry in dropped]
    notes += log.notes()
    header, environment = rules.header, _environment(rules)
    streams, origin, chosen = to_ned(path, streams, header.origin)
    truth, dropped = _truth(log, origin)
    recording = Recording(
        name=rules.name or path.stem, kind=rules.kind, streams=streams, sensors=header.sensors,
        environment=environment, initial=header.initial, origin=origin, source=str(path),
        notes=(*notes, *dropped, *chosen), truth=truth,
    )  # fmt: skip
    check_units(recording)
    if environment.field_unit == FIELD_UNIT:
        check_field(recording)
    return recording


def _environment(rules: Map) -> Environment:
    """What the map declares of the place, with the unit in which the field of a log comes out whose own it names."""
    environment = rules.header.environment
    units = {quantity.unit for stream in rules.streams for name, quantity in stream.quantities.items() if name == "mag"}
    if not units & set(UNITS["field"]):
        return environment
    if environment.field_unit not in ("", FIELD_UNIT):
        found = f'"{environment.field_unit}" beside readings whose unit the map names'
        expected = f'none, or "{FIELD_UNIT}", in which they come out'
        raise InputError(rules.path, found, expected, "[environment] field_unit")
    return replace(environment, field_unit=FIELD_UNIT)


def _truth(log: _Log, origin: tuple[float, float, float] | None) -> tuple[Truth | None, list[str]]:
    """What a log may be scored against, and what was left out of it; None where the map has no `[reference]`.

    Parameters
    ----------
    origin : of the recording's NED frame, where the reference is geodetic; None: its first row is

    Raises
    ------
    InputError : what `read_mapped` finds wrong
    """
    if log.rules.reference is None:
        return None, []
    stream, dropped = _stream(log, log.rules.reference)
    check_rows(log.path, stream, "reference")
    columns = dict(stream.columns)
    if stream.has(GEODETIC):
        lla = stream.array(GEODETIC)
        first = (float(lla[0, 0]), float(lla[0, 1]), float(lla[0, 2]))
        columns = {name: values for name, values in columns.items() if name not in GEODETIC}
        columns = ned_columns(lla, origin or first) | columns
    if stream.has(("roll", "pitch", "yaw")):
        quaternion = quaternion_from_rpy(stream.array(("roll", "pitch", "yaw")))
        columns = {name: values for name, values in columns.items() if name not in ("roll", "pitch", "yaw")}
        columns |= dict(zip(QUATERNION, quaternion.T, strict=True))
    truth = Truth(Stream(stream.t, columns), log.rules.kind_of_reference, log.rules.aligned)
    return truth, [f"reference: {entry}" for entry in dropped]


@dataclass(frozen=True)
class _Log:
    """The files of a log, each read once."""

    path: Path
    rules: Map

    def __post_init__(self) -> None:
        object.__setattr__(self, "_read", {})

    def columns(self, file: str) -> Columns:
        read: dict[str, Columns] = self._read  # type: ignore[attr-defined]
        if file not in read:
            read[file] = read_columns(self.path, self.rules.files[file], _wanted(self.rules, file))
        return read[file]

    def notes(self) -> list[str]:
        """What could not be read of the files that were."""
        read: dict[str, Columns] = self._read  # type: ignore[attr-defined]
        return [note for columns in read.values() for note in notes_of(columns)]

    def column(self, file: str, name: str, key: str) -> FloatArray:
        columns = self.columns(file)
        if name not in columns:
            names = ", ".join(columns)
            there = names if len(names) < 400 else names[:400] + " ..."
            raise InputError(
                self.rules.path, f"column `{name}`, which {self._file(file)} has not", f"one of {there}", key
            )
        return columns[name]

    def has_one_row_an_instant(self, file: str) -> bool:
        """Whether each row of a file has all that was read at once, and none is there twice, as far as the map says."""
        of_file = [one for one in self.rules.streams if file in {one.file, *(q.file for q in one.quantities.values())}]
        return not any(one.name == "camera" or one.keep or "repeated time" in one.drop for one in of_file)

    def _file(self, file: str) -> str:
        options = self.rules.files[file]
        return options.member or options.path or self.path.name


def _wanted(rules: Map, file: str) -> set[str]:
    """The columns of a file that the map names."""
    names: set[str] = set()
    for stream in (*rules.streams, *([rules.reference] if rules.reference else [])):
        for quantity in stream.quantities.values():
            if (quantity.file or stream.file) == file:
                names |= {*quantity.columns, *quantity.minus, stream.clock.column, stream.clock.minus}
        if stream.file == file:
            names |= {*(keep.column for keep in stream.keep), stream.clock.column, stream.clock.minus}
    return names


def _stream(log: _Log, rules: StreamMap) -> tuple[Stream, list[str]]:
    """One stream, and what was left out of it."""
    files = dict.fromkeys(quantity.file or rules.file for quantity in rules.quantities.values())
    parts = {
        file: _part(log, rules, file, [q for q in rules.quantities.values() if (q.file or rules.file) == file])
        for file in sorted(files, key=lambda file: file != rules.file)  # the rows are those of the stream's own file
    }
    dropped = [entry for _, entries in parts.values() for entry in entries]
    first_file, *other_files = parts
    first = parts[first_file][0]
    columns = dict(first.columns)
    inside = np.ones(len(first), dtype=bool)
    for file in other_files:
        part = _aligned(log, rules, first, parts[file][0], file)
        columns |= part.columns
        inside &= (first.t >= parts[file][0].t[0]) & (first.t <= parts[file][0].t[-1])
    return Stream(first.t, columns).rows(inside), dropped


def _part(log: _Log, rules: StreamMap, file: str, quantities: list[Quantity]) -> tuple[Stream, list[str]]:
    """The quantities of one file, with its time, without the rows that do not count."""
    place = f"[{'streams.' if rules.name != 'reference' else ''}{rules.name}]"
    columns: dict[str, FloatArray] = {}
    raw: list[FloatArray] = []
    for quantity in quantities:
        readings = _table(log, file, quantity, f"{place} {quantity.outputs[0].rsplit('_', 1)[0]}")
        raw.append(readings)
        with np.errstate(all="ignore"):  # what is no number stays none, and is named with its row
            values = _value(quantity, readings)
        columns |= {name: values[:, k] for k, name in enumerate(quantity.outputs)}
    lengths = {len(readings) for readings in raw}
    if len(lengths) > 1:
        raise InputError(log.rules.path, f"columns of {', '.join(map(str, sorted(lengths)))} rows", "one length", place)
    n = lengths.pop()
    t = _time(log, rules.clock, file, n, place)
    t, said = spread(t) if log.has_one_row_an_instant(file) else (t, [])
    keep, dropped = _rows(log, rules, file, t, np.concatenate(raw, axis=1), place)
    if "not unit" in rules.drop:
        unit = np.all(
            [_is_unit(q) for x, q in zip(quantities, raw, strict=True) if x.outputs[0] == "qw"] or [keep], axis=0
        )
        if np.any(keep & ~unit):
            dropped.append(f"{int(np.sum(keep & ~unit))} rows left out: the quaternion is not of norm 1")
        keep = keep & unit
    return Stream(t[keep], {name: values[keep] for name, values in columns.items()}), [*said, *dropped]


def _table(log: _Log, file: str, quantity: Quantity, key: str) -> FloatArray:
    """(n, columns) the readings of a quantity, less what is taken off them."""
    names = (*quantity.columns, *quantity.minus)
    columns = [log.column(file, name, key) for name in names]
    if len({len(column) for column in columns}) > 1:
        lengths = ", ".join(f"{name}: {len(c)}" for name, c in zip(names, columns, strict=True))
        raise InputError(log.rules.path, f"columns of different length ({lengths})", "one length", key)
    size = len(quantity.columns)
    readings = np.stack(columns[:size], axis=-1)
    return readings - np.stack(columns[size:], axis=-1) if quantity.minus else readings


def _value(quantity: Quantity, readings: FloatArray) -> FloatArray:
    """The quantity in SI units and in its final axes; see `Quantity`."""
    if quantity.polar:
        speed, course, down = readings.T
        return np.stack([speed * np.cos(np.radians(course)), speed * np.sin(np.radians(course)), down], axis=-1)
    if quantity.outputs[0] == "qw":
        return _attitude(quantity, readings)
    raw = (readings + quantity.undo_offset) / quantity.undo_scale
    value = quantity.factor * ((raw - quantity.zero) / quantity.per_unit) + quantity.shift
    if quantity.axes is not None:
        value = value @ quantity.axes.T
    return value @ _ENU_TO_NED.T if quantity.enu else value


def _is_unit(q: FloatArray) -> BoolArray:
    """(n,) rows whose quaternion has norm one."""
    return np.asarray(np.abs(np.linalg.norm(q, axis=1) - 1.0) < _UNIT)


def _attitude(quantity: Quantity, q: FloatArray) -> FloatArray:
    """Body to NED: C_nb = C_n_world @ C_world_sensor @ C_sensor_body, with axes = C_body_sensor."""
    q = q / np.linalg.norm(q, axis=1, keepdims=True)
    if quantity.inverse:
        q = q * np.array([1.0, -1.0, -1.0, -1.0])
    if quantity.axes is not None:
        q = quaternion_multiply(q, np.broadcast_to(quaternion_from_matrix(quantity.axes.T), q.shape))
    if quantity.enu:
        q = quaternion_multiply(np.broadcast_to(quaternion_from_matrix(_ENU_TO_NED), q.shape), q)
    return q


def _time(log: _Log, clock: Clock, file: str, n: int, place: str) -> FloatArray:
    """(n,) time of the rows [s]: from a column, or counted."""
    factor = UNITS["time"][clock.unit][0] if clock.rate is None else 1.0 / clock.rate
    if not clock.column:
        return (np.arange(n, dtype=np.float64) - clock.zero) * factor
    shown, *taken_off = (log.column(file, name, f"{place} time") for name in (clock.column, clock.minus) if name)
    for column in (shown, *taken_off):
        if len(column) != n:
            raise InputError(log.rules.path, f"{len(column)} times for {n} rows", "one length", f"{place} time")
    if clock.wrap is not None:
        shown = shown + clock.wrap * np.concatenate([[0.0], np.cumsum(np.diff(shown) < -0.5 * clock.wrap)])
    t = (shown - sum(taken_off) - clock.zero) * factor
    return _evenly(t) if clock.even and n > 1 and np.all(np.isfinite(t)) else t


def _evenly(t: FloatArray) -> FloatArray:
    """(n,) the line fitted to the stamps over the row index, by least squares."""
    k = np.arange(len(t)) - 0.5 * (len(t) - 1)
    return np.asarray(t.mean() + k * (k @ t) / (k @ k), dtype=np.float64)


def _rows(
    log: _Log, rules: StreamMap, file: str, t: FloatArray, raw: FloatArray, place: str
) -> tuple[BoolArray, list[str]]:
    """Mask of the rows that count, and how many were left out for what."""
    keep = np.arange(len(t)) >= rules.skip_rows
    dropped: list[str] = []

    def leave_out(mask: BoolArray, reason: str) -> None:
        count = int(np.sum(keep & ~mask))
        if count:
            dropped.append(f"{count} rows left out: {reason}")
        keep[:] = keep & mask

    for condition in rules.keep if file == rules.file else ():
        column = log.column(file, condition.column, f"{place} keep")
        if len(column) != len(t):
            found = f"{len(column)} rows of `{condition.column}` for {len(t)}"
            raise InputError(log.rules.path, found, "one length", f"{place} keep")
        leave_out(_meets(column, condition), _reason(condition))
    finite = np.all(np.isfinite(raw), axis=1)
    if "not finite" in rules.drop:
        leave_out(finite & np.isfinite(t), "not a number")
    if "zeros" in rules.drop:
        leave_out(np.any(raw != 0.0, axis=1), "all zeros")
    if "interpolated" in rules.drop:
        leave_out(~_is_between(raw), "the mean of the rows before and after")
    if "held value" in rules.drop:
        leave_out(_changes(raw, keep), "the value before is repeated")
    if "repeated time" in rules.drop:
        leave_out(_later(t, keep), "the time of the row before is repeated")
    return keep, dropped


def _meets(column: FloatArray, condition: Keep) -> BoolArray:
    inside = (column > condition.above) & (column < condition.below)
    return inside if condition.equals is None else inside & (column == condition.equals)


def _reason(condition: Keep) -> str:
    if condition.equals is not None:
        return f"{condition.column} is not {condition.equals:g}"
    return f"{condition.column} is not between {condition.above:g} and {condition.below:g}"


def _changes(raw: FloatArray, keep: BoolArray) -> BoolArray:
    """Mask: the row differs from the kept row before it."""
    rows = np.flatnonzero(keep)
    mask = np.ones(len(raw), dtype=bool)
    mask[rows[1:]] = np.any(raw[rows[1:]] != raw[rows[:-1]], axis=1)
    return mask


def _is_between(raw: FloatArray) -> BoolArray:
    """Mask: the row is the mean of the row before and the row after, to rounding, in every column."""
    mask = np.zeros(len(raw), dtype=bool)
    if len(raw) > 2:
        miss = np.abs(raw[1:-1] - 0.5 * (raw[:-2] + raw[2:]))
        mask[1:-1] = np.all(miss <= _ROUNDING * np.max(np.abs(raw), axis=0), axis=1)
    return mask


def _later(t: FloatArray, keep: BoolArray) -> BoolArray:
    """Mask: the time is not that of the kept row before."""
    rows = np.flatnonzero(keep)
    mask = np.ones(len(t), dtype=bool)
    mask[rows[1:]] = t[rows[1:]] != t[rows[:-1]]
    return mask


def _aligned(log: _Log, rules: StreamMap, first: Stream, part: Stream, file: str) -> Stream:
    """A part of a stream at the times of the first part."""
    place = f"[streams.{rules.name}] align"
    if rules.align == "rows":
        if len(part) == len(first) and np.array_equal(part.t, first.t):
            return part
        found = f"other times in file {file} ({len(part)} rows for {len(first)})"
        raise InputError(log.rules.path, found, 'the same, or align = "interpolate"', place)
    for name, stream in (("the first file", first), (f"file {file}", part)):
        check_rows(log.path, stream, f"{place}, {name}")
    return Stream(first.t, {name: np.interp(first.t, part.t, values) for name, values in part.columns.items()})


def _with_derived(name: str, stream: Stream) -> Stream:
    """A barometer that gives pressure alone: its height by the standard atmosphere. A sonar that gives the time of
    flight alone: its range in air of its thermometer's temperature, else of the standard atmosphere at sea level.
    """
    from sinan.sensors.atmosphere import height_from_pressure
    from sinan.sensors.sonar import range_from_time_of_flight

    if name == "baro" and "height" not in stream and "pressure" in stream and not np.any(stream["pressure"] <= 0.0):
        return Stream(stream.t, {"height": height_from_pressure(stream["pressure"]), **stream.columns})
    if name == "sonar" and "range" not in stream and "time_of_flight" in stream:
        degrees = stream["temperature"] if "temperature" in stream else SEA_LEVEL_TEMPERATURE - ZERO_CELSIUS
        return Stream(
            stream.t, {"range": range_from_time_of_flight(stream["time_of_flight"], degrees), **stream.columns}
        )
    return stream
