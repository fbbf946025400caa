"""The loop on a recording of either kind."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from experiments.measured.reference import Mounted, described, errors_of, reference_of
from experiments.residual_loop.flight import FlightSource
from experiments.residual_loop.source import Fit, Source
from experiments.residual_loop.trace import Score, Trace, trace
from sensors.recording import Recording


def trace_recording(
    recording: Recording, sensor: str | None = None, alpha: float = 0.01, gravity: float | None = None
) -> tuple[Source, Trace]:
    """Open a recording as a source and trace it; a flight is scored, after the decision, against what it has for that.

    Parameters
    ----------
    sensor, gravity : of poses: which sensor, and the norm its readings aim at [m/s^2]
    alpha : family-wise error
    """
    if recording.kind == "poses":
        from experiments.residual_loop.open_source import pose_source

        source = pose_source(recording, sensor, gravity)
        return source, trace(source, alpha)
    from experiments.residual_loop.open_flight import flight_source

    flight = flight_source(recording)
    truth, target = recording.truth, reference_of(recording)
    if truth is None or target is None:
        return flight, trace(flight, alpha)
    held_out = target.after(flight.held_out_from)
    result = trace(flight, alpha, score_of(flight, target), score_of(flight, held_out))
    return flight, replace(result, reference=described(truth, target))


def score_of(flight: FlightSource, target: Mounted) -> Score:
    """The errors of the filter's states, with the effects of a fit, against a reference; see `errors_of`."""

    def score(fit: Fit) -> Mapping[str, float]:
        return errors_of(target, *flight.states(fit), flight.model.translation)

    return score
