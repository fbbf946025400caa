"""What a log could not show, whatever is in it: effects that need what it does not hold, and those without a trace."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from sinan.experiments.report.words import SENSORS

_MOST_NAMES = 12


def not_seen(missing: Mapping[str, Sequence[str]], document: Mapping[str, Any] | None = None) -> list[str]:
    """A sentence for each reason.

    Parameters
    ----------
    missing : what is not in the log, with the effects that need it
    document : the report of a trace; None: nothing was traced
    """
    found = [f"{_listed(names)}: would need {what}" for what, names in missing.items()]
    if document is None:
        return found
    blind = [one["name"] for one in document["candidates"] if one["dof"] == 0]
    if blind:
        found.append(f"{_listed(blind)}: at no size visible in this motion")
    return found + [f"the {SENSORS.get(one['sensor'], one['sensor'])} was not traced: {one['why']}"
                    for one in document["left_out"]]  # fmt: skip


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _MOST_NAMES
    return ", ".join(names[:_MOST_NAMES]) + (f" and {more} more" if more > 0 else "")
