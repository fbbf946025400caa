"""`Flight`: what was logged and what is believed of it, together. Whatever runs the filter takes one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol, Unpack

from sinan.estimator.filter.flight_model import Beliefs, FlightModel, flight_model
from sinan.sensors.arrays import FloatArray
from sinan.sensors.bounds import Bounds
from sinan.sensors.level import Level
from sinan.sensors.recording import Recording, SensorSpec
from sinan.sensors.zero_rate import ZeroRate


class Passed(Beliefs, total=False):
    """What `flight_model` takes besides the recording."""

    specs: Mapping[str, SensorSpec] | None
    use: Iterable[str] | None
    level: Level | None
    bounds: Bounds | None
    magnetic_field: FloatArray | None
    field: FloatArray | None
    zero_rate: ZeroRate | None
    axes_std: float
    turned_std: float
    lead: float


@dataclass(frozen=True, eq=False)
class Flight:
    """A flight opened for the filter.

    Attributes
    ----------
    recording : the readings
    model : of it, from `flight_model`
    """

    recording: Recording
    model: FlightModel

    @classmethod
    def of(cls, recording: Recording, **passed: Unpack[Passed]) -> Flight:
        """A recording with the model of what it declares, completed by what is passed: see `flight_model`."""
        return cls(recording, flight_model(recording, **passed))

    @property
    def where(self) -> str:
        """What errors call the recording."""
        return self.recording.where

    def believing(self, **changes: object) -> Flight:
        """The same readings; some attributes of the model changed."""
        return replace(self, model=self.model.replace(**changes))

    def reading(self, recording: Recording) -> Flight:
        """The same model, of other readings."""
        return replace(self, recording=recording)


class HasFlight(Protocol):
    """Anything with a flight."""

    @property
    def flight(self) -> Flight:
        """The flight."""


class OfFlight:
    """What is made of one flight, whose readings and model it has by their own names."""

    @property
    def recording(self: HasFlight) -> Recording:
        """The flight's readings."""
        return self.flight.recording

    @property
    def model(self: HasFlight) -> FlightModel:
        """Of the flight."""
        return self.flight.model
