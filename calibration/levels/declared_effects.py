"""The effects that a recording declares, in the model at which its sizes are sought: what is declared is no noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sinan.estimator.filter.effect_forms import (
    Along,
    declared_terms,
    low_passed_in,
    reference_motion,
    run_with_effects,
)
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import LowPass
from sinan.estimator.filter.imu import ImuSamples, imu_table
from sinan.estimator.filter.inputs import RunInputs, prepare
from sinan.estimator.filter.smoother import with_imu
from sinan.sensors.motion import Motion


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
        motion = reference_motion(journal, terms, imu_table(flight, samples))
        return cls(samples, Along(flight, terms, motion))

    def inputs(self, flight: Flight) -> RunInputs:
        """Of a pass at other levels over the same flight."""
        if self.along is None:
            return prepare(flight, imu=imu_table(flight, self.samples))
        return replace(self.along, flight=flight, motion=self._motion_of(flight)).inputs

    def _motion_of(self, flight: Flight) -> Motion:
        """The motion with force and rate as another low pass leaves them."""
        assert self.along is not None
        found, motion = self.along.flight.model.low_pass, self.along.motion
        if flight.model.low_pass == found:
            return motion
        assert found == LowPass()  # nothing takes one back
        table, both = self.along.table, (("accel", motion.f_b), ("gyro", motion.w_ib_b))
        return with_imu(motion, np.hstack([low_passed_in(flight, table, values, name) for name, values in both]))
