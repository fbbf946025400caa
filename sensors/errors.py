"""The one error that bad input raises: a line that names place, what was found, what was expected."""

from __future__ import annotations

from pathlib import Path

#: The longest parts of a message [characters]: a name of 5000 letters is told by its ends, a choice of names in full.
_LONGEST, _LONGEST_CHOICE = 400, 4000


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
        parts = [printable(_short(part, _LONGEST)) for part in (self.where, place, found)]
        parts.append(printable(_short(expected, _LONGEST_CHOICE)))
        at = f"{parts[0]}, {parts[1]}" if place else parts[0]
        super().__init__(f"{at}: {parts[2]}; expected {parts[3]}")

    def __reduce__(self) -> tuple[type[InputError], tuple[str, str, str, str]]:
        return type(self), (self.where, self.found, self.expected, self.place)


def with_extra(name: str) -> str:
    """How to install what an optional part needs: as the rest is, since a plain installation would hide the clone."""
    return f"pip install -e '.[{name}]' in the clone"


def printable(text: str, keep: str = "") -> str:
    """A text of a file as a terminal may see it: one line, control characters escaped as Python writes them.

    Parameters
    ----------
    keep : characters that stay as they are, such as the line ends of a text of several lines
    """
    if not keep:
        text = " ".join(text.split())
    return "".join(c if c.isprintable() or c in keep else c.encode("unicode_escape").decode("ascii") for c in text)


def _short(text: str, longest: int) -> str:
    """A text of bearable length."""
    if len(text) <= longest:
        return text
    half = longest // 2
    return f"{text[:half]} ... ({len(text)} characters) ... {text[-half:]}"
