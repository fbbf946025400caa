"""`sinan lab begin` and `sinan lab check`: a student's lab on disk, and what its answers are worth."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from sinan.experiments.report.files import require_place
from sinan.experiments.student_labs import TITLES, files
from sinan.experiments.student_labs.lab import Language
from sinan.sensors.errors import InputError


def begin(name: str | None, student: str, out: Path, kind: files.Kind, secret: str, key: Path | None) -> str:
    """Write a student's lab; return what was written.

    Raises
    ------
    InputError : no lab or no student is named, or a file cannot be written
    """
    if key is not None:
        require_place(key)
    return files.begin(_named(name), student, out, kind, secret, key)


def check(
    name: str | None, answer: Path | None, language: Language, student: str, secret: str, say: Callable[[str], None]
) -> bool:
    """Say what is right in an answer, with a hint for what is not; return whether all of it is.

    Raises
    ------
    InputError : no lab or no answer is named, or a file cannot be read
    """
    lab = _named(name)
    if answer is None:
        raise InputError("lab check", "no answer", f"sinan lab check {lab} answer.json")
    if secret and not student.strip():
        raise InputError("--student", "no name", "whose answer it is")
    text, right = files.check_file(lab, answer, language, student, secret)
    say(text)
    return right


def _named(name: str | None) -> str:
    if name is None:
        raise InputError("lab", "no lab for students named", "one of " + ", ".join(TITLES))
    return name
