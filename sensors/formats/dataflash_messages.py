"""The messages of an ArduPilot dataflash log, binary or text, which names its columns, units and multipliers.

`FMT` names the columns of a kind of message and how their numbers are stored, `UNIT` and `MULT` the letters that
`FMTU` gives each of them. A multiplier counts for the stored number, in place of that of the letters c, C, e, E, L
(hundredths, 1e-7 deg). A binary message is 0xA3, 0x95, its type and its fields. Source: ArduPilot,
`AP_Logger/LogStructure.h`.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.packed import read_plain, require_columns, require_numbers
from sinan.sensors.formats.records import fields_at
from sinan.sensors.formats.text_table import text_lines
from sinan.sensors.formats.units import UNITS

HEAD = b"\xa3\x95"
MAGIC = HEAD + b"\x80"
MAGIC_TEXT = re.compile(rb"(?:^|\n)\s*FMT,\s*128,")

#: How the letters of a format are stored; a letter without a number is a text.
_STORED = {
    "a": "(32,)<i2", "b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "f": "<f4", "d": "<f8",
    "g": "<f2", "n": "S4", "N": "S16", "Z": "S64", "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4",
    "M": "u1", "q": "<i8", "Q": "<u8",
}  # fmt: skip
_OWN_MULTIPLIER = {"c": 1e-2, "C": 1e-2, "e": 1e-2, "E": 1e-2, "L": 1e-7}
#: Lines before the first message.
_HEADING = 10
_FMT, _FMT_FORMAT, _FMT_FIELDS = 0x80, "BBnNZ", ("Type", "Length", "Name", "Format", "Columns")
#: ArduPilot's names of units, as those of `sensors.formats.units` for a quantity.
_UNIT_NAMES = {
    "m/s/s": "m/s^2", "rad/s": "rad/s", "deg/s": "deg/s", "Gauss": "gauss", "m": "m", "m/s": "m/s", "Pa": "Pa",
    "degC": "degC", "A": "A", "V": "V", "deg": "deg", "degheading": "deg", "deglatitude": "deg", "deglongitude": "deg",
    "rad": "rad", "s": "s",
}  # fmt: skip
#: Fields that tell the sensors of a kind apart where no unit says so.
_INSTANCE = ("I", "Instance", "C")


@dataclass(frozen=True)
class Kind:
    """A kind of message.

    Attributes
    ----------
    name : of it
    fields : names of its columns, in order
    format : a letter a column
    units, multipliers : of each column, where the log says them; 0: none
    """

    name: str
    fields: tuple[str, ...]
    format: str
    units: tuple[str, ...] = ()
    multipliers: tuple[float, ...] = ()

    @property
    def dtype(self) -> np.dtype[np.void]:
        """Of a binary message behind its head."""
        return np.dtype(list(zip(self.fields, (_STORED[letter] for letter in self.format), strict=True)))

    def scale(self, name: str, quantity: str, without: str, as_text: bool) -> tuple[float, float]:
        """Factor and offset that turn what is stored (in a text: printed) into SI units, gauss, or deg of `degrees`.

        Parameters
        ----------
        name : of the field
        quantity : a key of `UNITS`
        without : the unit where the log names none
        """
        k = self.fields.index(name)
        own = _OWN_MULTIPLIER.get(self.format[k], 1.0)
        unit = _UNIT_NAMES.get(self.units[k], "") if k < len(self.units) else ""
        said = self.multipliers[k] if k < len(self.multipliers) else 0.0
        if unit in UNITS[quantity] and said > 0.0:
            multiplier = said / own if as_text else said
        else:
            unit, multiplier = without, 1.0 if as_text else own
        factor, offset = UNITS[quantity][unit]
        return factor * multiplier, offset

    @property
    def instance(self) -> str:
        """The field that tells the sensors of the kind apart, or empty."""
        marked = [name for name, unit in zip(self.fields, self.units, strict=False) if unit == "instance"]
        return next((name for name in [*marked, *_INSTANCE] if name in self.fields), "")


@dataclass
class Dataflash:
    """A log: its kinds of messages, and their columns when they are asked for.

    Attributes
    ----------
    path : of the log
    kinds : that have a message, by name
    counts : of messages, by kind
    notes : what could not be read
    as_text : its numbers are printed
    heading : the first lines of a text log, where older firmware names itself
    """

    path: Path
    kinds: dict[str, Kind]
    counts: dict[str, int]
    notes: tuple[str, ...]
    as_text: bool
    _raw: Callable[[str, str], FloatArray]
    _texts: Callable[[str, str], list[str]]
    heading: tuple[str, ...] = ()
    _columns: dict[tuple[str, str], FloatArray] = field(default_factory=dict)

    def has(self, kind: str, *fields: str) -> bool:
        """Whether there are messages of a kind with these fields."""
        return kind in self.kinds and set(fields) <= set(self.kinds[kind].fields)

    def raw(self, kind: str, name: str) -> FloatArray:
        """(n,) the numbers of a field, with the multiplier of its letter."""
        if (kind, name) not in self._columns:
            own = _OWN_MULTIPLIER.get(self.kinds[kind].format[self.kinds[kind].fields.index(name)], 1.0)
            self._columns[kind, name] = self._raw(kind, name) * (1.0 if self.as_text else own)
        return self._columns[kind, name]

    def column(self, kind: str, name: str, quantity: str, without: str) -> FloatArray:
        """(n,) a field in SI units (a field in gauss, degrees in deg); see `Kind.scale`."""
        factor, offset = self.kinds[kind].scale(name, quantity, without, as_text=True)
        return self.raw(kind, name) * factor + offset

    def texts(self, kind: str, name: str) -> list[str]:
        """A field of texts."""
        return self._texts(kind, name)

    def rows_of(self, base: str, instance: int) -> tuple[str, BoolArray] | None:
        """The kind, and its messages, of one of several sensors; None: it is not there.

        The sensors of newer logs share a kind and have a field that counts them from 0; those of older ones have a kind
        each: `MAG`, `MAG2`, or `ACC1`, `ACC2`.
        """
        kind = self.kinds.get(base)
        if kind is not None and kind.instance:
            mine = self.raw(base, kind.instance) == instance
            return (base, mine) if np.any(mine) else None
        names = [f"{base}{instance + 1}"] if instance or kind is None else [base]
        if base == "BARO" and instance:
            names = [f"BAR{instance + 1}"]
        return next(((name, np.ones(self.counts[name], dtype=bool)) for name in names if name in self.kinds), None)

    def instances(self, base: str) -> int:
        """How many sensors of a kind there are."""
        return next(k for k in range(17) if k == 16 or self.rows_of(base, k) is None)


class Columns(Mapping[str, FloatArray]):
    """All fields of numbers of a log by `KIND.Field`, each (n,), and `KIND.row` that counts its messages.

    Parameters
    ----------
    log : whose fields are asked for, as it stores them, hundredths and degrees in full
    """

    def __init__(self, log: Dataflash) -> None:
        self._log, self.notes = log, log.notes
        self._names = {
            f"{kind}.{name}": (kind, name)
            for kind, of in log.kinds.items()
            for name, letter in zip((*of.fields, "row"), (*of.format, "I"), strict=True)
            if letter not in "anNZ"
        }

    def __getitem__(self, name: str) -> FloatArray:
        kind, column = self._names[name]
        if column == "row":
            return np.arange(self._log.counts[kind], dtype=np.float64)
        return self._log.raw(kind, column)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def read_messages(path: Path) -> Dataflash:
    """All messages of a log; what is damaged is passed over, and told in the notes.

    Raises
    ------
    InputError : no dataflash log, one without data, more than is read
    """
    with path.open("rb") as file:
        binary = file.read(3) == MAGIC
    return _Binary(path).log() if binary else _Text(path).log()


class _Kinds:
    """What `FMT`, `FMTU`, `UNIT` and `MULT` say, as they come."""

    def __init__(self) -> None:
        self.by_type: dict[int, Kind] = {_FMT: Kind("FMT", _FMT_FIELDS, _FMT_FORMAT)}
        self.said: dict[int, tuple[str, str]] = {}
        self.units: dict[str, str] = {}
        self.multipliers: dict[str, float] = {}

    def add(self, number: int, name: str, form: str, fields: str) -> bool:
        """Take in a kind; False: it is none that can be read."""
        names = tuple(part.strip() for part in fields.split(",")) if fields.strip(", ") else ()
        good = re.fullmatch(r"\w{1,16}", name) is not None and len(set(names)) == len(names) == len(form)
        if not (good and set(form) <= set(_STORED) and all(map(str.isidentifier, names))):
            return False
        self.by_type[number] = Kind(name, names, form)
        return True

    def named(self) -> dict[str, Kind]:
        """The kinds with their units, by name."""
        found = {}
        for number, kind in self.by_type.items():
            units, multipliers = self.said.get(number, ("", ""))
            found[kind.name] = Kind(
                kind.name, kind.fields, kind.format, tuple(self.units.get(letter, "") for letter in units),
                tuple(self.multipliers.get(letter, 0.0) for letter in multipliers),
            )  # fmt: skip
        return found

    def multiplier(self, letter: str, value: float) -> None:
        """Take in a multiplier: a double that was a single before."""
        self.multipliers[letter] = float(f"{value:.7g}") if np.isfinite(value) else 0.0


class _Binary:
    """The messages of a binary log: where each kind's are.

    Parameters
    ----------
    path : of the log
    """

    def __init__(self, path: Path) -> None:
        self.path, self.data = path, read_plain(path)
        self.kinds = _Kinds()
        self.at: list[array[int]] = [array("q") for _ in range(256)]
        self.lengths = [0] * 256
        self.lengths[_FMT] = 89
        self.describing = {_FMT}
        self.lost = self.places = 0

    def log(self) -> Dataflash:
        """Walk through the file."""
        position, end = 0, len(self.data)
        while position < end:
            following = self._messages(position)
            if following == position:
                following = self._next_head(position + 1)
                self.lost, self.places = self.lost + following - position, self.places + 1
            position = following
        counts = {kind.name: len(self.at[number]) for number, kind in self.kinds.by_type.items() if self.at[number]}
        require_numbers(self.path, sum(counts.values()))
        if not counts.keys() - {"FMT"}:
            raise InputError(self.path, "no message but those that name columns", "a log with data")
        numbers = {kind.name: number for number, kind in self.kinds.by_type.items()}
        raw = np.frombuffer(self.data, np.uint8)

        def stored(kind: str, name: str) -> FloatArray:
            of = self.kinds.by_type[numbers[kind]]
            starts = np.frombuffer(self.at[numbers[kind]], np.int64)
            if of.format[of.fields.index(name)] in "anNZ":
                raise InputError(self.path, f"{kind}.{name} is no number", "a field of numbers")
            return fields_at(raw, starts, of.dtype, (name,))[name]

        def texts(kind: str, name: str) -> list[str]:
            of = self.kinds.by_type[numbers[kind]]
            return [_text(self._one(of, at)[name]) for at in self.at[numbers[kind]]]

        lost = f"{self.lost} bytes that are no message: not read, at {self.places} " + (
            "place" if self.places == 1 else "places"
        )
        kinds = {name: kind for name, kind in self.kinds.named().items() if name in counts}
        return Dataflash(self.path, kinds, counts, (lost,) if self.lost else (), False, stored, texts)

    def _messages(self, position: int) -> int:
        """Take in the messages that begin at a byte, one after the other; the byte after them."""
        data, lengths, describing, end = self.data, self.lengths, self.describing, len(self.data)
        take = [places.append for places in self.at]
        while data[position : position + 2] == HEAD and position + 3 <= end:
            number = data[position + 2]
            following = position + lengths[number]
            if following == position or following > end:
                break
            take[number](position + 3)
            position = following
            if number in describing:
                self._describe(number)
        return position

    def _one(self, kind: Kind, at: int) -> np.void:
        return np.frombuffer(self.data, kind.dtype, count=1, offset=at)[0]

    def _describe(self, number: int) -> None:
        """Take in the last message of a kind that says something of others."""
        kind = self.kinds.by_type[number]
        message = self._one(kind, self.at[number][-1])
        if kind.name == "FMT":
            name, form, fields = (_text(message[part]) for part in ("Name", "Format", "Columns"))
            described, size = int(message["Type"]), int(message["Length"])
            if described == _FMT or not self.kinds.add(described, name, form, fields):
                return
            self.lengths[described] = size if size == 3 + self.kinds.by_type[described].dtype.itemsize else 0
            if name in ("FMTU", "UNIT", "MULT"):
                self.describing.add(described)
        elif kind.name == "FMTU" and {"FmtType", "UnitIds", "MultIds"} <= set(kind.fields):
            self.kinds.said[int(message["FmtType"])] = _text(message["UnitIds"]), _text(message["MultIds"])
        elif kind.name == "UNIT" and {"Id", "Label"} <= set(kind.fields):
            self.kinds.units[chr(int(message["Id"]) & 0xFF)] = _text(message["Label"])
        elif kind.name == "MULT" and {"Id", "Mult"} <= set(kind.fields):
            self.kinds.multiplier(chr(int(message["Id"]) & 0xFF), float(message["Mult"]))

    def _next_head(self, start: int) -> int:
        """Where the next message begins that is followed by another, or by the end of the file."""
        end = len(self.data)
        while (position := self.data.find(HEAD, start)) >= 0:
            number = self.data[position + 2] if position + 2 < end else 0
            following = position + self.lengths[number]
            whole = self.lengths[number] and following <= end
            if whole and (following == end or self.data[following : following + 2] == HEAD):
                return position
            start = position + 1
        return end


def _text(value: bytes) -> str:
    return bytes(value).split(b"\0")[0].decode("latin-1")


class _Text:
    """The lines of a text log, by kind.

    Parameters
    ----------
    path : of the log
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.kinds = _Kinds()
        self.lines: dict[str, list[str]] = {}
        self.heading: list[str] = []
        self.lost = 0

    def log(self) -> Dataflash:
        """Read the file; a line of another length than its kind's is left out."""
        try:
            self._read()
        except OSError as error:
            raise InputError(self.path, error.strerror or type(error).__name__, "a readable file") from None
        named = self.kinds.named()
        rows: dict[str, list[list[str]]] = {}
        for name in named.keys() & self.lines.keys():
            rows[name] = [row for line in self.lines[name] if (row := _cells(line, named[name])) is not None]
            self.lost += len(self.lines[name]) - len(rows[name])
        rows = {name: cells for name, cells in rows.items() if cells}
        if not rows:
            raise InputError(self.path, "no message but those that name columns", "a log with data")
        require_numbers(self.path, sum(len(cells) * len(cells[0]) for cells in rows.values()))

        def printed(kind: str, name: str) -> FloatArray:
            k = named[kind].fields.index(name)
            return _numbers([cells[k] for cells in rows[kind]])

        def texts(kind: str, name: str) -> list[str]:
            k = named[kind].fields.index(name)
            return [cells[k].strip() for cells in rows[kind]]

        lost = f"{self.lost} lines with another number of fields than their FMT line says: not read"
        counts = {name: len(cells) for name, cells in rows.items()}
        kinds = {name: kind for name, kind in named.items() if name in rows}
        notes = (lost,) if self.lost else ()
        return Dataflash(self.path, kinds, counts, notes, True, printed, texts, tuple(self.heading))

    def _read(self) -> None:
        known: set[str] = set()
        with text_lines(self.path.open("rb"), self.path) as file:
            for line in file:
                name, _, rest = line.decode("latin-1").rstrip("\r\n\0").partition(",")
                name = name.strip()
                if name in known:
                    self.lines[name].append(rest)
                elif not rest and not known and len(self.heading) < _HEADING:
                    self.heading.append(name)
                elif name == "FMT":
                    cells = [cell.strip() for cell in rest.split(",", 4)]
                    if len(cells) != 5 or not cells[0].isdecimal() or not cells[2].isalnum():
                        continue
                    if cells[2] != "FMT" and self.kinds.add(int(cells[0][:6]), cells[2], cells[3], cells[4]):
                        known.add(cells[2])
                        self.lines.setdefault(cells[2], [])
                        require_columns(self.path, len(known), "FMT lines")
        for rest in self.lines.get("FMTU", ()):
            cells = [cell.strip() for cell in rest.split(",", 3)]
            if len(cells) == 4 and cells[1].isdecimal():
                self.kinds.said[int(cells[1][:6])] = cells[2], cells[3]
        for rest in self.lines.get("UNIT", ()):
            cells = [cell.strip() for cell in rest.split(",", 2)]
            if len(cells) == 3 and cells[1].isdecimal():
                self.kinds.units[chr(int(cells[1][:6]) & 0xFF)] = cells[2]
        for rest in self.lines.get("MULT", ()):
            cells = [cell.strip() for cell in rest.split(",", 2)]
            if len(cells) == 3 and cells[1].isdecimal():
                self.kinds.multiplier(chr(int(cells[1][:6]) & 0xFF), float(_numbers([cells[2]])[0]))


def _cells(line: str, kind: Kind) -> list[str] | None:
    """The fields of a line, of which the last, if it is a text, may hold commas; None: there are more or fewer."""
    many = len(kind.fields)
    cells = line.split(",", many - 1) if kind.format.endswith(("Z", "N")) else line.split(",")
    return cells if len(cells) == many else None


def _numbers(cells: list[str]) -> FloatArray:
    """Cells as numbers; what is none becomes NaN."""
    try:
        return np.array(cells, dtype=np.float64)
    except ValueError:
        return np.array([_number(cell) for cell in cells])


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return np.nan
