"""Accelerations in step with the turning, which `level` neglects: the point of it, and what else looks like them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.experiments.residual_loop.flight import FlightSource
from sinan.experiments.residual_loop.flight_passes import Fitted
from sinan.experiments.residual_loop.open_flight import flight_source
from sinan.experiments.residual_loop.remaining import remaining
from sinan.experiments.residual_loop.select import select
from sinan.experiments.residual_loop.turning import (
    TurningPoint,
    turning_point,
    turning_regressor,
)
from sinan.experiments.scenarios import load_scenario, parse_effect
from sinan.sensors.simulate import simulate

ARM = np.array([0.2, -0.1, 0.05])


def found_of(seed: int, *effects: str) -> tuple[TurningPoint | None, list[str]]:
    """The point of a simulated log without position aiding, and what its residual is said to be."""
    shown = [parse_effect(text) for text in effects]
    recording, _ = simulate(load_scenario("no_aiding"), np.random.default_rng(seed), shown)
    source = flight_source(recording)
    fit = source.fit(())
    level = next(r for r in source.residuals(fit) if r.stream == "level")
    assert isinstance(fit.detail, Fitted)
    G = turning_regressor(source.recording, source.model, fit.detail.motion)
    said = [item.what for item in remaining(source, fit, (), (), 0.01) if item.stream == "level" and item.what]
    return turning_point(G, level.residual, level.row), said


def test_an_arm_is_found_and_told() -> None:
    one, said = found_of(3, f"accel.lever_arm={','.join(str(x) for x in ARM)}")
    assert one is not None
    assert one.p_value < 1e-6
    assert np.all(np.abs(one.arm - ARM) < 3.0 * one.std + 0.1 * np.abs(ARM))
    assert len(said) == 1
    assert said[0].startswith(f"{one.share:.0%} of the variance of the level")


def test_a_body_that_turns_about_its_accelerometer_is_not_told_otherwise() -> None:
    assert found_of(4)[1] == []


def test_too_few_readings_or_axes_say_nothing() -> None:
    rng = np.random.default_rng(5)
    rows = np.arange(400)
    about_x = np.zeros((400, 3, 3))
    about_x[:, 1:, 1:] = rng.standard_normal((400, 2, 2))
    assert turning_point(about_x, rng.standard_normal((400, 3)), rows) is None
    assert turning_point(rng.standard_normal((9, 3, 3)), rng.standard_normal((9, 3)), rows[:9]) is None


@pytest.mark.parametrize("seed", range(3))
def test_p_values_of_white_noise_are_no_smaller_than_chance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p = []
    for _ in range(200):
        one = turning_point(rng.standard_normal((300, 3, 3)), rng.standard_normal((300, 3)), np.arange(300))
        assert one is not None
        p.append(one.p_value)
    assert np.mean(np.array(p) < 0.05) < 0.05 + 3.3 * np.sqrt(0.05 * 0.95 / 200)


def swung(seed: int, *effects: str) -> FlightSource:
    """A log without GPS of a body that turns about a point a metre from its accelerometer."""
    shown = [parse_effect(text) for text in ("accel.lever_arm=1,0.3,0.2", *effects)]
    return flight_source(simulate(load_scenario("no_aiding"), np.random.default_rng(seed), shown)[0])


def test_what_an_arm_imitates_is_not_named() -> None:
    assert select(swung(11)).names == ()


def test_what_it_does_not_imitate_is() -> None:
    selection = select(swung(12, "gyro.scale=0.05,-0.04,0.06"))
    assert selection.names == ("gyro.scale",)
    assert np.all(np.abs(selection.findings[0].beta - [0.05, -0.04, 0.06]) < 0.01)


def test_a_magnet_on_the_instrument_is_found_where_no_field_is_declared() -> None:
    shown = [parse_effect("mag.transient=0.5,-0.3,0.8@20:40")]
    recording, _ = simulate(load_scenario("no_aiding"), np.random.default_rng(13), shown)
    undeclared = recording.replace(environment=replace(recording.environment, magnetic_field=None), sensors={})
    selection = select(flight_source(undeclared))
    assert selection.names[0] == "mag.transient"
    interval = selection.findings[0].term.interval
    assert interval == pytest.approx((20.0, 40.0), abs=0.5)
    assert selection.findings[0].beta == pytest.approx([0.5, -0.3, 0.8], abs=0.1)
