"""Writing a file or a folder, whole or not at all: beside its place first, then moved into it in one step.

A run that is killed leaves what was there before, and at most a hidden `.NAME.PID.part` beside it, which may be
deleted. One that fails, for want of room on the disk say, leaves what was there before and nothing else.
"""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
import stat
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TextIO

from sinan.sensors.errors import InputError

#: Errors of a disk, a quota or a limit that has no room left.
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
#: So much of a name is in that of its part [letters]: four bytes each leave room for the rest in the 255 of a name.
_NAME_KEPT = 50
#: Of Linux's fcntl.h and of macOS's sys/stdio.h.
_AT_FDCWD, _RENAME_EXCHANGE, _RENAME_SWAP = -100, 2, 2


def write_text(path: Path, text: str) -> None:
    """Write a text file, UTF-8, whole or not at all."""
    with new_file(path) as file:
        file.write(text)


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file, whole or not at all."""
    with new_file(path) as file:
        file.flush()
        file.buffer.write(content)


@contextmanager
def new_file(path: Path) -> Iterator[TextIO]:
    """A text file to be filled, UTF-8 with the line ends that are written; in its place when it is whole.

    A link is replaced, what it points to is not written. A device or a pipe is written straight.

    Raises
    ------
    InputError : it cannot be written
    """
    with _in_words(path, "a file that can be written"):
        if is_device(path):
            with path.open("w", encoding="utf-8", newline="") as file:
                yield file
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        with _moved_when_whole(_NewFile(path)) as beside, beside.open("w", encoding="utf-8", newline="") as file:
            yield file


@contextmanager
def new_folder(folder: Path, ours: Sequence[str]) -> Iterator[Path]:
    """A folder to be filled; in its place when it is whole.

    Parameters
    ----------
    folder : made where it does not exist; what else than `ours` is in it stays there
    ours : names of the files that may be written; the last is the one without which the others mean nothing

    Raises
    ------
    InputError : it cannot be written; it is to be replaced, and cannot be in one step
    """
    with _in_words(folder, "a folder that can be written"):
        new = _NewFolder(resolved(folder), ours)
        new.place.parent.mkdir(parents=True, exist_ok=True)
        with _moved_when_whole(new) as beside:
            beside.mkdir()
            yield beside


@contextmanager
def together() -> Iterator[None]:
    """What is written inside is moved into place at the end, one after the other; nothing of it after an error."""
    waiting: list[_New] = []
    before = _WAITING.set(waiting)
    try:
        yield
        for new in waiting:
            with _in_words(new.place, "a place that can be written"):
                new.prepare()
        for new in waiting:
            with _in_words(new.place, "a place that can be written"):
                new.move()
    finally:
        _WAITING.reset(before)
        for new in waiting:
            new.drop()


def is_device(path: Path) -> bool:
    """Whether a path names no file of a disk: a device, a pipe, or what `/dev` or `/proc` call an open file."""
    try:
        kind = path.stat().st_mode
    except (OSError, ValueError):
        return False
    named = path.absolute().parts[1:3]
    open_file = named[:1] in (("dev",), ("proc",)) and named[1:] != ("shm",)
    return not stat.S_ISDIR(kind) and (not stat.S_ISREG(kind) or open_file)


class _New(ABC):
    """What is written beside its place.

    Attributes
    ----------
    place : where it goes
    beside : where it is written
    """

    place: Path
    beside: Path

    @abstractmethod
    def prepare(self) -> None:
        """All that is to be done before, so that the moves of several come right after each other."""

    @abstractmethod
    def move(self) -> None:
        """Put it into its place."""

    def drop(self) -> None:
        """Remove what is still beside the place."""
        if self.beside.is_dir():
            shutil.rmtree(self.beside, ignore_errors=True)
        else:
            self.beside.unlink(missing_ok=True)


class _NewFile(_New):
    def __init__(self, place: Path) -> None:
        self.place, self.beside = place, _part(place.parent, place)

    def prepare(self) -> None:
        if self.place.is_file() and not self.place.is_symlink():
            shutil.copymode(self.place, self.beside)
            _to_disk(self.beside)

    def move(self) -> None:
        self.beside.replace(self.place)


class _NewFolder(_New):
    def __init__(self, place: Path, ours: Sequence[str]) -> None:
        self.place, self.ours = place, ours
        self.inside = place.is_dir() and not can_be_replaced(place)
        if self.inside and any(place.iterdir()):
            raise cannot_replace(place)
        self.beside = _part(place if self.inside else place.parent, place)

    def prepare(self) -> None:
        """Take over what is not ours."""
        if self.inside or not self.place.is_dir():
            return
        shutil.copymode(self.place, self.beside)
        for path in self.beside.iterdir():
            _to_disk(path)
        for entry in self.place.iterdir():
            if entry.name not in self.ours:
                _take_over(entry, self.beside / entry.name)

    def move(self) -> None:
        """Into a place that is free, or a swap: what was in the place is dropped with the part."""
        if self.inside:
            self._fill()
        elif self.place.is_dir() and any(self.place.iterdir()):
            _swap(self.beside, self.place)
        else:
            self.beside.rename(self.place)

    def _fill(self) -> None:
        """Fill an empty folder, last with the file without which the others mean nothing."""
        for name in self.ours:
            if (self.beside / name).exists():
                (self.beside / name).rename(self.place / name)


_WAITING: ContextVar[list[_New] | None] = ContextVar("waiting", default=None)


@contextmanager
def _moved_when_whole(new: _New) -> Iterator[Path]:
    """Where to write; moved into place at the end, or with the others of `together`."""
    new.drop()  # of a killed run with this process's number
    waiting = _WAITING.get()
    try:
        yield new.beside
        if waiting is None:
            new.prepare()
            new.move()
    except BaseException:
        new.drop()
        raise
    if waiting is None:
        new.drop()
    else:
        waiting[:] = [*(other for other in waiting if other.place != new.place), new]


def resolved(path: Path) -> Path:
    """The path without links.

    Raises
    ------
    InputError : a link that leads back to itself
    """
    try:
        return path.resolve()
    except RuntimeError:  # what Python says of it until 3.12
        raise InputError(path, "a link that leads to itself", "a file or a folder") from None


def can_be_replaced(folder: Path) -> bool:
    """Whether another folder can be put in the place of this one: not of the current one, of a mounted disk, or in a
    folder that cannot be written.
    """
    folder = resolved(folder)
    current = Path.cwd()
    return not (folder in (current, *current.parents) or folder.is_mount()) and os.access(folder.parent, os.W_OK)


def cannot_replace(folder: Path) -> InputError:
    """The error where `can_be_replaced` says no."""
    found = "files in the current folder, on the root of a disk, or in a folder whose parent cannot be written"
    return InputError(folder, found, "a folder that can be replaced in one step, named from outside it")


def cannot_write(path: Path | str, error: OSError, expected: str) -> InputError:
    """The error of a system that could not write, in one line."""
    expected = "more room on its disk" if error.errno in _NO_ROOM else expected
    return InputError(path, error.strerror or type(error).__name__, expected)


@contextmanager
def _in_words(path: Path, expected: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise cannot_write(path, error, expected) from None


def _part(folder: Path, place: Path) -> Path:
    return folder / f".{place.name[:_NAME_KEPT]}.{os.getpid()}.part"


def _to_disk(path: Path) -> None:
    """Wait until a file that replaces another is on the disk, not only on its way there."""
    with path.open("rb") as file:
        os.fsync(file.fileno())


def _take_over(entry: Path, place: Path) -> None:
    """A second name for a file, and for every file of a folder; a copy where the disk knows no second names."""

    def link(source: str, target: str) -> None:
        try:
            os.link(source, target, follow_symlinks=False)
        except OSError:
            shutil.copy2(source, target, follow_symlinks=False)

    if entry.is_dir() and not entry.is_symlink():
        shutil.copytree(entry, place, symlinks=True, copy_function=link)
    else:
        link(str(entry), str(place))


def _swap(one: Path, other: Path) -> None:
    """Swap two folders: in one step where the system can, else by way of a third name."""
    if _swapped_in_one_step(one, other):
        return
    third = one.with_name(f"{one.name}.old")
    other.rename(third)
    try:
        one.rename(other)
    except OSError:
        third.rename(other)
        raise
    third.rename(one)


def _swapped_in_one_step(one: Path, other: Path) -> bool:
    """Swap by a call of Linux or macOS; False where there is none, or where the disk does not know it."""
    if os.name != "posix":
        return False
    library = ctypes.CDLL(None, use_errno=True)
    paths = os.fsencode(one), os.fsencode(other)
    if hasattr(library, "renameat2"):
        failed = library.renameat2(_AT_FDCWD, paths[0], _AT_FDCWD, paths[1], _RENAME_EXCHANGE)
    elif hasattr(library, "renamex_np"):
        failed = library.renamex_np(*paths, _RENAME_SWAP)
    else:
        return False
    if not failed:
        return True
    number = ctypes.get_errno()
    if number in (errno.ENOSYS, errno.EINVAL, errno.ENOTSUP):
        return False
    raise OSError(number, os.strerror(number), str(other))
