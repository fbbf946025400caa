"""What the commands of the measured logs say of their arguments."""

from __future__ import annotations

import sys
from collections.abc import Iterable


def usage(logs: Iterable[str], first: str = "") -> int:
    """Say on the error output what a command takes; status 2.

    Parameters
    ----------
    logs : names that there are
    first : what comes before the names
    """
    sys.stderr.write(f"usage: {first}[NAME ...] with names of {', '.join(logs)}\n")
    return 2
