"""What made a page: version, command and date."""

from __future__ import annotations

import os
import shlex
import sys
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


def sinan_version() -> str:
    """The version installed; of a folder that was never installed, none."""
    try:
        return version("sinan-nav")
    except PackageNotFoundError:
        return "(not installed)"


def command() -> str:
    """The command as it is typed."""
    name, *arguments = sys.argv
    is_module = Path(name).name == "__main__.py"  # python -m sinan
    program = "sinan" if is_module else Path(name).name
    return os.fsencode(shlex.join([program, *arguments])).decode("utf-8", "replace")


def made() -> str:
    """A line that says version, command and date."""
    return f"sinan {sinan_version()}, `{command()}`, {datetime.now(UTC):%Y-%m-%d %H:%M} UTC"
