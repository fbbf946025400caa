"""Which logs there are in what a user names, in an order that does not depend on the disk, and what each is called."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from sinan.experiments.report.made import digest_of
from sinan.sensors.errors import InputError
from sinan.sensors.formats import describes_itself

_NAME_KEPT = 60  # letters of a log's name in that of its page


@dataclass(frozen=True)
class Log:
    """One log.

    Attributes
    ----------
    path : as the user names it
    digest : of its content: what a report is of
    """

    path: str
    digest: str

    @property
    def name(self) -> str:
        """Of its report and its page: the log's own, without letters that a system could take for something else, and
        the digest's first ones.
        """
        own = re.sub(r"[^A-Za-z0-9_.-]+", "_", Path(self.path).name).strip(".")
        return f"{own[:_NAME_KEPT]}-{self.digest[:10]}"


def logs_in(inputs: Sequence[str], out: Path) -> list[Log]:
    """Every log of files and folders, once: two of the same content are one, the first by name.

    Parameters
    ----------
    inputs : files are taken whatever they are; of a folder the logs that need no map, in all its folders
    out : what was written before is no log

    Raises
    ------
    InputError : there is none, or no such file
    """
    paths: dict[Path, None] = {}
    for text in inputs:
        path = Path(text)
        if not path.exists():
            raise InputError(text, "no such file or folder", "logs, or folders that hold some")
        alone = not path.is_dir() or describes_itself(path)
        paths |= dict.fromkeys([path] if alone else _inside(path, out.resolve()))
    found: dict[str, Log] = {}
    for path in sorted(paths, key=in_order):
        digest = digest_of(path)
        found.setdefault(digest, Log(str(path), digest))
    if not found:
        raise InputError(" ".join(inputs), "no log that is read without a map", "logs, or folders that hold some")
    return list(found.values())


def in_order(path: Path) -> tuple[tuple[tuple[bool, int, str], ...], str]:
    """Numbers in names by their size: 9.bin before 10.bin."""
    parts = re.findall(r"\d+|\D+", str(path))
    return tuple((part.isdigit(), int(part) if part.isdigit() else 0, part) for part in parts), str(path)


def _inside(folder: Path, out: Path) -> Iterator[Path]:
    for path in sorted(folder.iterdir()):
        if path.name.startswith(".") or path.resolve() == out or path.is_symlink():
            continue
        if (path.is_file() or path.is_dir()) and describes_itself(path):
            yield path
        elif path.is_dir():
            yield from _inside(path, out)
