"""Streams that the filter hardly believes, or not at all: a wrong unit, axis, frame or start does that, no fault."""

from __future__ import annotations

from collections.abc import Mapping

from sinan.experiments.report.words import SENSORS
from sinan.sensors.bounds import ASSUMED

#: Share of a stream's readings from which on it is said to be refused.
NEARLY_ALL = 0.95


def refused(shares: Mapping[str, float]) -> dict[str, str]:
    """A sentence for each stream of which the filter believes hardly a reading; what is assumed is no stream.

    A filter that starts with a wrong attitude is lost as well, and then most positions do not fit its motion.
    """
    return {
        sensor: f"the filter believes {_few(share)} of the {SENSORS.get(sensor, sensor)} readings: their unit, axis or "
        "frame is another than the recording says, or the first attitude is wrong (try a later --from)"
        for sensor, share in shares.items()
        if share >= NEARLY_ALL and sensor not in ASSUMED
    }


def _few(share: float) -> str:
    return "none" if share == 1.0 else f"{100.0 * (1.0 - share):.2g} %"
