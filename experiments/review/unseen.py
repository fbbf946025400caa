"""What a log could not show, whatever is in it: effects that need what it does not hold, and those without a trace."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sinan.experiments.report.words import SENSORS
from sinan.sensors.recording import Recording

_MOST_NAMES = 12


def not_seen(recording: Recording, document: Mapping[str, Any] | None = None) -> list[str]:
    """A sentence for each reason.

    Parameters
    ----------
    document : the report of a trace; None: nothing was traced
    """
    from sinan.experiments.commands.info import could_see

    _, missing = could_see(recording)
    found = [f"{_listed(names)}: would need {what}" for what, names in missing.items()]
    if document is None:
        return found
    blind = [one["name"] for one in document["candidates"] if one["dof"] == 0]
    if blind:
        found.append(f"{_listed(blind)}: at no size visible in this motion")
    return found + [f"the {SENSORS.get(one['sensor'], one['sensor'])} was not traced: {one['why']}"
                    for one in document["left_out"]]  # fmt: skip


def _listed(names: list[str]) -> str:
    more = len(names) - _MOST_NAMES
    return ", ".join(names[:_MOST_NAMES]) + (f" and {more} more" if more > 0 else "")
