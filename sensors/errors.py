"""The one error that bad input raises: a line that names place, what was found, what was expected."""

from __future__ import annotations

from pathlib import Path


class InputError(ValueError):
    """Input that cannot be used. Its text is one line that says where, what was found and what would do.

    Parameters
    ----------
    where : file or argument; a `Path` is shown as given
    found : what was found there
    expected : what would have been accepted, or what to do
    place : row, byte or key inside the file
    """

    def __init__(self, where: Path | str, found: str, expected: str, place: str = "") -> None:
        self.where, self.place, self.found, self.expected = str(where), place, found, expected
        at = f"{where}, {place}" if place else f"{where}"
        super().__init__(" ".join(f"{at}: {found}; expected {expected}".split()))
