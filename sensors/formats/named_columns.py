"""A table whose columns are called by what they hold, `ax`, `gyro_x`, `mag x [uT]`, as a recording: CSV and Parquet.

A unit stands in brackets, `[uT]` or `(uT)`, or at the end, `t_ms`, `ax_g`. Without one a column is in SI units, and a
magnetometer's stays open. Axes are taken as they are written, as the body's forward, right, down.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
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
    "gauss": ("gauss", "ga", "gs", "g"), "mGauss": ("mgauss", "mga", "mg"), "uT": ("ut", "µt", "μt", "microtesla"),
    "nT": ("nt",), "T": ("t", "tesla"), "s": ("s", "sec", "seconds"), "ms": ("ms", "msec", "milliseconds"),
    "us": ("us", "µs", "μs", "usec", "microseconds"), "ns": ("ns", "nsec", "nanoseconds"),
    "Pa": ("pa",), "hPa": ("hpa",), "mbar": ("mbar",), "kPa": ("kpa",), "degC": ("degc", "°c", "c", "celsius"),
    "K": ("k",), "degF": ("degf", "°f", "f"), "m": ("m", "meter", "metres"), "cm": ("cm",), "mm": ("mm",),
    "ft": ("ft",), "m/s": ("m/s", "mps", "m s^-1"), "cm/s": ("cm/s",), "mm/s": ("mm/s",), "A": ("a", "amp", "amps"),
    "mA": ("ma",), "V": ("v", "volt", "volts"), "mV": ("mv",), "deg": ("deg", "°"), "rad": ("rad",),
    "1e-7 deg": ("1e-7 deg", "dege7"),
}  # fmt: skip
#: Words that say where a sensor sits or what was done to its reading, before the one that says what it is.
_WHERE = frozenset({"imu", "raw", "sensor", "meas", "measured", "field"})
#: What the columns of three axes are called before `x`, `y`, `z`.
_TRIADS: Mapping[str, tuple[Sequence[str], str, str, tuple[str, ...]]] = {
    "accel": (ACCEL, "acceleration", "m/s^2", ("a", "acc", "accel", "accelerometer", "acceleration", "a rs s",
                                               "linear acceleration", "specific force")),
    "gyro": (GYRO, "rate", "rad/s", ("g", "gyr", "gyro", "gyroscope", "w", "omega", "w rs s", "rate", *(
        f"{one} {two}" for one in ("ang", "angle", "angular", "rotation", "turn", "body")
        for two in ("rate", "vel", "velocity")))),
    "mag": (MAG, "field", "", ("m", "mag", "magn", "magnetometer", "magnetic field", "mag field", "compass")),
}  # fmt: skip
#: Other columns: stream, column, quantity, unit where none is written, and the words that they are called by, one of
#: each choice in a row; "": none.
_RECEIVER = ("", "gps", "gnss", "gps pos", "gnss pos", "gps position", "gnss position")
_SPEED = ("v", "vel", "velocity", "gps v", "gps vel", "gps velocity", "gnss v", "gnss vel", "gnss velocity")
_INDICATED = ("ias", "vias", "cas", "vcas", "eas", "indicated airspeed")
_BEGIN = ("", "from start", "since start", "from boot", "since boot", "boot", "elapsed")
_SINGLE = (
    ("", "t", "time", "s", (("t", "time", "timestamp", "stamp"), _BEGIN)),
    ("", "t", "time", "s", (("seconds elapsed", "elapsed", "elapsed time", "sample time", "system time"),)),
    ("imu", "temperature", "temperature", "degC", (("temp", "temperature"),)),
    ("baro", "pressure", "pressure", "Pa", (("", "baro", "barometer", "air"), ("pressure", "press"))),
    ("baro", "pressure", "pressure", "Pa", (("baro", "barometer", "p"),)),
    ("baro", "height", "length", "m", (("baro", "barometer", "barometric", "pressure"), ("alt", "altitude", "height"))),
    ("gps", "latitude", "degrees", "deg", (_RECEIVER, ("lat", "latitude"))),
    ("gps", "longitude", "degrees", "deg", (_RECEIVER, ("lon", "lng", "long", "longitude"))),
    ("gps", "height", "length", "m", (_RECEIVER, ("alt", "altitude", "height"))),
    *(("gps", f"vel_{way}", "speed", "m/s", (_SPEED, (way[0], way))) for way in ("north", "east", "down")),
    ("power", "current", "current", "A", (("", "battery"), ("current", "amp", "amps"))),
    ("power", "current", "current", "A", (("i",),)),
    ("power", "voltage", "voltage", "V", (("", "battery"), ("voltage", "volt", "volts"))),
    ("power", "voltage", "voltage", "V", (("vbat",),)),
    ("air", "airspeed", "speed", "m/s", (("tas", "true airspeed", "airspeed"),)),
    ("air", "airspeed", "speed", "m/s", (_INDICATED,)),
)  # fmt: skip
_AS_INDICATED = tuple(one.replace(" ", "") for one in _INDICATED)
#: Rows of poses are means over rests, none of which is shorter [s]: a hand has to turn the sensor between two.
SHORTEST_REST = 0.5
#: How the note begins that names columns without a meaning.
UNREAD = "columns not read"
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
    text = name.strip().lstrip("#").strip()
    if text == "%time":  # as `rostopic echo -p` writes it
        return Meaning("", "t", "time", "ns")
    bracketed = re.fullmatch(r"(.*?)\s*[\[(]\s*([^\])]*)\s*[\])]\s*", text)
    if bracketed:
        return _known(_words(bracketed[1]), bracketed[2].lower())
    words = _words(text)
    found = _known(words, "")
    parts = re.fullmatch(r"(.+)[_ ]([^_ ]+)", text)
    if found is None and parts and parts[2]:
        found = _known(_words(parts[1]), parts[2].lower())
    return found if found is not None or len(words) < 2 else _known(words[:-1], words[-1])


def _words(name: str) -> list[str]:
    """The words of a name in lower case, also of one like `GNSSPosLat`."""
    return [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+", name)]


def _names() -> dict[str, tuple[str, str, str, str]]:
    """What every name means, its words without gaps: stream, column, quantity, unit where none is written."""
    known: dict[str, tuple[str, str, str, str]] = {}
    for stream, (columns, quantity, default, sensors) in _TRIADS.items():
        for one, (axis, column) in product(sensors, zip("xyz", columns, strict=True)):
            known[f"{one} {axis}"] = stream, column, quantity, default
            if len(one) > 1:
                known[f"{axis} {one}"] = stream, column, quantity, default
    for stream, column, quantity, default, choices in _SINGLE:
        known |= {" ".join(words): (stream, column, quantity, default) for words in product(*choices)}
    return {name.replace(" ", ""): what for name, what in known.items()}


_NAMES = _names()


def _known(words: Sequence[str], unit: str) -> Meaning | None:
    """The meaning of the words of a name with a unit, as it is written; None: no such name, or no such unit of it."""
    told = list(words)
    while told:
        if (what := _NAMES.get("".join(told))) is not None:
            return _in_unit(*what[:3], unit, what[3])
        if told.pop(0) not in _WHERE:
            return None
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
        there = f"no time among the columns ({', '.join(list(columns)[:12])})"
        way = "a map whose `time` counts the rows: `time = { rate = 100 }` [Hz] (--map FILE.toml)"
        raise InputError(path, there, f"a column t [s], or {way}")
    if t is None:
        t = np.arange(len(next(iter(values.values()))), dtype=np.float64)
    if len(t) == 0:
        raise InputError(path, "no row", "rows of numbers below the header")
    fields = {one.unit for _, one in known.values() if one.quantity == "field"}
    if len(fields) > 1:
        raise InputError(path, f"a magnetometer in {', '.join(sorted(fields))}", "one unit for all three axes")
    unread = f"{', '.join(left[:12])}{' ...' if len(left) > 12 else ''}"
    if kind == "poses":
        _require_rests(path, t, values, unread)
    notes = [f"{UNREAD}: {unread}"] if left else []
    indicated = "".join(_words(known["air", "airspeed"][0])) if ("air", "airspeed") in known else ""
    if indicated.startswith(_AS_INDICATED):
        notes.append("air: an indicated airspeed stands for the true one, 5 % larger for each 1000 m of height")
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


def _require_rests(path: Path, t: FloatArray, values: Mapping[tuple[str, str], FloatArray], unread: str) -> None:
    """Raise where rows with an accelerometer follow each other faster than anyone turns it from rest to rest."""
    step = float(np.median(np.diff(t))) if len(t) > 1 else np.inf
    if ("accel", "accel_x") in values and 0.0 < step < SHORTEST_REST:
        found = f"an accelerometer every {step:.3g} s and no gyroscope: a recording of motion, not poses at rest"
        hint = "gyro_x, gyro_y, gyro_z [rad/s], a map that names them (--map FILE.toml), or poses at rest, one a row"
        raise InputError(path, f"{found}{f' ({UNREAD}: {unread})' if unread else ''}", hint)


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
