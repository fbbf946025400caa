"""Measured data sets from their public origins, every file checked by its checksum."""

from __future__ import annotations

import gzip
import logging
import os
from collections.abc import Callable, Sequence
from pathlib import Path

from sinan.experiments.datasets.inputs import DATA_VARIABLE, cache_folder
from sinan.experiments.datasets.registry import DataFile, Dataset, dataset_names, load_dataset
from sinan.experiments.workers.stopping import going_on
from sinan.sensors.errors import InputError
from sinan.sensors.files import write_bytes

#: Called before each file: data set, file, how many are done, how many there are.
Progress = Callable[[str, str, int, int], None]


def fetch(names: Sequence[str] = (), progress: Progress | None = None) -> dict[str, Path]:
    """Get data sets into the cache, or check those of a local mirror.

    With $SINAN_DATA set nothing is downloaded: every file of the mirror is checked. What is in the cache already is
    checked, not downloaded again. Files that were derived from others have no public origin and are left out.

    Parameters
    ----------
    names : short names; none: all data sets
    progress : told of every file

    Returns
    -------
    The folder of each data set

    Raises
    ------
    InputError : no such data set; a file that is missing, cannot be had, or has another checksum
    """
    datasets = [load_dataset(name) for name in names or dataset_names()]
    mirror = os.environ.get(DATA_VARIABLE)
    root = Path(mirror) if mirror else cache_folder()
    jobs = [(dataset, file) for dataset in datasets for file in dataset.files.values() if mirror or file.source]
    done = 0
    with going_on(lambda: f" after {done} of {len(jobs)} files: the same command goes on"):
        for done, (dataset, file) in enumerate(jobs):
            if progress is not None:
                progress(dataset.name, file.name, done, len(jobs))
            path = root / dataset.folder / file.name
            if not mirror and not path.is_file():
                _download(dataset, file, path)
            file.check(path)
    return {dataset.name: root / dataset.folder for dataset in datasets}


def _download(dataset: Dataset, file: DataFile, path: Path) -> None:
    import pooch

    pooch.get_logger().setLevel(logging.WARNING)
    url = dataset.url(file)
    name = path.name.removesuffix(".gz") if file.packed_from else path.name
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        known = f"sha256:{file.packed_from or file.sha256}"
        got = Path(pooch.retrieve(url, known_hash=known, fname=name, path=path.parent, progressbar=False))
        if file.packed_from:
            _pack(got, path)
    except (OSError, ValueError) as error:  # no such file, another checksum, a folder that cannot be written
        if _is_offline(error):
            raise _offline(dataset, url) from None
        raise InputError(url, str(error).split("\n")[0], "the file that the registry of data sets describes") from None


def _is_offline(error: Exception) -> bool:
    """Whether it is the network that failed: the errors of requests are OSErrors, with a response if there was one."""
    ours = isinstance(error, ConnectionError | TimeoutError) or type(error).__module__.startswith("requests")
    return ours and getattr(error, "response", None) is None


def _offline(dataset: Dataset, url: str) -> InputError:
    return InputError(
        f"sinan fetch {dataset.name}",
        f"no connection to {url.split('/')[2]}",
        f"a network, or {DATA_VARIABLE}=FOLDER where FOLDER/{dataset.folder} holds the files already",
    )


def _pack(original: Path, path: Path) -> None:
    """Keep a file gzipped."""
    write_bytes(path, gzip.compress(original.read_bytes(), mtime=0))
    original.unlink()
