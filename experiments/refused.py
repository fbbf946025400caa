"""Streams that the filter refuses wholly or nearly: no fault does that, a wrong unit, axis or frame does."""

from __future__ import annotations

from collections.abc import Mapping

from experiments.report.words import SENSORS

#: Share of the readings that reach the gate from which on a stream is said to be refused.
NEARLY_ALL = 0.95
#: Fewer readings that reached the gate say nothing of a stream.
_LEAST = 5


def refused(counts: Mapping[str, Mapping[str, int]]) -> dict[str, str]:
    """A sentence for each stream of which the gate refused nearly all readings.

    Parameters
    ----------
    counts : readings by sensor and by what became of them, as `Journal.counts` gives them
    """
    found = {}
    for sensor, row in counts.items():
        gated, judged = row.get("gated", 0), row.get("gated", 0) + row.get("accepted", 0)
        if sensor != "level" and judged >= _LEAST and gated >= NEARLY_ALL * judged:
            found[sensor] = (
                f"the filter refused {gated} of {judged} {SENSORS.get(sensor, sensor)} readings: their unit, axis or "
                "frame is another than the recording says"
            )
    return found
