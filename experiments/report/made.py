"""What made a page: version, command and date."""

from __future__ import annotations

import hashlib
import os
import shlex
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_BLOCK = 1 << 20  # bytes read at a time


def sinan_version() -> str:
    """The version installed; of a folder that was never installed, `0+unknown`, which sorts before every release."""
    try:
        return version("sinan-nav")
    except PackageNotFoundError:
        return "0+unknown"


def command() -> str:
    """The command as it is typed."""
    name, *arguments = sys.argv
    is_module = Path(name).name == "__main__.py"  # python -m sinan
    program = "sinan" if is_module else Path(name).name
    return os.fsencode(shlex.join([program, *arguments])).decode("utf-8", "replace")


def made() -> str:
    """A line that says version, command and date."""
    return f"sinan {sinan_version()}, `{command()}`, {now()}"


def now() -> str:
    """The date."""
    return f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC"


def digest_of(path: Path) -> str:
    """SHA-256 of a file, or of a folder's files with their names."""
    total = hashlib.sha256()
    files = [path] if path.is_file() else sorted(one for one in path.rglob("*") if one.is_file())
    for file in files:
        if file != path:
            total.update(f"{file.relative_to(path)}\0{file.stat().st_size}\0".encode("utf-8", "surrogateescape"))
        with file.open("rb") as content:
            while block := content.read(_BLOCK):
                total.update(block)
    return total.hexdigest()


def checksums(inputs: Sequence[str]) -> list[dict[str, str | None]]:
    """Each log as it was named, with its SHA-256; None: it cannot be read twice, as a pipe cannot."""
    from sinan.experiments.datasets.inputs import locate

    found: list[dict[str, str | None]] = []
    for text in inputs:
        path = Path(text) if Path(text).exists() else locate(text)[0]
        whole = path.is_dir() or path.is_file()
        found.append({"log": text, "sha256": digest_of(path) if whole else None})
    return found
