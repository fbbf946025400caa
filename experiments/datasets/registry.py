"""What is known of each data set: its public origin at a commit, licence, checksums, and the map of each log."""

from __future__ import annotations

import gzip
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path, PurePosixPath
from urllib.parse import quote

from sinan.sensors.errors import InputError
from sinan.sensors.formats.map_file import read_map
from sinan.sensors.formats.toml_table import Table, load_toml

HERE = Path(__file__).parent
#: Name of a log that is all files of a data set.
WHOLE = "."
_CHUNK = 2**20


@dataclass(frozen=True)
class DataFile:
    """One file of a data set.

    Attributes
    ----------
    name : path inside the data set's folder
    size : bytes
    sha256 : of the file as it is kept
    source : path inside the origin's repository; empty: derived, and not to be had from there
    packed_from : where the file is kept gzipped, the sha256 of the original; else empty
    """

    name: str
    size: int
    sha256: str
    source: str = ""
    packed_from: str = ""

    def check(self, path: Path) -> None:
        """Check a file against the registry: its checksum, of the unfolded content where it is kept gzipped.

        Raises
        ------
        InputError : no such file; another checksum
        """
        if not path.is_file():
            raise InputError(path, "no such file", f"{self.size} bytes, as the registry of data sets says")
        expected = self.packed_from or self.sha256
        try:
            found = _digest(path, bool(self.packed_from))
        except (OSError, EOFError) as error:
            raise InputError(path, f"{type(error).__name__}: {error}", "an undamaged file") from None
        if found != expected:
            raise InputError(path, f"sha256 {found[:16]}...", f"{expected[:16]}..., as the registry of data sets says")


@dataclass(frozen=True)
class Dataset:
    """One data set.

    Attributes
    ----------
    name : short name
    folder : where it lies inside a data folder; ends with the name
    title, licence, citation : as its makers want them
    repository, commit : public origin
    files : by name
    maps : map file by pattern of log names; a name with `#variant` reads the same log in another way, `.` is the whole
        folder as one log
    """

    name: str
    folder: str
    title: str
    repository: str
    commit: str
    licence: str
    citation: str
    files: Mapping[str, DataFile]
    maps: Mapping[str, Path]

    def url(self, file: DataFile) -> str:
        """Where a file is published."""
        raw = self.repository.replace("https://github.com/", "https://raw.githubusercontent.com/")
        return f"{raw}/{self.commit}/{quote(file.source)}"

    def map_of(self, log: str) -> Path | None:
        """The map that reads a log; None: it is read by its content."""
        for pattern, path in self.maps.items():
            if len(pattern.split("/")) == len(log.split("/")) and fnmatchcase(log, pattern):
                return path
        return None

    def logs(self) -> tuple[str, ...]:
        """The names of everything that can be read: files, folders of one recording, variants."""
        folders = {name.rsplit("/", 1)[0] for name in self.files if "/" in name}
        variants = {pattern for pattern in self.maps if "#" in pattern or pattern == WHOLE}
        names = {*self.files, *folders, *variants}
        return tuple(sorted(name for name in names if self.map_of(name) or name.endswith(".ulg")))

    def files_of(self, log: str) -> tuple[DataFile, ...]:
        """The files that a log is, holds, or that its map reads beside it."""
        kept, file = self.map_of(log), log.split("#")[0]
        beside = set[str]()
        if kept is not None:
            read = {options.path for options in read_map(kept).files.values()}
            beside = {str(PurePosixPath(file).parent / path) for path in read if path}
        return tuple(
            one
            for name, one in self.files.items()
            if name in (file, *beside) or file == WHOLE or name.startswith(file + "/")
        )


@cache
def dataset_names() -> tuple[str, ...]:
    """The short names of all data sets."""
    return tuple(sorted(path.parent.name for path in HERE.glob("*/dataset.toml")))


@cache
def load_dataset(name: str) -> Dataset:
    """A data set by its short name.

    Raises
    ------
    InputError : no such data set
    """
    if name not in dataset_names():
        raise InputError(name, "no such data set", "one of " + ", ".join(dataset_names()))
    return dataset_of(load_toml(HERE / name / "dataset.toml"), name)


def dataset_of(table: Table, name: str) -> Dataset:
    """The data set that a `dataset.toml` describes.

    Raises
    ------
    InputError : names the key, what was found, what was expected
    """
    files, maps = table.table("files"), table.table("maps")
    dataset = Dataset(
        name=name,
        folder=table.text("folder") or name,
        title=table.text("title") or name,
        repository=table.text("repository") or "",
        commit=table.text("commit") or "",
        licence=table.text("licence") or "",
        citation=table.text("citation") or "",
        files={file: _data_file(file, files.table(file)) for file in files.names()},
        maps={pattern: HERE / name / (maps.text(pattern) or "") for pattern in maps.names()},
    )
    table.done()
    return dataset


def _data_file(name: str, table: Table) -> DataFile:
    file = DataFile(
        name, table.whole("bytes") or 0, table.text("sha256") or "", table.text("source") or "",
        table.text("packed_from") or "",
    )  # fmt: skip
    table.done()
    return file


def _digest(path: Path, unfold: bool) -> str:
    digest = hashlib.sha256()
    with gzip.open(path) if unfold else path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            digest.update(chunk)
    return digest.hexdigest()
