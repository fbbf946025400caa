"""The loop on a recording of either kind."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from experiments.residual_loop.flight import FlightSource
from experiments.residual_loop.source import Fit, Source
from experiments.residual_loop.trace import Score, Trace, trace
from sensors.recording import Recording, Stream


def trace_recording(
    recording: Recording,
    sensor: str | None = None,
    alpha: float = 0.01,
    gravity: float | None = None,
    reference: Stream | None = None,
    on_another_body: bool = False,
) -> tuple[Source, Trace]:
    """Open a recording as a source and trace it.

    Parameters
    ----------
    sensor, gravity : of poses: which sensor, and the norm its readings aim at [m/s^2]
    alpha : family-wise error
    reference : what a flight is scored against, after the decision; columns as in `truth.csv`
    on_another_body : its mounting and delay are found from the rates, and one constant heading is taken off
    """
    if recording.kind == "poses":
        from experiments.residual_loop.open_source import pose_source

        source = pose_source(recording, sensor, gravity)
        return source, trace(source, alpha)
    from experiments.residual_loop.open_flight import flight_source
    from experiments.residual_loop.reference import score_against

    flight = flight_source(recording)
    if reference is None:
        return flight, trace(flight, alpha)
    score = mounted_score if on_another_body else score_against
    return flight, trace(flight, alpha, score(reference, flight), score(reference, flight, held_out=True))


def mounted_score(reference: Stream, flight: FlightSource, held_out: bool = False) -> Score:
    """As `score_against`, of a reference on another body, another clock and with another north."""
    from experiments.measured.reference import in_frame, mounted
    from experiments.residual_loop.reference import score_against

    target = mounted(flight.recording, reference)

    def score(fit: Fit) -> Mapping[str, float]:
        t, x = flight.states(fit)
        t, rows = np.unique(t, return_index=True)
        return score_against(in_frame(target, t, x[rows, 6:10]), flight, held_out)(fit)

    return score
