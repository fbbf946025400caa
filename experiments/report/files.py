"""Where a result is written: whether it can be, before the work; JSON."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path

from sinan.sensors.errors import InputError
from sinan.sensors.files import cannot_write, is_device, write_text


def require_place(path: Path) -> None:
    """Raise if a file cannot be written, before the work whose result it is to hold.

    Raises
    ------
    InputError : it is a folder; its folder cannot be made or written, or would be the second that is made
    """
    if is_device(path):
        return
    require_parent(path.parent)
    try:
        path.parent.mkdir(exist_ok=True)
    except OSError as error:
        raise cannot_write(path, error, "a file that can be written") from None
    if path.is_dir():
        raise InputError(path, "a folder", "a file that can be written")
    if not os.access(path.parent, os.W_OK):
        raise InputError(path, "a folder without permission to write", "a file that can be written")


def require_parent(folder: Path) -> None:
    """Raise unless a folder, which may have to be made, lies in one that is there: a name in a path may be mistyped.

    Raises
    ------
    InputError : it is a file, or would be the second that is made
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(folder, "a file", "a folder")
    if not folder.is_dir() and not folder.absolute().parent.is_dir():
        raise InputError(folder, f"no folder {folder.parent}", "a folder that is there, or one in such a folder")


def write_json(path: Path, document: Mapping[str, object]) -> None:
    """Write a JSON document; numbers that are not finite are an error, not `NaN`."""
    write_text(path, json.dumps(document, indent=1, allow_nan=False) + "\n")
