"""From a flight to the source that the loop asks: its noise levels, declared or estimated, and its filter."""

from __future__ import annotations

from experiments.residual_loop.flight import FlightSource
from sensors.recording import Recording


def flight_source(recording: Recording) -> FlightSource:
    """The source of a flight; noise that the recording does not declare is estimated from the log."""
    from calibration.noise_levels import noise_levels
    from estimator.flight_model import flight_model

    return FlightSource(recording, flight_model(recording, specs=noise_levels(recording)))
