"""The effects that a recording declares, in the model at which its sizes are sought: what is declared is no noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

from sinan.estimator.filter.effect_forms import Along, declared_terms, reference_motion, run_with_effects
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.imu import ImuSamples, imu_table
from sinan.estimator.filter.inputs import RunInputs, prepare


@dataclass(frozen=True, eq=False)
class Readings:
    """What the filter runs on at any levels.

    Attributes
    ----------
    samples : of the IMU
    along : the effects of a flight along the motion that was found at the first levels; None where it declares none

    Neglects that other levels find another motion.
    """

    samples: ImuSamples
    along: Along | None

    @classmethod
    def of(cls, flight: Flight) -> Readings:
        """Of a flight, along the motion found with its model."""
        terms, samples = declared_terms(flight.recording), ImuSamples.of(flight.recording.streams["imu"])
        if not terms:
            return cls(samples, None)
        journal = run_with_effects(flight, terms, engine="numba", stride=0)
        motion = reference_motion(flight.recording, journal, terms, imu_table(flight, samples))
        return cls(samples, Along(flight, terms, motion))

    def inputs(self, flight: Flight) -> RunInputs:
        """Of a pass at other levels over the same flight."""
        if self.along is None:
            return prepare(flight, imu=imu_table(flight, self.samples))
        return replace(self.along, flight=flight).inputs
