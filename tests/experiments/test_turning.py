"""Accelerations in step with the turning, which `level` neglects: the point of it, and what else looks like them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.experiments.residual_loop.flight import FlightSource
from sinan.experiments.residual_loop.flight_passes import Fitted
from sinan.experiments.residual_loop.onsets import Rows
from sinan.experiments.residual_loop.open_flight import flight_source
from sinan.experiments.residual_loop.remaining import remaining
from sinan.experiments.residual_loop.select import select
from sinan.experiments.residual_loop.turning import (
    IN_STEP,
    TurningPoint,
    log_p_given_turning,
    turning_point,
    turning_regressor,
)
from sinan.experiments.scenarios import load_scenario, parse_effect
from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects import effect
from sinan.sensors.motion import Motion
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


def in_a_hand(seed: int, tilt: float, push: float) -> tuple[Rows, FloatArray]:
    """Rows of an effect whose answer goes with an acceleration that `turning` has, and with one that it has not."""
    rng = np.random.default_rng(seed)
    r = 600
    turning, own = rng.standard_normal((r, 27)), rng.standard_normal((r, 2))
    shared, apart = turning @ rng.standard_normal(27) / np.sqrt(27.0), rng.standard_normal(r)
    wanted = np.stack([2.0 * shared + apart, rng.standard_normal(r)], axis=1)
    white = rng.standard_normal(r) + tilt * wanted[:, 0] + push * shared + own @ [1.0, -2.0]
    return Rows(own, wanted, white, np.full(r, "level"), np.linspace(0.0, 60.0, r)), turning


def test_an_effect_stands_beside_the_acceleration() -> None:
    rows, turning = in_a_hand(6, tilt=0.4, push=0.0)
    assert log_p_given_turning(rows, turning) < -20.0
    assert log_p_given_turning(*in_a_hand(7, tilt=0.0, push=0.0)) > -5.0


def test_an_effect_to_which_an_acceleration_has_given_its_size_does_not() -> None:
    """Half a sigma in every reading: without the acceleration in the model it is certain, p = exp(-50)."""
    rows, turning = in_a_hand(8, tilt=0.0, push=1.5)
    assert log_p_given_turning(rows, turning[:, :0]) < -50.0
    assert log_p_given_turning(rows, turning) > -5.0


def test_its_size_counts_though_what_is_left_of_it_would_pass() -> None:
    """A tilt of 0.3 that the acceleration makes one of 0.9: found, but not as large as the model would have it."""
    rows, turning = in_a_hand(9, tilt=0.3, push=1.5)
    assert log_p_given_turning(rows, turning) == 0.0


def test_in_step_has_the_acceleration_of_an_arm() -> None:
    """(w x)^2 r + (dw x) r is linear in the six products of w and in dw."""
    rng = np.random.default_rng(10)
    w, dw, r = rng.standard_normal((50, 3)), rng.standard_normal((50, 3)), np.array([0.3, -0.2, 0.1])
    motion = Motion(t=np.arange(50.0), w_ib_b=w, dw_b=dw)
    of_arm = effect("accel.lever_arm").rows(motion, 3) @ r
    columns = IN_STEP.rows(motion, 3)
    fitted = np.linalg.lstsq(columns.reshape(150, 27), of_arm.ravel(), rcond=None)[0]
    np.testing.assert_allclose(columns @ fitted, of_arm, atol=1e-9)
    np.testing.assert_allclose(of_arm, np.cross(w, np.cross(w, r)) + np.cross(dw, r), atol=1e-12)


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
