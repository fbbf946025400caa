"""The effects that a recording declares, in the model at which its sizes are sought: what is declared is no noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

from sinan.estimator.filter.effect_forms import Along, declared_terms, reference_motion, run_with_effects
from sinan.estimator.filter.flight_model import FlightModel
from sinan.estimator.filter.imu import imu_table
from sinan.estimator.filter.inputs import RunInputs, prepare
from sinan.sensors.recording import Recording


@dataclass(frozen=True, eq=False)
class Readings:
    """What the filter runs on at any levels.

    Attributes
    ----------
    recording : of a flight
    along : its effects along the motion that was found at the first levels; None where it declares none

    Neglects that other levels find another motion.
    """

    recording: Recording
    along: Along | None

    @classmethod
    def of(cls, recording: Recording, model: FlightModel) -> Readings:
        """Of a recording, along the motion found with a model."""
        terms = declared_terms(recording)
        if not terms:
            return cls(recording, None)
        journal = run_with_effects(recording, model, terms, engine="numba", stride=0)
        motion = reference_motion(recording, journal, terms, imu_table(recording, model))
        return cls(recording, Along(recording, model, terms, motion))

    def inputs(self, model: FlightModel) -> RunInputs:
        """Of a pass at other levels."""
        if self.along is None:
            return prepare(self.recording, model)
        return replace(self.along, model=model).inputs
