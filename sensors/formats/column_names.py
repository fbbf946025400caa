"""What a column holds, by its name: a grammar of sensor, axis and unit, `ax`, `gyro_x`, `mag x [uT]`.

A unit stands in brackets, `[uT]` or `(uT)`, or at the end, `t_ms`, `ax_g`. Without one a column is in SI units, and a
magnetometer's stays open.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

from sinan.sensors.formats.units import UNITS
from sinan.sensors.recording import ACCEL, GYRO, MAG

#: How units are written, in lower case, as `UNITS` has them; of a unit of several quantities the column decides.
_WRITTEN = {
    "m/s^2": ("m/s^2", "m/s2", "m/s²", "m/s/s", "mps2", "m s^-2", "ms-2", "m.s-2", "m/(s^2)",
              "meters/sec2"), "g": ("g", "gs"),
    "mg": ("mg", "millig"), "rad/s": ("rad/s", "rps", "rad s^-1", "radps", "rad.s-1"),
    "deg/s": ("deg/s", "dps", "°/s", "degps", "deg s^-1", "degrees/second"), "mdeg/s": ("mdeg/s", "mdps"),
    "gauss": ("gauss", "ga", "gs", "g"), "mGauss": ("mgauss", "mga", "mg"), "uT": ("ut", "µt", "μt", "microtesla"),
    "nT": ("nt",), "T": ("t", "tesla"), "s": ("s", "sec", "seconds"), "ms": ("ms", "msec", "milliseconds"),
    "us": ("us", "µs", "μs", "usec", "microseconds"), "ns": ("ns", "nsec", "nanoseconds"),
    "Pa": ("pa",), "hPa": ("hpa",), "mbar": ("mbar",), "kPa": ("kpa",), "degC": ("degc", "°c", "c", "celsius"),
    "K": ("k",), "degF": ("degf", "°f", "f"), "m": ("m", "meter", "meters", "metres"), "cm": ("cm",), "mm": ("mm",),
    "ft": ("ft",), "m/s": ("m/s", "mps", "m s^-1"), "cm/s": ("cm/s",), "mm/s": ("mm/s",), "A": ("a", "amp", "amps"),
    "mA": ("ma",), "V": ("v", "volt", "volts"), "mV": ("mv",), "deg": ("deg", "°", "degrees"), "rad": ("rad",),
    "1e-7 deg": ("1e-7 deg", "dege7"),
}  # fmt: skip
#: Words that say where a sensor sits or what was done to its reading, before the one that says what it is.
_WHERE = frozenset({"imu", "raw", "sensor", "meas", "measured", "field", "data"})
#: How a field is written whose unit is its own strength at calibration: none that is known here.
_NO_UNIT = frozenset({"local_flux", "a.u.", "au", "arb. units", "norm"})
#: Clocks in the place of a unit, of times of day.
_CLOCKS = frozenset({"utc", "gps", "local"})
#: An acceleration whose gravity an app took off, and what it took off; ROS calls the specific force so, too.
FREE, GRAVITY = (tuple(f"{name}_{axis}" for axis in "xyz") for name in ("free", "gravity"))
#: What the columns of three axes are called before `x`, `y`, `z`: as columns, of a quantity, in which unit without one.
_TRIADS: Sequence[tuple[str, Sequence[str], str, str, tuple[str, ...]]] = (
    ("accel", ACCEL, "acceleration", "m/s^2", ("a", "acc", "accel", "accelerometer", "acceleration", "a rs s",
                                               "accel ln", "accel wr", "accelerometer m s 2", "total acceleration",
                                               "specific force")),
    ("g", ACCEL, "acceleration", "g", ("g f", "g force")),
    ("free", FREE, "acceleration", "m/s^2", tuple(f"{one} {two}" for one in ("linear", "lin", "user", "free")
                                                  for two in ("acc", "accel", "acceleration", "accelerometer"))),
    ("gravity", GRAVITY, "acceleration", "m/s^2", ("gravity", "grav")),
    ("gyro", GYRO, "rate", "rad/s", ("g", "gyr", "gyro", "gyroscope", "w", "omega", "w rs s", "rate", "gyro rad", *(
        f"{one} {two}" for one in ("ang", "angle", "angular", "rotation", "turn", "body")
        for two in ("rate", "vel", "velocity")))),
    ("mag", MAG, "field", "", ("m", "mag", "magn", "magnetometer", "magnetic field", "mag field", "compass")),
    ("mag", MAG, "field", "gauss", ("magnetometer ga",)),
    # said with a unit alone: without one they may be biases, heights, indices
    ("gyro", GYRO, "rate", "?", ("as",)),
    ("mag", MAG, "field", "?", ("b", "h")),
)  # fmt: skip
#: Streams of the triads of an inertial unit.
INERTIAL = frozenset({"accel", "g", "free", "gravity", "gyro"})
#: Other columns: stream, column, quantity, unit where none is written, and the words that they are called by, one of
#: each choice in a row; "": none.
_RECEIVER = ("", "gps", "gnss", "gps pos", "gnss pos", "gps position", "gnss position", "location")
#: A counter of Xsens, of 10 kHz or of 1 MHz.
FINE = "sampletimefine"
_SPEED = ("v", "vel", "velocity", "gps v", "gps vel", "gps velocity", "gnss v", "gnss vel", "gnss velocity")
INDICATED = ("ias", "vias", "cas", "vcas", "eas", "indicated airspeed")
_BEGIN = ("", "startup", "from start", "since start", "from boot", "since boot", "boot", "elapsed", "unix")
_SINGLE = (
    ("", "t", "time", "s", (("t", "time", "times", "timestamp", "timestamps", "stamp"), _BEGIN)),
    ("", "t", "time", "ms", (("millis", "milliseconds"),)),
    ("", "t", "time", "us", (("micros", "microseconds"),)),
    ("", "t", "time", "s", (("offset time", "clock offset time", "sample time fine"),)),
    ("", "t", "time", "s", (("seconds elapsed", "elapsed", "elapsed time", "sample time", "system time"),)),
    ("imu", "temperature", "temperature", "degC", (("temp", "temperature"),)),
    ("baro", "pressure", "pressure", "Pa", (("", "baro", "barometer", "air", "atmospheric"), ("pressure", "press"))),
    ("baro", "pressure", "pressure", "Pa", (("baro", "barometer", "p"),)),
    ("baro", "height", "length", "m", (("baro", "barometer", "barometric", "pressure"), ("alt", "altitude", "height"))),
    ("gps", "latitude", "degrees", "deg", (_RECEIVER, ("lat", "latitude"))),
    ("gps", "longitude", "degrees", "deg", (_RECEIVER, ("lon", "lng", "long", "longitude"))),
    ("gps", "height", "length", "m", (_RECEIVER, ("alt", "altitude", "height", "alt msl", "height msl"))),
    *(("gps", f"vel_{way}", "speed", "m/s", (_SPEED, (way[0], way))) for way in ("north", "east", "down")),
    ("power", "current", "current", "A", (("", "battery"), ("current", "amp", "amps"))),
    ("power", "current", "current", "A", (("i",),)),
    ("power", "voltage", "voltage", "V", (("", "battery"), ("voltage", "volt", "volts"))),
    ("power", "voltage", "voltage", "V", (("vbat",),)),
    ("air", "airspeed", "speed", "m/s", (("tas", "true airspeed", "airspeed"),)),
    ("air", "airspeed", "speed", "m/s", (INDICATED,)),
)  # fmt: skip


@dataclass(frozen=True)
class Meaning:
    """What a column holds: of which stream, as which column, of which quantity in which unit; "": nobody says."""

    stream: str
    column: str
    quantity: str
    unit: str


def meaning(name: str) -> Meaning | None:
    """What a column is by its name; None: something else."""
    text = name.strip().lstrip("#").strip(" :")
    if text == "%time":  # as `rostopic echo -p` writes it
        return Meaning("", "t", "time", "ns")
    if text.startswith("/"):  # a topic, and its field
        parts = text.split("/")
        return meaning(" ".join(parts[-2:])) or meaning(parts[-1])
    if (device := re.fullmatch(r"(\w+)\((\d+)\):(.+)", text)) is not None:  # as DatCon writes it
        found = meaning(f"GPS {device[3]}" if device[1] == "GPS" else device[3]) if device[2] == "0" else None
        return found if found is None or device[1] == "GPS" or found.stream in ("accel", "gyro", "mag") else None
    text = re.sub(r"\[([012])\]$", lambda found: "_" + "xyz"[int(found[1])], text)
    bracketed = re.fullmatch(r"(.*?)\s*[\[(]\s*(.*?)\s*[\])]\s*", text)
    if bracketed:
        unit = re.sub(r"(?<=\w) (since|\[).*", "", bracketed[2].lower())  # `us since epoch`, `degrees [-180;180]`
        return _known(words_of(bracketed[1]), unit)
    words = words_of(text)
    found = _known(words, "")
    parts_of = re.fullmatch(r"(.+?)(?:[_ ]in)?[_ ]([^_ ]+)", text)
    if found is None and parts_of and parts_of[2]:
        found = _known(words_of(parts_of[1]), parts_of[2].lower())
    return found if found is not None or len(words) < 2 else _known(words[:-1], words[-1])


def meanings(names: Sequence[str]) -> dict[str, Meaning]:
    """What columns of one table are, by their names; a beginning that all share (`Shimmer_8665_`) says nothing.

    Where one time says its unit, or that it is the time elapsed, and another does not, the first counts.
    """
    named = [name for name in names if not name.isdigit()]  # a column without a name has its number
    first, last = (min(named), max(named)) if len(named) > 1 else ("", "")
    axes = {name: f"{stem}_{axis}" for stem in _numbered(named) for name, axis in zip(_three(stem), "xyz", strict=True)}
    shared = first[: next((k for k, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), 0)]
    length = max(shared.rfind(mark) for mark in "_./ ") + 1
    found = {
        name: what
        for name in names
        if (what := meaning(axes.get(name, name)) or (meaning(name[length:]) if length else None)) is not None
    }
    times = {name: what for name, what in found.items() if what.column == "t"}
    telling = [name for name in times if re.search(r"elapsed|[\[(]|[_ ][mun]?s(ec)?$", name.lower())]
    if len(telling) == 1:
        found = {name: what for name, what in found.items() if name not in times or name in telling}
    return found


def _three(stem: str) -> tuple[str, str, str]:
    return f"{stem}_1", f"{stem}_2", f"{stem}_3"


def _numbered(names: Sequence[str]) -> set[str]:
    """What has three columns, numbered from 1, as MATLAB writes a matrix: axes, where these have a meaning."""
    stems = {name[:-2] for name in names if name.endswith("_1")}
    return {stem for stem in stems if set(_three(stem)) <= set(names) and f"{stem}_4" not in names}


def words_of(name: str) -> list[str]:
    """The words of a name in lower case, also of one like `GNSSPosLat`."""
    return [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+", name)]


def _names() -> dict[str, tuple[str, str, str, str]]:
    """What every name means, its words without gaps: stream, column, quantity, unit where none is written."""
    known: dict[str, tuple[str, str, str, str]] = {}
    for stream, columns, quantity, default, sensors in _TRIADS:
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
    left = list(words[:-1] if words[-1:] == ["cal"] else words)
    while left:
        if (what := _NAMES.get("".join(left))) is not None:
            return _in_unit(*what[:3], unit, what[3])
        if left.pop(0) not in _WHERE:
            return None
    return None


def _in_unit(stream: str, column: str, quantity: str, unit: str, default: str) -> Meaning | None:
    if not unit or (quantity == "field" and unit in _NO_UNIT) or (quantity == "time" and unit in _CLOCKS):
        return Meaning(stream, column, quantity, default) if default != "?" else None
    own = [one for one in UNITS[quantity] if unit in _WRITTEN.get(one, (one.lower(),))]
    return Meaning(stream, column, quantity, own[0]) if own else None


def says_unit(name: str) -> bool:
    """Whether a name of a column ends with a unit."""
    what, bare = meaning(name), words_of(name)
    return bool(re.search(r"[\[(]", name)) or (
        what is not None and bool(bare) and bare[-1] in _WRITTEN.get(what.unit, ())
    )
