"""Where compiled kernels are kept: beside the source, in the user's cache, in a temporary folder, or nowhere.

numba knows the first two, and ends in an error where neither can be written: an installation for many users, a
container without a home. A temporary folder is used only where it is the user's alone: what is kept in it is run.
"""

from __future__ import annotations

import os
import stat
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

#: Names a folder, for numba and for the processes that this one starts.
VARIABLE = "NUMBA_CACHE_DIR"


@cache
def kernel_cache() -> tuple[bool, str]:
    """Whether kernels can be kept, and what the user should know of it; "": nothing."""
    from numba import config

    if _can_cache():
        return True, ""
    folder = _own_temporary_folder()
    if folder is not None:
        os.environ[VARIABLE] = str(folder)
        config.reload_config()
        if _can_cache():
            return (
                True,
                f"compiled kernels are kept in {folder}: no folder of the installation or of HOME can be written",
            )
    return False, (
        "the filter is compiled anew in every run, up to a minute: no folder of the installation or of HOME can be "
        f"written; {VARIABLE}=FOLDER names another"
    )


def options() -> dict[str, Any]:
    """How kernels are compiled."""
    return {"cache": kernel_cache()[0], "nogil": True, "fastmath": {"contract"}, "error_model": "numpy"}


def _can_cache() -> bool:
    """Whether numba finds a folder for the kernels of this package."""
    from numba import njit

    def probe() -> None:
        """Nothing."""

    try:
        njit(cache=True)(probe)
    except RuntimeError:  # "cannot cache function: no locator available"
        return False
    return True


def _own_temporary_folder() -> Path | None:
    """A folder for temporary files that nobody else can write or has prepared; None: there is none."""
    user = os.getuid() if hasattr(os, "getuid") else 0  # the temporary folder of Windows is the user's own
    try:
        folder = Path(tempfile.gettempdir()) / f"sinan-kernels-{user}"
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return None
    private = stat.S_ISDIR(found.st_mode) and (os.name == "nt" or (found.st_uid == user and not found.st_mode & 0o077))
    return folder if private else None
