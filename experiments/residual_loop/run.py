"""The loop on a recording of either kind."""

from __future__ import annotations

from experiments.residual_loop.source import Source
from experiments.residual_loop.trace import Trace, trace
from sensors.recording import Recording, Stream


def trace_recording(
    recording: Recording,
    sensor: str | None = None,
    alpha: float = 0.01,
    gravity: float | None = None,
    reference: Stream | None = None,
) -> tuple[Source, Trace]:
    """Open a recording as a source and trace it.

    Parameters
    ----------
    sensor, gravity : of poses: which sensor, and the norm its readings aim at [m/s^2]
    alpha : family-wise error
    reference : what a flight is scored against, after the decision; columns as in `truth.csv`
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
    return flight, trace(
        flight, alpha, score_against(reference, flight), score_against(reference, flight, held_out=True)
    )
