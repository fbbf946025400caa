"""The loop on a recording of either kind."""

from __future__ import annotations

from collections.abc import Mapping

from sinan.estimator.evidence.alpha import ALPHA
from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.evidence.source import Fit
from sinan.experiments.reference import Mounted, described, errors_of, reference_of, told_of
from sinan.experiments.residual_loop.trace import trace
from sinan.experiments.residual_loop.traced import Part, Traced
from sinan.experiments.residual_loop.verdict import Score, Scores
from sinan.sensors.recording import Recording


def trace_recording(
    recording: Recording, sensor: str | None = None, alpha: float = ALPHA, gravity: float | None = None
) -> Traced:
    """Open a recording as a source, or several, and trace it; a flight is scored, after the decision, against what it
    has for that.

    Parameters
    ----------
    sensor, gravity : of poses: which sensor, else all; and the norm that an accelerometer's readings aim at [m/s^2]
    alpha : family-wise error
    """
    if recording.kind == "poses":
        return trace_poses(recording, sensor, alpha, gravity)
    from sinan.experiments.residual_loop.open_flight import flight_source

    flight = flight_source(recording)
    truth, target = recording.truth, reference_of(recording)
    if truth is None or target is None:
        return Traced.alone(flight, trace(flight, alpha))
    held_out = target.after(flight.held_out_from)
    scores = Scores(score_of(flight, target), score_of(flight, held_out), described(truth, target))
    return Traced.alone(flight, trace(flight, alpha, scores))


def trace_poses(recording: Recording, sensor: str | None, alpha: float, gravity: float | None) -> Traced:
    """Trace one sensor of poses, or all: their models share no parameter, so each is traced by itself, and its share of
    the family-wise error is that of its candidates. What has no plain model is left out, and the reason kept.

    Raises
    ------
    InputError : no sensor can be traced
    """
    from sinan.experiments.residual_loop.open_source import of_each_sensor, pose_source, sensors_asked_for

    def traced(name: str) -> Part:
        source = sources[name]
        return Part(source, trace(source, alpha * source.families / families), name)

    asked_for = sensors_asked_for(recording, sensor)
    sources, left_out = of_each_sensor(recording, asked_for, lambda name: pose_source(recording, name, gravity))
    families = sum(source.families for source in sources.values())
    parts, more = of_each_sensor(recording, sources, traced)
    return Traced(alpha, tuple(parts.values()), tuple((left_out | more).items()))


def score_of(flight: FlightSource, target: Mounted) -> Score:
    """The errors of the filter's states, with the effects of a fit, against a reference; see `errors_of`."""

    def score(fit: Fit) -> Mapping[str, float]:
        return errors_of(target, *flight.states(fit), *told_of(flight.model))

    return score
