"""A table whose columns are called by what they hold, `ax`, `gyro_x`, `mag x [uT]`, as a recording: CSV and Parquet.

A unit stands in brackets, `[uT]` or `(uT)`, or at the end, `t_ms`, `ax_g`. Without one a column is in SI units, and a
magnetometer's stays open. Axes are taken as they are written, as the body's forward, right, down.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.geodetic import to_ned
from sinan.sensors.formats.logged import sound
from sinan.sensors.formats.plausible import check_field, check_units
from sinan.sensors.formats.units import FIELD_UNIT, UNITS
from sinan.sensors.recording import ACCEL, GEODETIC, GYRO, MAG, VELOCITY, Environment, Kind, Recording, Stream

#: How units are written, in lower case, as `UNITS` has them; of a unit of several quantities the column decides.
_WRITTEN = {
    "m/s^2": ("m/s^2", "m/s2", "m/s²", "m/s/s", "mps2", "m s^-2", "ms-2", "m.s-2"), "g": ("g", "gs"),
    "mg": ("mg", "millig"), "rad/s": ("rad/s", "rps", "rad s^-1", "radps", "rad.s-1"),
    "deg/s": ("deg/s", "dps", "°/s", "degps", "deg s^-1"), "mdeg/s": ("mdeg/s", "mdps"),
    "gauss": ("gauss", "ga", "gs"), "mGauss": ("mgauss", "mga", "mg"), "uT": ("ut", "µt", "μt", "microtesla"),
    "nT": ("nt",), "T": ("t", "tesla"), "s": ("s", "sec", "seconds"), "ms": ("ms", "msec", "milliseconds"),
    "us": ("us", "µs", "μs", "usec", "microseconds"), "ns": ("ns", "nsec", "nanoseconds"),
    "Pa": ("pa",), "hPa": ("hpa",), "mbar": ("mbar",), "kPa": ("kpa",), "degC": ("degc", "°c", "c", "celsius"),
    "K": ("k",), "degF": ("degf", "°f", "f"), "m": ("m", "meter", "metres"), "cm": ("cm",), "mm": ("mm",),
    "ft": ("ft",), "m/s": ("m/s", "mps", "m s^-1"), "cm/s": ("cm/s",), "mm/s": ("mm/s",), "A": ("a", "amp", "amps"),
    "mA": ("ma",), "V": ("v", "volt", "volts"), "mV": ("mv",), "deg": ("deg", "°"), "rad": ("rad",),
    "1e-7 deg": ("1e-7 deg", "dege7"),
}  # fmt: skip
#: What the columns of three axes are called before `x`, `y`, `z`.
_TRIADS: Mapping[str, tuple[Sequence[str], str, str, tuple[str, ...]]] = {
    "accel": (ACCEL, "acceleration", "m/s^2", ("a", "acc", "accel", "accelerometer", "acceleration", "a rs s",
                                               "linear acceleration", "specific force", "raw accel")),
    "gyro": (GYRO, "rate", "rad/s", ("g", "gyr", "gyro", "gyroscope", "w", "omega", "angular velocity", "w rs s",
                                     "rotation rate", "rate", "raw gyro")),
    "mag": (MAG, "field", "", ("m", "mag", "magn", "magnetometer", "magnetic field", "compass", "raw mag")),
}  # fmt: skip
#: Other columns: stream, column, quantity, unit where none is written, and what they are called.
_SINGLE = (
    ("", "t", "time", "s", ("t", "time", "timestamp", "seconds elapsed", "time elapsed", "elapsed", "sample time")),
    ("imu", "temperature", "temperature", "degC", ("temp", "temperature", "imu temp", "imu temperature")),
    ("baro", "pressure", "pressure", "Pa", ("pressure", "press", "baro", "baro pressure", "barometer", "p")),
    ("baro", "height", "length", "m", ("baro alt", "baro height", "baro altitude", "pressure altitude")),
    ("gps", "latitude", "degrees", "deg", ("lat", "latitude", "gps lat", "gps latitude")),
    ("gps", "longitude", "degrees", "deg", ("lon", "lng", "long", "longitude", "gps lon", "gps lng", "gps longitude")),
    ("gps", "height", "length", "m", ("alt", "altitude", "height", "gps alt", "gps altitude", "gps height")),
    ("gps", "vel_north", "speed", "m/s", ("vn", "vel n", "vel north", "v north", "gps vel n", "gps vn")),
    ("gps", "vel_east", "speed", "m/s", ("ve", "vel e", "vel east", "v east", "gps vel e", "gps ve")),
    ("gps", "vel_down", "speed", "m/s", ("vd", "vel d", "vel down", "v down", "gps vel d", "gps vd")),
    ("power", "current", "current", "A", ("current", "amp", "amps", "battery current", "i")),
    ("power", "voltage", "voltage", "V", ("voltage", "volt", "volts", "vbat", "battery voltage")),
    ("air", "airspeed", "speed", "m/s", ("airspeed", "tas", "true airspeed")),
)  # fmt: skip
#: Slower sensors repeat their last reading in rows of the fastest, where more than this part of the rows repeats.
_REPEATED = 0.5


@dataclass(frozen=True)
class Meaning:
    """What a column holds: of which stream, as which column, of which quantity in which unit; "": nobody says."""

    stream: str
    column: str
    quantity: str
    unit: str


def meaning(name: str) -> Meaning | None:
    """What a column is by its name; None: something else."""
    text = name.strip().lstrip("#").strip().lower()
    bracketed = re.fullmatch(r"(.*?)\s*[\[(]\s*([^\])]*)\s*[\])]\s*", text)
    if bracketed:
        return _known(bracketed[1], bracketed[2])
    found = _known(text, "")
    if found is not None:
        return found
    parts = re.fullmatch(r"(.+)[_ ]([^_ ]+)", text)
    return _known(parts[1], parts[2]) if parts and parts[2] else None


def _known(name: str, unit: str) -> Meaning | None:
    """The meaning of a name with a unit, as it is written; None: there is no such name, or no such unit of it."""
    words = " ".join(re.findall(r"[a-z0-9]+", name))
    for stream, (columns, quantity, default, names) in _TRIADS.items():
        for k, axis in enumerate("xyz"):
            called = {f"{one} {axis}" for one in names} | {f"{one}{axis}" for one in names}
            called |= {f"{axis} {one}" for one in names if len(one) > 1}
            if words in called:
                return _in_unit(stream, columns[k], quantity, unit, default)
    for stream, column, quantity, default, names in _SINGLE:
        if words in names:
            return _in_unit(stream, column, quantity, unit, default)
    return None


def _in_unit(stream: str, column: str, quantity: str, unit: str, default: str) -> Meaning | None:
    if not unit:
        return Meaning(stream, column, quantity, default)
    own = [one for one in UNITS[quantity] if unit in _WRITTEN.get(one, (one.lower(),))]
    return Meaning(stream, column, quantity, own[0]) if own else None


def describes_itself(names: Sequence[str]) -> bool:
    """Whether names of columns have three axes of an accelerometer or a magnetometer among them."""
    found = {one.column for name in names if (one := meaning(name)) is not None}
    return set(ACCEL) <= found or set(MAG) <= found


def recording_of_names(path: Path, columns: Mapping[str, FloatArray]) -> Recording:
    """The columns that say what they are; a flight where there is a gyroscope, else poses, one a row.

    Raises
    ------
    InputError : a column twice, no time for a gyroscope; what `Recording` and the checks of units find wrong
    """
    known: dict[tuple[str, str], tuple[str, Meaning]] = {}
    left: list[str] = []
    for name in columns:
        one = meaning(name)
        if one is None:
            left.append(name)
        elif (one.stream, one.column) in known:
            other = known[one.stream, one.column][0]
            raise InputError(path, f"columns `{other}` and `{name}` for {one.column}", "one of them, or a map")
        else:
            known[one.stream, one.column] = name, one
    values = {key: _converted(columns[name], one) for key, (name, one) in known.items()}
    kind: Kind = "flight" if ("accel", "accel_x") in values and ("gyro", "gyro_x") in values else "poses"
    t = values.get(("", "t"))
    if t is None and kind == "flight":
        raise InputError(path, f"no time among the columns ({', '.join(list(columns)[:12])})", "a column t [s]")
    if t is None:
        t = np.arange(len(next(iter(values.values()))), dtype=np.float64)
    if len(t) == 0:
        raise InputError(path, "no row", "rows of numbers below the header")
    fields = {one.unit for _, one in known.values() if one.quantity == "field"}
    if len(fields) > 1:
        raise InputError(path, f"a magnetometer in {', '.join(sorted(fields))}", "one unit for all three axes")
    notes = [f"columns not read: {', '.join(left[:12])}{' ...' if len(left) > 12 else ''}"] if left else []
    mended = {name: sound(name, stream) for name, stream in _streams(kind, t, values).items()}
    notes += [note for _, told in mended.values() for note in told]
    streams = {name: stream for name, (stream, _) in mended.items() if len(stream)}
    if not streams:
        raise InputError(path, "no row of numbers", "readings")
    start = min(float(stream.t[0]) for stream in streams.values())
    streams = {name: Stream(stream.t - start, stream.columns) for name, stream in streams.items()}
    streams, origin, chosen = to_ned(path, streams, None)
    notes.append("axes are taken as they are written, as forward, right, down: `axes` of a map turns them")
    environment = Environment(field_unit=FIELD_UNIT if fields and "" not in fields else "")
    recording = Recording(
        path.stem, kind, streams, environment=environment, origin=origin, source=str(path), notes=(*notes, *chosen)
    )
    check_units(recording)
    if environment.field_unit:
        check_field(recording)
    return recording


def _converted(values: FloatArray, one: Meaning) -> FloatArray:
    if not one.unit:
        return values
    factor, offset = UNITS[one.quantity][one.unit]
    whole = values - values[0] if one.quantity == "time" and len(values) else values  # ns since 1970 have 19 digits
    return np.asarray(factor * whole + offset)


def _streams(kind: Kind, t: FloatArray, values: Mapping[tuple[str, str], FloatArray]) -> dict[str, Stream]:
    """The streams of a flight, or one of poses; what a slower sensor repeats left out."""
    whole = {"imu": (*ACCEL, *GYRO), "mag": MAG, "gps": GEODETIC}
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
        if name == "gps" and not set(VELOCITY) <= set(columns):
            columns = {column: one for column, one in columns.items() if column not in VELOCITY}
        readings = Stream(t, columns)
        streams[name] = readings if name in ("imu", "poses") or kind == "poses" else _new_rows(readings)
    return streams


def _new_rows(stream: Stream) -> Stream:
    """The rows that differ from the one before, where most do not."""
    if len(stream) < 2:
        return stream
    new = np.any([np.diff(one) != 0.0 for one in stream.columns.values()], axis=0)
    return stream.rows(np.concatenate([[True], new])) if np.mean(new) < 1.0 - _REPEATED else stream
