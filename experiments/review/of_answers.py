"""The review of an answer: of a trace, of an estimate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.filter.journal import Journal
from sinan.experiments.reference import Mounted, reference_of
from sinan.experiments.report.words import SENSORS
from sinan.experiments.residual_loop.traced import Traced
from sinan.experiments.review.curves import Event, Review
from sinan.experiments.review.events import fault_events, found_events, gap_events, logged_events, stretch_events
from sinan.experiments.review.flight import Flown, flight_review
from sinan.experiments.review.readings import readings_review
from sinan.sensors.recording import Recording
from sinan.sensors.window import told_from


def review_of_estimate(recording: Recording, journal: Journal, target: Mounted | None) -> Review:
    """States and innovations of a run of the filter.

    Parameters
    ----------
    recording : as it was read
    target : what it is compared with
    """
    events = [*logged_events(recording), *gap_events(recording), *fault_events(journal.notes)]
    flown = Flown(recording, journal.imu_t, journal.imu_x, journal, journal.model.translation, target, tuple(events))
    return flight_review(flown).counted_from(told_from(recording))


def review_of_trace(recording: Recording, traced: Traced, document: Mapping[str, Any]) -> Review:
    """States and innovations with what was found in the model; of poses the readings.

    Parameters
    ----------
    recording : as it was read
    document : the report
    """
    part = traced.parts[0]
    if not isinstance(part.source, FlightSource):
        review = readings_review(recording)
        found = tuple(found_events(document, review.span[1]))
        return replace(review, events=found).counted_from(told_from(recording))
    journal = part.source.journal(part.trace.final)
    t, x = part.source.states(part.trace.final)
    set_aside = [Event("refused", at, at, f"{SENSORS.get(name, name)} reading left out as wrong")
                 for name, stamps in part.source.left_out.items() for at in stamps.tolist()]  # fmt: skip
    events = [
        *logged_events(recording), *stretch_events(part.source.stretches),
        *found_events(document, float(t[-1])), *gap_events(recording), *fault_events(journal.notes), *set_aside,
    ]  # fmt: skip
    flown = Flown(recording, t, x, journal, part.source.model.translation, reference_of(recording), tuple(events))
    return flight_review(flown).counted_from(told_from(recording))
