"""A TOML table whose every key is checked: wrong types and unknown keys become one-line errors that name the key."""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.packed import read_plain

#: The largest file [bytes], 30 times the largest of the data sets, and the deepest nesting of tables and lists, of
#: which a map has six.
LARGEST = 2**18
DEEPEST = 20
#: The largest number, beyond clocks that count nanoseconds since 1970 and counters of 64 bits: its powers stay finite.
LARGEST_NUMBER = 1e20
#: The most digits that Python reads of a whole number, unless told otherwise.
_DIGITS = 4300


def load_toml(path: Path) -> Table:
    """The top-level table of a TOML file.

    Raises
    ------
    InputError : no such file, too large, not UTF-8, not TOML (names the line)
    """
    return Table(path, read_toml(path))


def read_toml(path: Path) -> dict[str, object]:
    """The tables of a TOML file as they are; see `load_toml`."""
    try:
        text = read_plain(path, LARGEST).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(path, f"byte 0x{error.object[error.start]:02x}", "UTF-8 text", f"byte {error.start}") from None
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        found, _, place = str(error).removesuffix(")").partition(" (at ")
        raise InputError(path, found, "TOML", place) from None
    except RecursionError:
        raise _too_deep(path, _line(text, rf"[\[{{](?:[^\]}}]*?[\[{{]){{{DEEPEST}}}")) from None
    except ValueError:
        found = f"a whole number of more than {_DIGITS} digits"
        raise InputError(path, found, "a shorter one", _line(text, rf"[0-9_]{{{_DIGITS}}}")) from None
    _require_shallow(path, data)
    return data


def _line(text: str, pattern: str) -> str:
    """The place of the first match."""
    match = re.search(pattern, text)
    return f"line {text.count(chr(10), 0, match.start()) + 1}" if match else ""


def _too_deep(path: Path, place: str) -> InputError:
    found = f"more than {DEEPEST} tables and lists in one another"
    return InputError(path, found, f"at most {DEEPEST}", place)


def _require_shallow(path: Path, data: dict[str, object]) -> None:
    """Raise an `InputError` for tables that nest deeper than any that are read; dotted keys nest without brackets."""
    inside: list[tuple[str, object]] = list(data.items())
    for _ in range(DEEPEST):
        inside = [
            (key, below) for key, value in inside
            for below in (value.values() if isinstance(value, dict) else value if isinstance(value, list) else ())
        ]  # fmt: skip
    if inside:
        raise _too_deep(path, f"key {inside[0][0]}")


class Table:
    """One table of a TOML file. What was asked for is known; `done` names the first key that nobody asked for.

    Parameters
    ----------
    path : of the file, for messages
    data : the parsed table
    name : dotted name of the table, empty at the top level
    schema : JSON Schema of such a table; the keys that are asked for are added to it
    """

    def __init__(
        self, path: Path | str, data: Mapping[str, object], name: str = "", schema: dict[str, Any] | None = None
    ) -> None:
        self.path, self.data, self.name = path, data, name
        self.schema = {} if schema is None else schema
        self._known: list[str] = []
        _add(self.schema, {"type": ["object"], "additionalProperties": False})
        self._properties: dict[str, dict[str, Any]] = self.schema.setdefault("properties", {})

    def __contains__(self, key: str) -> bool:
        self._ask(key)
        return key in self.data

    def names(self) -> tuple[str, ...]:
        """The keys that are there."""
        return tuple(self.data)

    def place(self, key: str) -> str:
        """How messages call a key."""
        return f"[{self.name}] {key}" if self.name else f"key {key}"

    def error(self, key: str, found: str, expected: str) -> InputError:
        """The error that names a key of this table."""
        return InputError(self.path, found, expected, self.place(key))

    def _ask(self, key: str, **schema: Any) -> dict[str, Any]:
        """Note that a key is known; its schema, with what is added to it."""
        if key not in self._known:
            self._known.append(key)
        return _add(self._properties.setdefault(key, {}), schema)

    def get(self, key: str, *types: str, **schema: Any) -> object:
        """The raw value, or None. Whoever checks it says what it may be: its types and other words of JSON Schema."""
        self._ask(key, **({"type": [*types]} if types else {}), **schema)
        return self.data.get(key)

    def wrong(self, key: str, expected: str) -> InputError:
        """The error for a value of the wrong type or size."""
        return self.error(key, _shown(self.data.get(key)), expected)

    def number(
        self, key: str, *, above: float = -math.inf, at_least: float = -LARGEST_NUMBER, at_most: float = LARGEST_NUMBER
    ) -> float | None:
        """A number within bounds, or None where the key is missing."""
        bounds = {"exclusiveMinimum": above, "minimum": at_least, "maximum": at_most}
        value = self.get(
            key, "number", **{word: bound for word, bound in bounds.items() if abs(bound) < LARGEST_NUMBER}
        )
        if value is None:
            return None
        if not _is_number(value):
            raise self.wrong(key, "a number")
        number = float(value)  # type: ignore[arg-type]
        if not (number > above and at_least <= number <= at_most):
            raise self.wrong(key, _bounds(above, at_least, at_most))
        return number

    def vector(self, key: str, size: int | None = None, *, at_most: float = LARGEST_NUMBER) -> FloatArray | None:
        """(size,) numbers of at most that size, or None where the key is missing."""
        sizes = {"minItems": size or 1} | ({} if size is None else {"maxItems": size})
        entry = {"type": "number"} | ({"minimum": -at_most, "maximum": at_most} if at_most < LARGEST_NUMBER else {})
        value = self.get(key, "array", items=entry, **sizes)
        if value is None:
            return None
        length = "a list of" if size is None else f"a list of {size}"
        right_size = isinstance(value, list) and (len(value) == size if size is not None else len(value) > 0)
        if not right_size or not all(_is_number(entry) for entry in value):  # type: ignore[attr-defined]
            raise self.wrong(key, f"{length} numbers")
        numbers = np.array(value, dtype=np.float64)
        if np.any(np.abs(numbers) > at_most):
            raise self.wrong(key, f"{length} numbers of at most {at_most:g}")
        return numbers

    def text(self, key: str, choices: Sequence[str] = ()) -> str | None:
        """A string, one of `choices` where there are any, or None where the key is missing."""
        value = self.get(key, "string", **({"enum": [*choices]} if choices else {}))
        if value is None:
            return None
        if not isinstance(value, str):
            raise self.wrong(key, "a text in quotes")
        if choices and value not in choices:
            raise self.wrong(key, _one_of(value, choices))
        return value

    def names_of(self, key: str, choices: Sequence[str]) -> tuple[str, ...] | None:
        """Some of `choices`, or None where the key is missing."""
        some = {"enum": [*choices]}
        value = self.get(key, anyOf=[some, {"type": "array", "items": some}])
        if value is None:
            return None
        entries = value if isinstance(value, list) else [value]
        if any(entry not in choices for entry in entries):
            raise self.wrong(key, "some of " + ", ".join(f'"{choice}"' for choice in choices))
        return tuple(str(entry) for entry in entries)

    def flag(self, key: str) -> bool | None:
        """true or false, or None where the key is missing."""
        value = self.get(key, "boolean")
        if value is not None and not isinstance(value, bool):
            raise self.wrong(key, "true or false")
        return value

    def whole(self, key: str, *, at_least: int = 0, at_most: int = 2**63 - 1) -> int | None:
        """A whole number within bounds, or None where the key is missing."""
        bounds = {"minimum": at_least} | ({} if at_most == 2**63 - 1 else {"maximum": at_most})
        value = self.get(key, "integer", **bounds)
        if value is None:
            return None
        if isinstance(value, bool) or not isinstance(value, int) or not at_least <= value <= at_most:
            bound = "" if at_most == 2**63 - 1 else f" and at most {at_most}"
            raise self.wrong(key, f"a whole number of at least {at_least}{bound}")
        return value

    def table(self, key: str) -> Table:
        """A sub-table; an empty one where the key is missing."""
        value = self.get(key)
        if value is not None and not isinstance(value, dict):
            raise self.wrong(key, "a table")
        return Table(self.path, value or {}, f"{self.name}.{key}" if self.name else key, self._ask(key))

    def tables(self, key: str) -> list[Table]:
        """The tables of a list, or the one that stands in its place; none where the key is missing."""
        value = self.get(key, "array", "object")
        entries = [] if value is None else value if isinstance(value, list) else [value]
        schema = self._ask(key).setdefault("items", {})
        for k, entry in enumerate(entries, 1):
            if not isinstance(entry, dict):
                raise self.error(key, f"{_shown(entry)} as number {k}", "a table or a list of tables")
        name = f"{self.name}.{key}" if self.name else key
        return [Table(self.path, entry, f"{name} {k}", schema) for k, entry in enumerate(entries, 1)]

    def done(self) -> None:
        """Check that every key of the table was asked for.

        Raises
        ------
        InputError : names the first key that is not known, and the nearest that is
        """
        for key in self.data:
            if key not in self._known:
                raise self.error(key, "unknown key", _one_of(key, self._known))


def _add(schema: dict[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Add words to a schema, in place; a value of one more type may be of either."""
    types = [*schema.get("type", ()), *(kind for kind in more.get("type", ()) if kind not in schema.get("type", ()))]
    schema.update(more, **({"type": types} if types else {}))
    return schema


def _one_of(word: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(word.lower(), known, n=1)
    return "one of " + ", ".join(known) + (f" (perhaps `{near[0]}`)" if near else "")


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) < 1e300 if isinstance(value, int) else math.isfinite(value)


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _bounds(above: float, at_least: float, at_most: float) -> str:
    low = f"above {above:g}" if above > -math.inf else f"of at least {at_least:g}"
    return f"a number {low} and at most {at_most:g}"
