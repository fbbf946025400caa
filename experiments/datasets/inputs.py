"""From what a user types to a recording: a path, or the name of a log of a data set."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from sinan.experiments.datasets.registry import WHOLE, Dataset, dataset_names, load_dataset
from sinan.sensors.errors import InputError, printable
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.recording import Recording
from sinan.sensors.window import WHOLE as WHOLE_LOG
from sinan.sensors.window import Span, span_words, window

#: Environment variable that names a folder with the data sets.
DATA_VARIABLE = "SINAN_DATA"
_CHECKOUT = Path(__file__).resolve().parents[2]


def resolve(text: str, map_file: Path | None = None, span: Span = WHOLE_LOG, choice: Choice = FIRST) -> Recording:
    """The recording that a command's INPUT names.

    Parameters
    ----------
    text : a path; else DATASET/FILE, or DATASET where all its files are one log, looked for in $SINAN_DATA, in
        ../shared/data beside the checkout and beside the current folder, and in the cache of `sinan fetch`; its kept
        map is applied, also where the folder of all its files is named by its path
    map_file : the map of a log that is named by its path
    span : the part of it that is asked for, in seconds after its first sample
    choice : which of several sensors of a log that describes itself

    Raises
    ------
    InputError : says what was found and what would do
    """
    from sinan.sensors.formats import open_log

    if Path(text).exists() or map_file is not None:
        return window(open_log(Path(text), map_file or kept_map_of(Path(text)), choice), span)
    path, kept = locate(text)
    return window(open_log(path, kept, choice).replace(source=text), span)


def called(text: str, recording: Recording, span: Span = WHOLE_LOG) -> str:
    """What the user calls a recording: the name of its folder; of a log, the recording's own, which is the file's; with
    the part of it that is asked for.
    """
    path = Path(text)
    folder = path if path.is_dir() else path.parent if path.name == "recording.toml" else None
    name = printable(recording.name if folder is None else folder.resolve().name)
    return name if span == WHOLE_LOG else f"{name} {span_words(span)}"


def convert(
    text: str, folder: Path, map_file: Path | None = None, force: bool = False, span: Span = WHOLE_LOG,
    choice: Choice = FIRST,
) -> Recording:  # fmt: skip
    """Write any readable log, or a part of it, as a plain recording, with what it may be scored against.

    Parameters
    ----------
    span, choice : as for `resolve`
    force : replace a recording that was written before

    Raises
    ------
    InputError : what `resolve` finds wrong; the folder is the log itself, is in use or cannot be written
    """
    from sinan.sensors.formats.plain import require_free, write_recording

    source = Path(text)
    if source.exists() and source.resolve() == Path(folder).resolve():
        raise InputError(folder, "the log itself", "another folder")
    require_free(folder, force)
    recording = resolve(text, map_file, span, choice)
    write_recording(recording, Path(folder))
    return recording


def data_roots() -> Iterator[Path]:
    """The folders in which data sets are looked for, in order."""
    named = os.environ.get(DATA_VARIABLE)
    if named:
        yield Path(named)
    yield _CHECKOUT.parent / "shared" / "data"
    yield Path.cwd().parent / "shared" / "data"
    yield cache_folder()


def cache_folder() -> Path:
    """Where `sinan fetch` keeps what it gets."""
    import pooch

    return Path(pooch.os_cache("sinan"))


def locate(text: str) -> tuple[Path, Path | None]:
    """The path of a data set's log, checked against its checksum, and the map that reads it.

    Raises
    ------
    InputError : neither a path nor a known log; the data set is not there; a file with another checksum
    """
    dataset, name = _split(text)
    log = _log_name(text, dataset, name)
    file = log.split("#")[0]
    for root in data_roots():
        path = root / dataset.folder / file
        if path.exists():
            for part in dataset.files_of(log):
                part.check(root / dataset.folder / part.name)
            return path, dataset.map_of(log)
    raise InputError(text, "not there", f"`sinan fetch {dataset.name}`, or {DATA_VARIABLE}=FOLDER of a local mirror")


def kept_map_of(path: Path) -> Path | None:
    """The kept map of a folder that is one log of a data set, where data sets are looked for; None: it is none."""
    if not path.is_dir():
        return None
    for dataset in map(load_dataset, dataset_names()):
        kept = dataset.map_of(WHOLE)
        if kept is not None and any((root / dataset.folder).resolve() == path.resolve() for root in data_roots()):
            return kept
    return None


def log_of(text: str) -> Path:
    """The log that an INPUT names, to be asked what it says of itself: a path, or one of a data set that no map reads.

    Where there is none it is the text as a path, at which nothing is.
    """
    if not Path(text).exists():
        try:
            path, kept = locate(text)
        except InputError:
            return Path(text)
        if kept is None:
            return path
    return Path(text)


def file_of(text: str) -> Path | None:
    """The file that an INPUT names, a path or a log of a data set; None: it is none, or a folder."""
    path = Path(text)
    if not path.exists():
        try:
            path, _ = locate(text)
        except InputError:
            return None
    return path if path.is_file() else None


def _split(text: str) -> tuple[Dataset, str]:
    """The data set that a text begins with, by its name or folder, and the rest of the text."""
    for name in dataset_names():
        dataset = load_dataset(name)
        for prefix in (dataset.folder, dataset.name):
            if text == prefix or text.startswith(prefix + "/"):
                return dataset, text[len(prefix) + 1 :]
    raise InputError(
        text, "no such file, folder or data set", "a log, or DATASET/FILE of " + ", ".join(dataset_names())
    )


def _log_name(text: str, dataset: Dataset, name: str) -> str:
    """The full name of a log, which may be given by its end where that is unique."""
    logs = dataset.logs()
    if name in logs:
        return name
    if not name and WHOLE in logs:
        return WHOLE
    ends = [log for log in logs if name and log.endswith("/" + name)]
    if len(ends) == 1:
        return ends[0]
    if name in dataset.files:
        raise InputError(
            text, "a file without a map: it holds nothing that a recording has", "one of " + ", ".join(logs)
        )
    raise InputError(
        text, "no log of that name" if name else "a data set", f"{dataset.name}/FILE with one of " + ", ".join(logs)
    )
