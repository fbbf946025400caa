"""RINEX navigation files 2.10 to 4: broadcast orbits, clocks and ionosphere, as tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from sinan.sensors.arrays import FloatArray, IntArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.rinex_observation import Journal
from sinan.sensors.formats.rinex_text import (
    BDT_OFFSET,
    WEEK,
    Header,
    Text,
    century,
    gps_seconds,
    leap_seconds,
    names_in,
    number,
    printable,
    read_header,
    unpack,
)

Table = npt.NDArray[np.void]

#: One broadcast Kepler orbit and clock a row. Times `toc`, `toe` are GPS time [s] since the start of week 0. SI units.
KEPLER = np.dtype(
    [("satellite", "<U3")]
    + [
        (name, "<f8")
        for name in (
            *("toc", "toe", "af0", "af1", "af2", "iode", "crs", "delta_n", "m0", "cuc", "e", "cus", "sqrt_a"),
            *("cic", "omega0", "cis", "i0", "crc", "omega", "omega_dot", "i_dot", "source", "accuracy", "health"),
            *("group_delay", "group_delay_2", "sent"),
        )
    ]
)
#: One GLONASS state vector a row, PZ-90 [m, m/s, m/s^2]; `time` is GPS time [s] since the start of week 0.
GLONASS = np.dtype(
    [("satellite", "<U3")]
    + [
        (name, "<f8")
        for name in (
            "time",
            "tau",
            "gamma",
            "x",
            "vx",
            "ax",
            "health",
            "y",
            "vy",
            "ay",
            "channel",
            "z",
            "vz",
            "az",
            "age",
        )
    ]
)
#: Columns of a Kepler record after the time (RINEX 3.04, tables A6, A8, A12, A14): names in the order of the file.
LAYOUT = (
    *("af0", "af1", "af2", "iode", "crs", "delta_n", "m0", "cuc", "e", "cus", "sqrt_a", "toe", "cic", "omega0", "cis"),
    *("i0", "crc", "omega", "omega_dot", "i_dot", "source", "week", "spare_1"),
)
LAYOUT_END = {  # the last two lines differ from system to system
    "G": ("accuracy", "health", "group_delay", "iodc", "sent", "fit"),
    "J": ("accuracy", "health", "group_delay", "iodc", "sent", "fit"),
    "E": ("accuracy", "health", "group_delay", "group_delay_2", "sent", "spare_2"),
    "C": ("accuracy", "health", "group_delay", "group_delay_2", "sent", "aodc"),
    "I": ("accuracy", "health", "group_delay", "spare_2", "sent", "spare_3"),
}
LAYOUT_GLONASS = (
    *("tau", "gamma", "frame_time", "x", "vx", "ax", "health", "y", "vy", "ay", "channel", "z", "vz", "az", "age"),
)
ESSENTIAL = (
    *("toc", "toe", "af0", "af1", "af2", "crs", "delta_n", "m0", "cuc", "e", "cus", "sqrt_a", "cic", "omega0"),
    *("cis", "i0", "crc", "omega", "omega_dot", "i_dot"),
)
ESSENTIAL_GLONASS = ("time", "tau", "gamma", "x", "y", "z", "vx", "vy", "vz", "ax", "ay", "az")
#: Largest magnitudes that the messages can hold, generously (IS-GPS-200N, tables 20-I and 20-III, and their like)
LARGEST = {
    **dict.fromkeys(("m0", "omega0", "i0", "omega"), 10.0),
    **dict.fromkeys(("omega_dot", "i_dot", "delta_n"), 1e-3),
    **dict.fromkeys(("cuc", "cus", "cic", "cis", "af0"), 0.1),
    **dict.fromkeys(("crs", "crc"), 1e5),
    **dict.fromkeys(("af1", "af2", "group_delay", "group_delay_2"), 1e-3),
    **dict.fromkeys(("sqrt_a", "accuracy", "health", "source"), 1e6),
}
#: Messages of RINEX 4 with the same layout as RINEX 3
LEGACY_MESSAGES = ("LNAV", "INAV", "FNAV", "D1", "D2", "FDMA")


@dataclass(frozen=True)
class Navigation:
    """Broadcast messages of one or several files.

    Attributes
    ----------
    where : files, for messages
    kepler : rows of `KEPLER`: GPS, Galileo, QZSS, BeiDou, NavIC
    glonass : rows of `GLONASS`
    klobuchar : (8,) alpha_0..3 [s, s/sc, ...] and beta_0..3 of GPS (else BeiDou, QZSS), or None
    journal : what was left out and why, a line each
    """

    where: str
    kepler: Table
    glonass: Table
    klobuchar: FloatArray | None
    journal: tuple[str, ...] = field(default=())

    def satellites(self) -> frozenset[str]:
        """Satellites with at least one orbit."""
        return frozenset(self.kepler["satellite"].tolist()) | frozenset(self.glonass["satellite"].tolist())


def read_navigation(*paths: Path | str) -> Navigation:
    """Read navigation files and join them.

    Raises
    ------
    InputError : no RINEX navigation file, or not one complete record in it
    """
    if not paths:
        raise InputError("navigation", "no file", "at least one RINEX navigation file")
    files = [read_file(path) for path in paths]
    klobuchar = [file.klobuchar for file in files if file.klobuchar is not None]
    return Navigation(
        ", ".join(file.where for file in files),
        np.concatenate([file.kepler for file in files]),
        np.concatenate([file.glonass for file in files]),
        klobuchar[0] if klobuchar else None,
        tuple(line for file in files for line in file.journal),
    )


def read_file(path: Path | str) -> Navigation:
    """Read one navigation file."""
    text = unpack(path)
    header = read_header(text)
    if header.kind not in ("N", "G", "H"):
        raise InputError(text.where, f"file type `{printable(header.kind)}`", "navigation data, type `N`", "line 1")
    journal = Journal(text.where)
    first, satellite, size = (records_2 if header.version < 3.0 else records_3)(text, header, journal)
    indent = 3 if header.version < 3.0 else 4
    times = record_times(text, header, first, journal)
    system = satellite.astype("<U1")
    usable = np.isfinite(times) & complete(text, first, satellite, size, journal)
    kepler = [
        kepler_table(text, first[rows], satellite[rows], times[rows], indent, letter, journal)
        for letter in "GEJCI"
        for rows in [np.flatnonzero((system == letter) & usable)]
    ]
    rows = np.flatnonzero((system == "R") & usable)
    glonass = glonass_table(text, first[rows], satellite[rows], times[rows], indent, journal)
    joined = np.concatenate(kepler)
    if not len(joined) + len(glonass):
        why = "; ".join(journal.lines()) or f"no record in {len(text)} lines"
        raise InputError(text.where, why, "at least one complete record")
    klobuchar = klobuchar_header(header)
    if klobuchar is None and header.version >= 4.0:
        klobuchar = klobuchar_record(text)
    return Navigation(text.where, joined, glonass, klobuchar, journal.lines())


def records_3(text: Text, header: Header, journal: Journal) -> tuple[IntArray, npt.NDArray[np.str_], IntArray]:
    """First line, satellite and number of lines of each record of RINEX 3 and 4."""
    initial = text.fields(np.arange(len(text)), np.array([0]), 1)[:, 0, 0]
    marked = (initial != ord(" ")) & (text.length > 0)
    marked[: header.size] = False
    mark = np.flatnonzero(marked)
    size = np.diff(np.append(mark, len(text)))
    is_title = initial[mark] == ord(">")
    legacy = np.ones(len(mark), dtype=bool)
    for k in np.flatnonzero(is_title).tolist():
        words = text.line(int(mark[k])).split()
        good = len(words) >= 4 and words[1] == "EPH" and words[3] in LEGACY_MESSAGES
        if not good:
            legacy[k : k + 2] = False
            if words[1:2] == ["EPH"]:
                journal.add(f"message {printable(' '.join(words[3:4]))}: not read", f"line {mark[k] + 1}")
    keep = legacy & ~is_title
    mark, size = mark[keep], size[keep]
    return mark, names_in(text, mark), size


def records_2(text: Text, header: Header, journal: Journal) -> tuple[IntArray, npt.NDArray[np.str_], IntArray]:
    """First line, satellite and number of lines of each record of RINEX 2: a number in the first two columns."""
    letter = {"G": "R", "H": "S"}.get(header.kind, "G")
    lines = np.arange(len(text))
    initial = text.fields(lines, np.array([0]), 2)[:, 0]
    mark = lines[((initial[:, 1] >= ord("0")) & (initial[:, 1] <= ord("9"))) & (lines >= header.size)]
    names = np.array([letter + text.line(i)[:2].replace(" ", "0") for i in mark.tolist()], dtype="<U3")
    return mark, names, np.diff(np.append(mark, len(text)))


def complete(
    text: Text, first: IntArray, satellite: npt.NDArray[np.str_], size: IntArray, journal: Journal
) -> npt.NDArray[np.bool_]:
    """(records,) records with all their lines: 4 for GLONASS and SBAS, else 8; the last one with its line end."""
    expected = np.where(np.isin(satellite.astype("<U1"), ["R", "S"]), 4, 8)
    cut = size < expected
    if len(first) and not text.ended and first[-1] + expected[-1] >= len(text):
        cut[-1] = True
    for k in np.flatnonzero(cut).tolist():
        found = f"{size[k]} of {expected[k]} lines" + ("" if size[k] < expected[k] else ", the last one cut off")
        journal.add("record left out: truncated", f"line {first[k] + 1}, {printable(satellite[k])}, {found}")
    return ~cut


def record_times(text: Text, header: Header, first: IntArray, journal: Journal) -> FloatArray:
    """(records,) time of each record in its own time scale [s] since GPS week 0; NaN: damaged, and in the journal."""
    time = np.full(len(first), np.nan)
    for k, line in enumerate(first.tolist()):
        content = text.line(line)
        words = content[3:22].split() if header.version < 3.0 else content[4:23].split()
        try:
            year, month, day, hour, minute = (int(word) for word in words[:5])
            second = float(words[5])
        except (ValueError, IndexError):
            journal.add("record left out: no time could be read", f"line {line + 1}, `{printable(content[:23])}`")
            continue
        start = gps_seconds(century(year) if header.version < 3.0 else year, month, day, hour, minute)
        if start is None or not 0.0 <= second <= 61.0:
            journal.add("record left out: no such date", f"line {line + 1}, `{printable(content[:23])}`")
            continue
        time[k] = start + second
    return time


def numbers(text: Text, first: IntArray, lines: int, indent: int) -> FloatArray:
    """(records, 4 lines - 1) the numbers of records, in file order; NaN where blank or damaged."""
    if not len(first):
        return np.zeros((0, 4 * lines - 1))
    column = indent + 19 * np.arange(4)
    line = (first[:, None] + np.arange(lines)).ravel()
    characters = text.fields(line, column, 19).reshape(len(first), 4 * lines, 19)[:, 1:]
    characters = np.where((characters == ord("D")) | (characters == ord("d")), np.uint8(ord("E")), characters)
    blank = (characters == 32).all(axis=-1)
    characters[blank, :3] = np.frombuffer(b"nan", dtype=np.uint8)
    words = np.ascontiguousarray(characters).view("S19")[..., 0]
    try:
        value = words.astype(np.float64)
    except ValueError:
        one_by_one = [number(word.decode("latin-1")) for word in words.ravel().tolist()]
        value = np.array([np.nan if v is None else v for v in one_by_one]).reshape(words.shape)
    return np.where(np.isfinite(value), value, np.nan)


def kepler_table(
    text: Text,
    first: IntArray,
    satellite: npt.NDArray[np.str_],
    toc: FloatArray,
    indent: int,
    system: str,
    journal: Journal,
) -> Table:
    """Kepler records of one system as rows of `KEPLER`."""
    value = dict(zip((*LAYOUT, *LAYOUT_END[system]), numbers(text, first, 8, indent).T, strict=False))
    table = np.zeros(len(first), dtype=KEPLER)
    table["satellite"] = satellite
    offset = BDT_OFFSET if system == "C" else 0.0
    for name in table.dtype.names or ():
        if name in value:
            table[name] = value[name]
    table["toc"] = toc + offset
    table["toe"] = time_near(value["toe"] + offset, table["toc"])
    table["sent"] = time_near(value["sent"] + offset, table["toc"])
    for name in ("group_delay", "group_delay_2", "health", "source"):
        table[name] = np.nan_to_num(table[name])
    return essential(table, first, ESSENTIAL, possible(table), journal)


def possible(table: Table) -> npt.NDArray[np.bool_]:
    """(records,) whether every number of a Kepler message lies where the message format can put it."""
    good = (table["sqrt_a"] > 2500.0) & (table["e"] >= 0.0) & (table["e"] < 0.9)
    for name, largest in LARGEST.items():
        good &= ~(np.abs(table[name]) > largest)
    return np.asarray(good)


def time_near(second_of_week: FloatArray, near: FloatArray) -> FloatArray:
    """The instant with this second of the week that is nearest to another instant (the week number may lag behind)."""
    return second_of_week + WEEK * np.round((near - second_of_week) / WEEK)


def glonass_table(
    text: Text, first: IntArray, satellite: npt.NDArray[np.str_], utc: FloatArray, indent: int, journal: Journal
) -> Table:
    """GLONASS records as rows of `GLONASS`; their times are UTC, their lengths kilometres."""
    value = dict(zip(LAYOUT_GLONASS, numbers(text, first, 4, indent).T, strict=True))
    table = np.zeros(len(first), dtype=GLONASS)
    table["satellite"] = satellite
    table["time"] = utc + np.array([leap_seconds(t) for t in utc.tolist()]).reshape(len(utc))
    for name in ("x", "y", "z", "vx", "vy", "vz", "ax", "ay", "az"):
        table[name] = 1000.0 * value[name]
    table["tau"] = -value["tau"]  # the file holds -tau_n
    for name in ("gamma", "health", "channel", "age"):
        table[name] = value[name]
    good = np.ones(len(table), dtype=bool)
    for axis in "xyz":
        good &= (np.abs(table[axis]) < 3.1e7) & (np.abs(table[f"v{axis}"]) < 1e4) & (np.abs(table[f"a{axis}"]) < 1.0)
    good &= (np.abs(table["tau"]) < 0.1) & (np.abs(table["gamma"]) < 1e-3)
    good &= ~(np.abs(table["health"]) > 1e6) & (np.abs(np.nan_to_num(table["channel"], nan=99.0)) < 30.0)
    x, y, z = (np.where(good, table[axis], 0.0) for axis in "xyz")
    return essential(table, first, ESSENTIAL_GLONASS, good & (x**2 + y**2 + z**2 > 2.0e7**2), journal)


def essential(
    table: Table, first: IntArray, names: Sequence[str], plausible: npt.NDArray[np.bool_], journal: Journal
) -> Table:
    """The rows whose orbit and clock are complete and possible."""
    good = np.all([np.isfinite(table[name]) for name in names], axis=0) & plausible if len(table) else plausible
    for k in np.flatnonzero(~good).tolist():
        journal.add("record left out: an orbit or clock number is missing or impossible", f"line {first[k] + 1}")
    return table[good]


def klobuchar_header(header: Header) -> FloatArray | None:
    """(8,) the coefficients in the header: ION ALPHA and ION BETA, or IONOSPHERIC CORR with GPSA and GPSB."""
    found: dict[str, list[float | None]] = {}
    for label, line in header.lines:
        if label in ("ION ALPHA", "ION BETA"):
            found[f"GPS{label[4]}"] = [number(line[2 + 12 * k : 14 + 12 * k]) for k in range(4)]
        elif label == "IONOSPHERIC CORR":
            found[line[:4]] = [number(line[5 + 12 * k : 17 + 12 * k]) for k in range(4)]
    for system in ("GPS", "BDS", "QZS"):
        values = found.get(f"{system}A", [None]) + found.get(f"{system}B", [None])
        if None not in values and any(values):
            return np.array(values, dtype=np.float64)
    return None


def klobuchar_record(text: Text) -> FloatArray | None:
    """(8,) the first Klobuchar message of RINEX 4 (4.00, table A30): three lines, 3 + 4 + 1 numbers."""
    head = text.fields(np.arange(len(text)), np.array([0]), 5)[:, 0].copy().view("S5")[:, 0]
    for i in np.flatnonzero(head == b"> ION").tolist():
        words = text.line(i).split()
        if len(words) >= 4 and words[3] in ("LNAV", "D1D2") and words[2][:1] in "GC" and i + 3 < len(text):
            values = numbers(text, np.array([i + 1]), 3, 4)[0, :8]
            if np.isfinite(values).all() and values.any():
                return values
    return None
