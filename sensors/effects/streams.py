"""The streams that time-localised effects enter: sizes, units, plausible sizes of a disturbance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion
from sinan.sensors.registry import BySensor, sensor
from sinan.sensors.sensor_type import Given, SensorType


@dataclass(frozen=True)
class StreamSize:
    """One stream as a disturbance sees it: components, their unit, a plausible disturbance, kinds of recording, and
    what the sensor is called in a sentence.
    """

    components: tuple[str, ...]
    unit: str
    plausible: float
    kinds: frozenset[str] = frozenset({"flight"})
    title: str = ""


def _size_of(entry: SensorType) -> StreamSize | None:
    if not entry.components:
        return None
    kinds = frozenset({"flight", "poses"} if entry.in_poses else {"flight"})
    return StreamSize(entry.components, entry.unit, entry.plausible, kinds, entry.title)


#: By sensor, as it declares them.
STREAMS = BySensor(_size_of)


def textbook_model(stream: str, size: int, motion: Motion) -> SensorModel:
    """The plain model of a stream, for effects that need its prediction at other instants; its noise is of no account.

    Parameters
    ----------
    stream : a sensor
    size : components of a reading
    motion : whose covariate `angles` holds a scan's beams
    """
    make = sensor(stream).make
    if make is None:
        raise ValueError(f"`{stream}` has no plain model without its calibration")
    angles = motion.covariates["angles"][0] if motion.has("angles") else np.zeros(1)
    return make(Given(1.0, sigma_velocity=1.0 if size == 6 else None, angles=angles))
