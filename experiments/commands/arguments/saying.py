"""What every command does around its work: files that it may write, effects of the user's own, what it prints."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from sinan.sensors.formats.choice import Choice


def say(work: Callable[[], str], json: Path | None, html: Path | None, **written: Path | None) -> None:
    """Work whose files have a place to go, and go there together at its end; then the result, and every file."""
    from sinan.sensors.files import together

    def whole() -> str:
        with together():
            return work()

    say_as_kept(whole, json, html, **written)


def say_as_kept(work: Callable[[], str], json: Path | None, html: Path | None, **written: Path | None) -> None:
    """The same of work that keeps what is finished as it goes."""
    from sinan.experiments.report.files import require_place

    files = {what: path for what, path in {**written, "JSON": json, "page": html}.items() if path is not None}
    for path in files.values():
        require_place(path)
    show(work())
    for what, path in files.items():
        show(f"{what}: {path}")


def show(text: str) -> None:
    """Print what may hold names out of a file, without the control characters that they may have."""
    from sinan.sensors.errors import printable

    typer.echo(printable(text, keep="\n\t"))


def know(files: list[Path] | None) -> None:
    """Read effects of the user's own, for this process and its workers."""
    if files:
        from sinan.sensors.effects.own import read_file

        for file in files:
            read_file(file)


def choice_of(imu: int, mag: int, baro: int, gps: int, raw: bool, boot: int = 0) -> Choice:
    """Which of several sensors of a log are read."""
    from sinan.sensors.formats.choice import Choice

    return Choice(imu, mag, baro, gps, raw, boot)


def require_place_for(folder: Path | None) -> None:
    """A folder that is written to lies in one that is there, or in one that is made with it."""
    from sinan.experiments.report.files import require_parent
    from sinan.sensors.errors import InputError

    if folder is not None:
        require_parent(folder.parent)
        if folder.exists() and not folder.is_dir():  # a name that no folder can have is an error here, too
            raise InputError(folder, "a file", "a folder: a new one, or one that is there")
        folder.parent.mkdir(exist_ok=True)
        if not os.access(folder if folder.is_dir() else folder.parent, os.W_OK):
            raise InputError(folder, "no permission to write there", "a folder that can be written")
