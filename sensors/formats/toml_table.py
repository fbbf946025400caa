"""A TOML table whose every key is checked: wrong types and unknown keys become one-line errors that name the key."""

from __future__ import annotations

import difflib
import math
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from sensors.arrays import FloatArray
from sensors.errors import InputError


def load_toml(path: Path) -> Table:
    """The top-level table of a TOML file.

    Raises
    ------
    InputError : no such file, not UTF-8, not TOML (names the line)
    """
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(path, f"byte 0x{error.object[error.start]:02x}", "UTF-8 text", f"byte {error.start}") from None
    except OSError as error:
        raise InputError(path, error.strerror or type(error).__name__, "a readable TOML file") from None
    try:
        return Table(path, tomllib.loads(text))
    except (tomllib.TOMLDecodeError, ValueError, RecursionError) as error:
        raise InputError(path, str(error), "TOML") from None


class Table:
    """One table of a TOML file. What was asked for is known; `done` names the first key that nobody asked for.

    Parameters
    ----------
    path : of the file, for messages
    data : the parsed table
    name : dotted name of the table, empty at the top level
    """

    def __init__(self, path: Path | str, data: Mapping[str, object], name: str = "") -> None:
        self.path, self.data, self.name = path, data, name
        self._known: list[str] = []

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

    def _ask(self, key: str) -> None:
        if key not in self._known:
            self._known.append(key)

    def get(self, key: str) -> object:
        """The raw value, or None."""
        self._ask(key)
        return self.data.get(key)

    def wrong(self, key: str, expected: str) -> InputError:
        """The error for a value of the wrong type or size."""
        return self.error(key, _shown(self.data.get(key)), expected)

    def number(
        self, key: str, *, above: float = -math.inf, at_least: float = -math.inf, at_most: float = math.inf
    ) -> float | None:
        """A finite number within bounds, or None where the key is missing."""
        value = self.get(key)
        if value is None:
            return None
        if not _is_number(value):
            raise self.wrong(key, "a number")
        number = float(value)  # type: ignore[arg-type]
        if not (number > above and at_least <= number <= at_most):
            raise self.wrong(key, _bounds(above, at_least, at_most))
        return number

    def vector(self, key: str, size: int | None = None) -> FloatArray | None:
        """(size,) finite numbers, or None where the key is missing."""
        value = self.get(key)
        if value is None:
            return None
        length = "a list of" if size is None else f"a list of {size}"
        right_size = isinstance(value, list) and (len(value) == size if size is not None else len(value) > 0)
        if not right_size or not all(_is_number(entry) for entry in value):  # type: ignore[attr-defined]
            raise self.wrong(key, f"{length} numbers")
        return np.array(value, dtype=np.float64)

    def text(self, key: str, choices: Sequence[str] = ()) -> str | None:
        """A string, one of `choices` where there are any, or None where the key is missing."""
        value = self.get(key)
        if value is None:
            return None
        if not isinstance(value, str):
            raise self.wrong(key, "a text in quotes")
        if choices and value not in choices:
            raise self.wrong(key, _one_of(value, choices))
        return value

    def flag(self, key: str) -> bool | None:
        """true or false, or None where the key is missing."""
        value = self.get(key)
        if value is not None and not isinstance(value, bool):
            raise self.wrong(key, "true or false")
        return value

    def whole(self, key: str, *, at_least: int = 0) -> int | None:
        """A whole number, or None where the key is missing."""
        value = self.get(key)
        if value is None:
            return None
        if isinstance(value, bool) or not isinstance(value, int) or not at_least <= value < 2**63:
            raise self.wrong(key, f"a whole number of at least {at_least}")
        return value

    def table(self, key: str) -> Table:
        """A sub-table; an empty one where the key is missing."""
        value = self.get(key)
        if value is not None and not isinstance(value, dict):
            raise self.wrong(key, "a table")
        return Table(self.path, value or {}, f"{self.name}.{key}" if self.name else key)

    def done(self) -> None:
        """Check that every key of the table was asked for.

        Raises
        ------
        InputError : names the first key that is not known, and the nearest that is
        """
        for key in self.data:
            if key not in self._known:
                raise self.error(key, "unknown key", _one_of(key, self._known))


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
    low = f"above {above:g}" if above > -math.inf else f"at least {at_least:g}" if at_least > -math.inf else ""
    high = f"at most {at_most:g}" if at_most < math.inf else ""
    return "a number " + " and ".join(bound for bound in (low, high) if bound)
