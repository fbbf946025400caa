"""A measured log made ready for the filter: what its magnetometer, its readings and its flight say of themselves."""

from __future__ import annotations

from dataclasses import dataclass

from calibration.compass import compass_of, corrected
from calibration.heading import with_heading
from calibration.noise_levels import NoiseFit, first_guess, fit_noise_levels
from estimator.filter import run_filter
from estimator.flight_model import FlightModel, flight_model
from estimator.journal import Journal
from sensors.recording import Recording


@dataclass(frozen=True)
class Prepared:
    """A recording, its noise levels and the model made of both."""

    recording: Recording
    noise: NoiseFit
    model: FlightModel

    def run(self) -> Journal:
        """The filter over it."""
        return run_filter(self.recording, self.model, engine="numba")


def prepared(recording: Recording) -> Prepared:
    """The same steps for every log, each only where the recording declares nothing of the kind.

    1. No magnetic field declared: hard iron, field and disturbed stretches from the log (`calibration.compass`).
    2. No magnetometer, but GPS: the first heading (`calibration.heading`).
    3. No noise declared: noise levels (`calibration.noise_levels`).
    """
    if "mag" in recording.streams and recording.environment.magnetic_field is None:
        recording = corrected(recording, compass_of(recording))
    specs, _, _ = first_guess(recording)
    recording = with_heading(recording, specs)
    noise = fit_noise_levels(recording)
    return Prepared(recording, noise, flight_model(recording, specs=noise.specs))
