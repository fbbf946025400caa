"""RINEX observation files 2.10 to 4: what the receiver measured, epoch by epoch."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from sinan.sensors.arrays import FloatArray, IntArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.rinex_text import (
    BDT_OFFSET,
    SYSTEMS,
    WEEK,
    Header,
    Text,
    calendar,
    century,
    fixed_point,
    gps_seconds,
    leap_seconds,
    names_in,
    number,
    printable,
    read_header,
    unpack,
)

TextArray = npt.NDArray[np.str_]

#: RINEX 2 code observations by the names of RINEX 3 (RINEX 2.11, table A1; RINEX 3.04, table A23)
NAMES_OF_RINEX_2: Mapping[str, Mapping[str, str]] = {
    "G": {"C1": "C1C", "P1": "C1W", "C2": "C2X", "P2": "C2W", "C5": "C5X"},
    "R": {"C1": "C1C", "P1": "C1P", "C2": "C2C", "P2": "C2P"},
    "E": {"C1": "C1X", "C5": "C5X", "C6": "C6X", "C7": "C7X", "C8": "C8X"},
    "S": {"C1": "C1C", "C5": "C5X"},
    "J": {"C1": "C1C", "C2": "C2X", "C5": "C5X"},
    "C": {"C1": "C2I", "C2": "C2I", "C6": "C6I", "C7": "C7I"},
    "I": {"C5": "C5A"},
}
EPOCH_2 = re.compile(r" ?[ \d]\d [ \d]\d [ \d]\d [ \d]\d [ \d]\d[ \d]{3}\.[\d ]{7}  [0-6][ \d]{3}")
MANY = 5  # lines of one kind that a journal shows before it counts


@dataclass(frozen=True)
class Observations:
    """Measurements of one receiver as a long table: one row a satellite and epoch.

    Attributes
    ----------
    where : file, for messages
    version : of RINEX
    position : (3,) header position, ECEF [m], or None; approximate
    week : GPS week from whose start the times count
    t : (epochs,) the receiver's time tags [s] in GPS time, strictly increasing; beyond 604800 in the next week
    epoch : (rows,) index into `t`
    satellite : (rows,) such as G07
    values : by RINEX 3 name (C1C, S1C; RINEX 2 phases keep theirs: L1), each (rows,), NaN where not measured
    journal : what was left out and why, a line each
    """

    where: str
    version: float
    position: FloatArray | None
    week: int
    t: FloatArray
    epoch: IntArray
    satellite: TextArray
    values: Mapping[str, FloatArray]
    journal: tuple[str, ...]

    @property
    def system(self) -> TextArray:
        """(rows,) letter of the satellite system."""
        return self.satellite.astype("<U1")


class Journal:
    """Lines about what a reader left out; many of one kind become one line with a count."""

    def __init__(self, where: str) -> None:
        self.where = where
        self.kinds: dict[str, list[str]] = {}
        self.counts: dict[str, int] = {}

    def add(self, kind: str, detail: str, count: int = 1) -> None:
        """Note one case of a kind."""
        self.counts[kind] = self.counts.get(kind, 0) + count
        if len(self.kinds.setdefault(kind, [])) < MANY:
            self.kinds[kind].append(detail)

    def lines(self) -> tuple[str, ...]:
        """One line a case, then one for the rest of each kind."""
        found = []
        for kind, details in self.kinds.items():
            found += [f"{self.where}, {detail}: {kind}" for detail in details]
            rest = self.counts[kind] - len(details)
            found += [f"{self.where}: {kind}, {rest} more"] if rest > 0 else []
        return tuple(found)


@dataclass
class Layout:
    """Where the records are, filled while walking through the file: one entry an epoch, one an observed satellite."""

    times: list[float]
    epoch: list[IntArray]
    first_line: list[IntArray]
    names: list[TextArray]
    end: str = ""


def read_observations(path: Path | str, kinds: str = "CS", systems: str = SYSTEMS) -> Observations:
    """Read an observation file.

    Parameters
    ----------
    path : plain, packed, or what the library `hatanaka` expands
    kinds : first letters of the observations to read: C code, L phase, D Doppler, S signal strength
    systems : letters of the satellite systems to read

    Raises
    ------
    InputError : no RINEX observation file, or not one complete epoch in it
    """
    text = unpack(path)
    header = read_header(text)
    if header.kind != "O":
        raise InputError(text.where, f"file type `{printable(header.kind)}`", "observations, type `O`", "line 1")
    journal = Journal(text.where)
    if text.complaint:
        journal.add(text.complaint, "compact RINEX")
    types = observation_types(text.where, header)
    version_2 = header.version < 3.0
    layout = walk_2(text, header, types, journal) if version_2 else walk_3(text, header, journal)
    if not layout.times:
        why = "; ".join(journal.lines()) or f"no epoch in {len(text)} lines"
        raise InputError(text.where, why, "at least one complete epoch")
    return table(text, header, types, layout, journal, kinds, systems)


def observation_types(where: str, header: Header) -> dict[str, list[str]]:
    """The observed types of each system, in the order of the columns."""
    types: dict[str, list[str]] = {}
    if header.version < 3.0:
        words = " ".join(line[6:60] for line in header.get("# / TYPES OF OBSERV")).split()
        types = dict.fromkeys(SYSTEMS, words) if words else {}
    else:
        system = ""
        for line in header.get("SYS / # / OBS TYPES"):
            system = line[:1].strip() or system
            types.setdefault(system, []).extend(line[6:60].split())
    if not types:
        raise InputError(where, "no list of observation types", "a header line `# / TYPES OF OBSERV` or `OBS TYPES`")
    if max(len(names) for names in types.values()) > 120:
        raise InputError(where, "more than 120 observation types", "at most 120 in a system")
    return types


def time_scale(text: Text, header: Header) -> str:
    """The time scale of the tags: GPS, GLO, GAL, QZS, BDT, IRN."""
    named = [line[48:51].strip() for line in header.get("TIME OF FIRST OBS")]
    default = {"R": "GLO", "C": "BDT"}.get(header.system, "GPS")
    return (named[0] if named else "") or default


def to_gps(time: float, scale: str) -> float:
    """A time tag in GPS time."""
    if scale == "GLO":
        return time + leap_seconds(time)
    return time + (BDT_OFFSET if scale in ("BDT", "BDS") else 0.0)


def epoch_3(line: str) -> tuple[float, int, int] | None:
    """Time, flag and count of an epoch line of RINEX 3 and 4; None: damaged."""
    try:
        minute = gps_seconds(int(line[2:6]), int(line[7:9]), int(line[10:12]), int(line[13:15]), int(line[16:18]))
        second, flag, count = float(line[18:29]), int(line[31:32]), int(line[32:35])
    except ValueError:
        return None
    if minute is None or not 0.0 <= second <= 61.0 or count < 0:
        return None
    return minute + second, flag, count


def walk_3(text: Text, header: Header, journal: Journal) -> Layout:
    """Find the epochs of RINEX 3 and 4: a line that starts with `>`, then one line a satellite."""
    scale = time_scale(text, header)
    head = text.data[text.start] == ord(">")
    head[: header.size] = False
    marks = np.flatnonzero(head)
    ends = np.append(marks, len(text))[1:]
    layout = Layout([], [], [], [])
    for mark, end in zip(marks.tolist(), ends.tolist(), strict=True):
        read = epoch_3(text.line(mark))
        if read is None:
            journal.add(
                "epoch left out: no time or count could be read",
                f"line {mark + 1}, `{printable(text.line(mark)[:40])}`",
            )
            continue
        time, flag, count = read
        if flag > 1:
            if flag == 4 and any("OBS TYPES" in text.line(i) for i in range(mark + 1, min(end, mark + 1 + count))):
                journal.add("observation types change: what follows is not read", f"line {mark + 1}")
                break
            continue
        cut = end == len(text) and not text.ended and end - mark - 1 <= count
        if end - mark - 1 < count or cut:
            at = f"line {mark + 1}, {calendar(time)}"
            found = f"{end - mark - 1} of {count} satellites" + (", the last line cut off" if cut else "")
            journal.add(f"epoch left out: truncated, {found}", at)
            continue
        if accept(layout, to_gps(time, scale), mark, journal) and count:
            lines = np.arange(mark + 1, mark + 1 + count)
            layout.first_line.append(lines)
            layout.epoch.append(np.full(count, len(layout.times) - 1))
            layout.names.append(names_in(text, lines))
    return layout


def accept(layout: Layout, time: float, line: int, journal: Journal) -> bool:
    """Take an epoch if its time is later than the last one's."""
    if layout.times and time <= layout.times[-1]:
        kind = "duplicate of the epoch before" if time == layout.times[-1] else "goes back in time"
        journal.add(f"epoch left out: {kind}", f"line {line + 1}, {calendar(time)}")
        return False
    layout.times.append(time)
    return True


def epoch_2(line: str) -> tuple[float | None, int, int] | None:
    """Time (None for an event without one), flag and count of an epoch line of RINEX 2; None: damaged."""
    if not EPOCH_2.match(line):
        return (None, int(line[28]), int(line[29:32])) if re.match(r" {28}[2-5][ \d]{2}\d", line) else None
    try:
        fields = [int(line[a : a + 2]) for a in (1, 4, 7, 10, 13)]
        second, flag, count = float(line[15:26]), int(line[28:29]), int(line[29:32])
    except ValueError:
        return None
    minute = gps_seconds(century(fields[0]), *fields[1:])
    return None if minute is None or not 0.0 <= second <= 61.0 else (minute + second, flag, count)


def walk_2(text: Text, header: Header, types: Mapping[str, Sequence[str]], journal: Journal) -> Layout:
    """Find the epochs of RINEX 2: an epoch line with the satellites, twelve a line, then their records."""
    scale = time_scale(text, header)
    per_satellite = -(-len(next(iter(types.values()))) // 5)
    layout = Layout([], [], [], [])
    point_18 = text.fields(np.arange(len(text)), np.array([18]), 1)[:, 0, 0] == ord(".")  # no record has one there
    i, lost = header.size, False
    while i < len(text):
        line = text.line(i)
        read = epoch_2(line)
        if read is None:
            if not lost and line.strip():
                journal.add("no epoch line here: skipped to the next one", f"line {i + 1}, `{printable(line[:40])}`")
            lost, i = lost or bool(line.strip()), i + 1
            continue
        time, flag, count = read
        lost = False
        if flag > 1:
            if flag == 4 and any("TYPES OF OBS" in text.line(k) for k in range(i, min(i + count + 1, len(text)))):
                journal.add("observation types change: what follows is not read", f"line {i + 1}")
                break
            i += 1 + count * (per_satellite if flag == 6 else 1)
            continue
        more = -(-count // 12)
        body = i + max(more, 1)
        end = body + count * per_satellite
        names = satellites_2(text, i, count, header.system)
        if end > len(text) or (end == len(text) and not text.ended):
            journal.add("epoch left out: truncated", f"line {i + 1}, {calendar(time or 0.0)}")
            break
        suspects = i + 1 + np.flatnonzero(point_18[i + 1 : end])
        intruder = [k for k in suspects.tolist() if EPOCH_2.match(text.line(k))]
        if intruder or names is None:
            why = "another one starts inside it" if intruder else "damaged list of satellites"
            journal.add(f"epoch left out: {why}", f"line {i + 1}")
            i, lost = (intruder[0] if intruder else i + 1), not intruder
            continue
        if accept(layout, to_gps(time or 0.0, scale), i, journal) and count:
            layout.first_line.append(body + per_satellite * np.arange(count))
            layout.epoch.append(np.full(count, len(layout.times) - 1))
            layout.names.append(np.array(names, dtype="<U3"))
        i = end
    return layout


def satellites_2(text: Text, line: int, count: int, system: str) -> list[str] | None:
    """Names of the satellites of a RINEX 2 epoch; a blank system is that of the file, GPS in a mixed one."""
    if line + -(-count // 12) > len(text):
        return None
    joined = "".join(text.line(line + k)[32:68].ljust(36) for k in range(-(-count // 12)))
    default = system if system in SYSTEMS else "G"
    names = [joined[3 * k : 3 * k + 3] for k in range(count)]
    names = [(default if name[0] == " " else name[0]) + name[1:].replace(" ", "0") for name in names]
    return names if all(re.fullmatch(r"[A-Z]\d\d", name) for name in names) else None


def table(
    text: Text,
    header: Header,
    types: Mapping[str, Sequence[str]],
    layout: Layout,
    journal: Journal,
    kinds: str,
    systems: str,
) -> Observations:
    """Read the numbers of all records, system by system."""
    empty = np.zeros(0, dtype=np.int64)
    line = np.concatenate([empty, *layout.first_line])
    epoch = np.concatenate([empty, *layout.epoch])
    name = np.concatenate([np.zeros(0, dtype="<U3"), *layout.names])
    keep = named_once(text, name, epoch, line, types, systems, journal)
    line, epoch, name = line[keep], epoch[keep], name[keep]
    values: dict[str, FloatArray] = {}
    system = name.astype("<U1")
    for letter in np.unique(system).tolist():
        rows = np.flatnonzero(system == letter)
        wanted = [k for k, kind in enumerate(types[letter]) if kind[:1] in (kinds + "P" * ("C" in kinds))]
        number_of = np.array(wanted, dtype=np.int64)
        if not wanted:
            continue
        value, damaged = read_fields(text, line[rows], number_of, header.version < 3.0)
        labels = [rinex_3_name(letter, types[letter][k]) if header.version < 3.0 else types[letter][k] for k in wanted]
        for r, f in np.argwhere(damaged).tolist():
            journal.add("not a number: left out", f"line {line[rows[r]] + 1}, {labels[f]} of {name[rows[r]]}")
        for f, label in enumerate(labels):
            column = values.setdefault(label, np.full(len(name), np.nan))
            merged = np.where(np.isnan(column[rows]), value[:, f], column[rows])
            zero = (merged == 0.0) & (label[0] == "C")
            for r in np.flatnonzero(zero).tolist():
                journal.add("zero pseudorange: left out", f"{calendar(layout.times[epoch[rows[r]]])}, {name[rows[r]]}")
            column[rows] = np.where(merged == 0.0, np.nan, merged)
    week = int(layout.times[0] // WEEK)
    t = np.array(layout.times) - week * WEEK
    return Observations(
        text.where, header.version, header_position(header), week, t, epoch, name, values, journal.lines()
    )


def named_once(
    text: Text,
    name: TextArray,
    epoch: IntArray,
    line: IntArray,
    types: Mapping[str, Sequence[str]],
    systems: str,
    journal: Journal,
) -> IntArray:
    """Rows of the wanted systems whose satellite has a proper name that its epoch has not had before."""
    known = np.isin(name.astype("<U1"), [letter for letter in types if letter in SYSTEMS])
    number_part = name.astype("<U3").view("<U1").reshape(-1, 3)[:, 1:]
    known &= np.char.isdigit(number_part).all(axis=1) if len(name) else known
    for r in np.flatnonzero(~known).tolist():
        journal.add("no satellite of the header's systems: left out", f"line {line[r] + 1}, `{printable(name[r])}`")
    rows = np.flatnonzero(known & np.isin(name.astype("<U1"), list(systems)))
    keys = np.char.add(epoch[rows].astype("<U12"), name[rows])
    first = np.sort(np.unique(keys, return_index=True)[1])
    for r in np.setdiff1d(np.arange(len(rows)), first).tolist():
        journal.add("second record of a satellite in one epoch: left out", f"line {line[rows[r]] + 1}, {name[rows[r]]}")
    return rows[first]


def read_fields(
    text: Text, line: IntArray, column: IntArray, version_2: bool
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Values of some observations of some records: (records, observations), and which are damaged."""
    if not version_2:
        return fixed_point(text.fields(line, 3 + 16 * column, 14))
    value = np.empty((len(line), len(column)))
    damaged = np.empty(value.shape, dtype=bool)
    for below in np.unique(column // 5).tolist():  # five observations a line
        here = column // 5 == below
        value[:, here], damaged[:, here] = fixed_point(text.fields(line + below, 16 * (column[here] % 5), 14))
    return value, damaged


def rinex_3_name(system: str, name: str) -> str:
    """RINEX 3 name of a code observation of RINEX 2; other observations keep their name."""
    return NAMES_OF_RINEX_2.get(system, {}).get(name, name)


def header_position(header: Header) -> FloatArray | None:
    """(3,) APPROX POSITION XYZ [m], None where it is not given or zero."""
    for line in header.get("APPROX POSITION XYZ"):
        numbers = [number(line[14 * k : 14 * k + 14]) for k in range(3)]
        if None not in numbers and any(numbers):
            return np.array(numbers, dtype=np.float64)
    return None
