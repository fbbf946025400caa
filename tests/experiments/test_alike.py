"""Names of which no log tells which it is: both are in the report, whatever the odds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.filter.flight import Flight
from sinan.experiments.report.verdict_words import says
from sinan.experiments.residual_loop.run import trace_recording
from sinan.experiments.scenarios import parse_effect
from sinan.sensors.recording import Initial, Recording
from sinan.sensors.simulate import simulate
from sinan.sensors.zero_rate import ZeroRate
from tests.experiments.test_report import a_document
from tests.flights import scenario_at

IMU_RATE = 50.0  # Hz
PLACES = frozenset({"accel.lever_arm", "gps.lever_arm"})


def flown(*effects: str, **declared: tuple[float, ...]) -> Recording:
    """A figure of eight with IMU, magnetometer and GPS; where it begins nobody says."""
    recording, _ = simulate(
        scenario_at(IMU_RATE, "figure_eight"), np.random.default_rng(3), [parse_effect(e) for e in effects]
    )
    kept = {name: recording.streams[name] for name in ("imu", "mag", "gps")}
    return recording.replace(
        streams=kept, initial=Initial(), effects={name.replace("__", "."): beta for name, beta in declared.items()}
    )


def source_of(recording: Recording) -> FlightSource:
    return FlightSource(Flight.of(recording))


def test_with_a_receiver_alone_the_places_of_antenna_and_accelerometer_are_one() -> None:
    assert source_of(flown()).alike == (PLACES,)


def test_a_body_at_rest_tells_its_gyroscope_and_no_place() -> None:
    flight = Flight.of(flown())
    at_rest = ZeroRate(np.array([1.0]), np.array([2.0]), np.full(3, 1e-3))
    sensors = {**flight.model.sensors, at_rest.name: at_rest}
    assert FlightSource(flight.believing(sensors=sensors)).alike == (PLACES,)


def test_a_height_a_first_position_or_a_declared_place_tells_them_apart() -> None:
    recording, _ = simulate(scenario_at(IMU_RATE, "figure_eight"), np.random.default_rng(3))
    for told in (
        flown().replace(streams={**flown().streams, "baro": recording.streams["baro"]}),
        flown().replace(initial=recording.initial),
        flown(gps__lever_arm=(0.3, 0.0, 0.0)),
    ):
        assert source_of(told).alike == ()


@pytest.mark.parametrize("effect", ["gps.lever_arm=0.5,0.3,-0.4", "accel.lever_arm=-0.5,-0.3,0.4"])
def test_either_place_is_told_with_the_other(effect: str) -> None:
    found = trace_recording(flown(effect)).parts[0].trace
    first, *others = found.verdict.reported
    assert {first.term.name, *first.confused_with} == PLACES
    assert not any(other.term.name in PLACES for other in others)
    assert found.verdict.word == "ambiguous"
    sign = 1.0 if first.term.name == "gps.lever_arm" else -1.0
    assert sign * first.beta == pytest.approx([0.5, 0.3, -0.4], abs=0.1)
    assert first.rivals[0].beta == pytest.approx(-first.beta, abs=0.1)
    later = replace(found.verdict, effects=(replace(found.verdict.effects[0], finding=replace(first, rivals=())),
                                            *found.verdict.effects))  # fmt: skip
    assert (later.word, later.separates) == ("ambiguous", found.verdict.separates)


def test_the_sentence_names_the_later_effect_and_its_rival() -> None:
    document: dict[str, Any] = a_document(verdict="ambiguous")
    one = document["effects"][0]
    document["effects"] = [one, {**one, "name": "gps.lever_arm", "confused_with": ["accel.lever_arm"]}]
    rest = "these data cannot tell whether gps.lever_arm is, or accel.lever_arm"
    assert says(document) == f"sonar.mount_offset is there; {rest}"
    document["effects"].insert(1, {**one, "name": "gps.latency"})
    assert says(document) == f"sonar.mount_offset and gps.latency are there; {rest}"
