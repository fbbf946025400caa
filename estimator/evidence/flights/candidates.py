"""Effects that may be in a flight, and the sizes from which those are sought to which the score at zero is blind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from sinan.estimator.evidence.flights.passes import Fitted, FlightPasses
from sinan.estimator.evidence.sensitivity import candidate_streams
from sinan.estimator.evidence.source import Part
from sinan.estimator.evidence.term import covariates_vary
from sinan.estimator.filter.effect_forms import Along, Terms, with_covariates
from sinan.estimator.filter.flight import Flight
from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects import Effect, effects_for
from sinan.sensors.errors import InputError
from sinan.sensors.motion import Motion
from sinan.sensors.recording import Recording

#: What is asked against the declared field cannot be asked where the field was found from the log itself.
_OF_THE_DECLARED_FIELD = ("mag.declination", "mag.scale")


def lacks_declared_field(recording: Recording, name: str) -> bool:
    """Whether an effect of a flight is asked against a field that the recording does not declare."""
    return recording.environment.magnetic_field is None and name in _OF_THE_DECLARED_FIELD


def flight_candidates(flight: Flight, motion: Motion) -> tuple[Effect, ...]:
    """The effects that enter a stream of the run and whose covariates vary along the motion of the plain model."""
    recording, model, declared = flight.recording, flight.model, set(flight.recording.effects)
    plain, found = Along(flight, Terms(), motion), []
    for entry in effects_for("flight", candidate_streams(model)):
        if entry.name in declared or lacks_declared_field(recording, entry.name):
            continue
        if entry.stream == "level" and "gps" not in model.sensors:  # nothing sees the velocity it goes with
            continue
        if entry.name == "accel.lever_arm" and not {"gps", "base"} & set(model.sensors):  # no point has a position
            continue
        if entry.stream in model.sensors:
            along = plain.at(entry.stream)
        else:
            along = with_covariates(recording, entry.stream, motion)
        if not entry.missing(along) and covariates_vary(entry, along):
            found.append(entry)
    return tuple(found)


#: Sensors that read the same wherever the body and its instruments are.
_OF_NO_PLACE = ("mag", "zero_rate")


def places_alike(flight: Flight, candidates: Sequence[Effect]) -> tuple[frozenset[str], ...]:
    """The lever arms of accelerometer and antenna, where nothing else in the log goes with a place.

    The reference point is a choice: with both moved by r in the body no reading changes, so an accelerometer at r is an
    antenna at -r.
    """
    pair = frozenset({"accel.lever_arm", "gps.lever_arm"})
    free = flight.recording.initial.position is None and set(flight.model.sensors) <= {"gps", *_OF_NO_PLACE}
    return (pair,) if free and pair <= {entry.name for entry in candidates} else ()


def best_starts(passes: FlightPasses, fit: Fitted, part: Part, candidates: Sequence[Effect]) -> dict[str, FloatArray]:
    """By name, of each candidate that goes with the place, the likeliest of `_directions` where that is likelier than
    the fit.
    """
    found = {}
    for entry in candidates:
        if _goes_with_place(passes, entry):
            tried = [(_deviance_at(passes, fit, part, entry, beta), beta) for beta in _directions(entry)]
            deviance, beta = min(tried, key=lambda one: one[0])
            if deviance < fit.deviance:
                found[entry.name] = beta
    return found


def _goes_with_place(passes: FlightPasses, entry: Effect) -> bool:
    """Whether an effect is another one where the whole path lies elsewhere above the ground."""
    if entry.stream not in passes.flight.model.sensors:
        return False
    along = Along(passes.flight, Terms(), passes.plain_motion).at(entry.stream)
    elsewhere = replace(along, p_n=along.p_n + np.array([1.0, 1.0, 0.0]))
    return not np.allclose(entry.regressor(along), entry.regressor(elsewhere), rtol=0.0, atol=1e-6)


def _deviance_at(passes: FlightPasses, fit: Fitted, part: Part, entry: Effect, beta: FloatArray) -> float:
    """-2 log L of the fit with one more effect, of this size, the others as they are."""
    own = Terms.of([*fit.own.pairs, (entry, beta)])
    try:
        along = passes.along(own, fit.motion)
        motion = passes.follow(passes.run([], along)[0], along)
    except InputError:  # no state or covariance follows
        return np.inf
    return passes.deviance_at(own, motion, part)


def _directions(entry: Effect) -> list[FloatArray]:
    """Betas of one plausible size along every axis and diagonal."""
    signs = np.array([one for one in product((-1.0, 0.0, 1.0), repeat=entry.size) if any(one)])
    return list(signs / np.linalg.norm(signs, axis=1, keepdims=True) * entry.plausible)
