"""Logs without a position: what a body that turns about a point makes of its accelerometer is no effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.estimator.evidence.flights.source import FlightSource
from sinan.experiments.residual_loop.open_flight import flight_source
from sinan.experiments.residual_loop.select import select
from sinan.experiments.scenarios import parse_effect
from sinan.sensors.simulate import simulate
from tests.flights import scenario_at


def swung(seed: int, *effects: str) -> FlightSource:
    """A log without GPS of a body that turns about a point a metre from its accelerometer."""
    shown = [parse_effect(text) for text in ("accel.lever_arm=1,0.3,0.2", *effects)]
    return flight_source(simulate(scenario_at(100.0, "no_aiding"), np.random.default_rng(seed), shown)[0])


def test_what_an_arm_imitates_is_not_named() -> None:
    assert select(swung(11)).names == ()


def test_what_it_does_not_imitate_is() -> None:
    selection = select(swung(12, "gyro.scale=0.05,-0.04,0.06"))
    assert selection.names == ("gyro.scale",)
    assert np.all(np.abs(selection.findings[0].beta - [0.05, -0.04, 0.06]) < 0.01)


def test_a_magnet_on_the_instrument_is_found_where_no_field_is_declared() -> None:
    shown = [parse_effect("mag.transient=0.5,-0.3,0.8@20:40")]
    recording, _ = simulate(scenario_at(100.0, "no_aiding"), np.random.default_rng(13), shown)
    undeclared = recording.replace(environment=replace(recording.environment, magnetic_field=None), sensors={})
    selection = select(flight_source(undeclared))
    assert selection.names[0] == "mag.transient"
    interval = selection.findings[0].term.interval
    assert interval == pytest.approx((20.0, 40.0), abs=0.5)
    assert selection.findings[0].beta == pytest.approx([0.5, -0.3, 0.8], abs=0.1)
