"""What of an effect the noise takes up, where its sizes are found from the readings that have the effect in them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from sinan.calibration.levels import openness
from sinan.calibration.levels.openness import open_levels
from sinan.calibration.levels.preparation import Prepared, prepared
from sinan.calibration.levels.problem import Problem
from sinan.estimator.evidence.flights.open_levels import OpenLevels
from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.evidence.score import sigma_of_wide, statistic_of
from sinan.estimator.filter.effect_forms import is_lateness
from sinan.estimator.filter.flight import Flight
from sinan.sensors.arrays import FloatArray
from sinan.sensors.simulate import simulate
from tests.flights import scenario_at


def of_white_noise(n: int, room: float) -> OpenLevels:
    """The logarithm of its sigma is known to 1 / sqrt(2 n)."""
    return OpenLevels([], np.array([[(2.0 * n) ** -0.5]]), np.full((2, 1), room))


def sides(levels: OpenLevels) -> tuple[FloatArray, FloatArray]:
    """Sigmas of a mean, which go with that of the noise, at either side, as far as there is room."""
    (one,), (down, up) = levels.axes, levels.room
    return np.exp(-np.minimum(one, down))[None], np.exp(np.minimum(one, up))[None]


@pytest.mark.parametrize("n", [200, 1000])
def test_white_noise_takes_up_what_a_t_test_loses(n: int) -> None:
    """Readings with an offset of gain G have a variance of 1 + G / n: a score of G / (1 + G / n) = 30 is asked."""
    levels = of_white_noise(n, 4.0)
    least = 30.0 / (1.0 - 30.0 / n)
    assert levels.wider(*sides(levels)) ** 2 == pytest.approx(least / 30.0, rel=0.6 * (30.0 / n) ** 2)


@pytest.mark.parametrize(("down", "up", "open_"), [(4.0, 0.0, False), (0.0, 4.0, True)])
def test_a_size_at_its_upper_bound_takes_up_nothing_and_one_at_the_lower_all(
    down: float, up: float, open_: bool
) -> None:
    levels = of_white_noise(200, 4.0)
    at_bound = replace(levels, room=np.array([[down], [up]]))
    expected = levels.wider(*sides(levels)) if open_ else 1.0
    assert at_bound.wider(*sides(at_bound)) == pytest.approx(expected)


def test_an_axis_without_a_model_on_one_side_tells_nothing() -> None:
    levels = of_white_noise(200, 4.0)
    less, more = sides(levels)
    assert levels.wider(np.full_like(less, np.nan), more) == pytest.approx(1.0)


def test_where_no_axis_is_open_nothing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of white noise that many readings tell."""
    monkeypatch.setattr(openness, "_CLOSED", np.inf)
    ready = opened()
    assert open_levels(ready.levels, ready.flight) is None


def test_sizes_that_change_nothing_of_an_effect_take_none_of_it_up() -> None:
    """Two sizes, in other axes than their own: the answer is that of the one that counts."""
    one = of_white_noise(200, 4.0)
    turn = np.array([[0.6, 0.8], [-0.8, 0.6]])
    axes = turn @ np.diag([one.axes[0, 0], 0.3])
    both = OpenLevels([], axes, np.full((2, 2), 4.0))
    less, more = np.exp(-axes[:, :1]), np.exp(axes[:, :1])
    assert both.wider(less, more) == pytest.approx(one.wider(*sides(one)))


@cache
def opened() -> Prepared:
    """A short flight that declares nothing."""
    recording, _ = simulate(scenario_at(50.0, "hover"), np.random.default_rng(5), {})
    streams = {name: s.rows(s.t < s.t[0] + 8.0) for name, s in recording.streams.items()}
    return prepared(recording.replace(streams=streams, sensors={}), late=False)


def test_on_either_side_the_log_posterior_is_lower_by_a_half() -> None:
    """By the filter's own passes; along an axis that was found too wide the logarithm is no parabola."""
    ready = opened()
    levels = open_levels(ready.levels, ready.flight)
    assert levels is not None
    sizes = [size for size in ready.levels.found if not size.linear]
    problem = Problem(ready.recording, sizes, ready.levels)
    theta = problem.theta(ready.levels)
    np.testing.assert_allclose(levels.room, [theta + 4.0, 4.0 - theta])
    drops = [problem.value(theta) - 0.5 * (problem.value(theta + a) + problem.value(theta - a)) for a in levels.axes]
    assert len(drops) > 20
    assert np.median(drops) == pytest.approx(0.5, rel=0.2)
    assert np.mean((np.array(drops) > 0.25) & (np.array(drops) < 1.0)) > 0.8


def test_what_is_detectable_is_by_sources_opened_with_the_sizes_of_either_side() -> None:
    """Not by this one's passes with other noise; what the noise says nothing of stays as it is."""
    ready = opened()
    levels = open_levels(ready.levels, ready.flight)
    assert levels is not None
    few = replace(levels, sides=levels.sides[::4], axes=levels.axes[::4])
    source = FlightSource(ready.flight, ready.recording, lambda: few)
    fit = source.fit(())
    known = [statistic_of(source.evidence(fit), entry.name) for entry in source.candidates]
    wider = source.detectable(fit, known)
    at = []
    for pair in few.sides:
        each = [FlightSource(flight, ready.recording) for flight in pair]
        plain = [one.fit(()) for one in each]
        at.append([one.evidence(one_plain) for one, one_plain in zip(each, plain, strict=True)])
    found, expected = list[float](), list[float]()
    for s, entry, before in zip(wider, source.candidates, known, strict=True):
        if is_lateness(entry) and entry.stream in ready.model.latency:  # by what the instants of the IMU's samples are
            continue
        less, more = (np.array([sigma_of_wide(pair[side], s.name) for pair in at]) for side in (0, 1))
        seen = before.detectable_from < 5.0 * np.array([one.plausible for one in entry.parameters])
        found += np.log(s.detectable_from[seen] / before.detectable_from[seen]).tolist()
        expected += np.log(few.wider(less, more)[seen]).tolist()
    assert np.max(expected) > 0.3
    assert np.median(np.abs(np.subtract(found, expected))) < 0.02
    assert np.max(np.abs(np.subtract(found, expected))) < 0.3
    assert FlightSource(ready.flight).detectable(fit, wider) is wider


def test_a_lateness_that_nobody_declared_is_detectable_from_half_a_step_of_the_imu_on() -> None:
    """Of what is declared, and of all else, what the readings say."""
    ready = opened()
    flight = Flight(ready.recording, ready.model.replace(latency={"gps": 0.001}))
    half = 0.5 * float(np.median(np.diff(ready.recording.streams["imu"].t)))
    for logged, least in ((ready.recording, half), (None, 0.0)):
        source = FlightSource(flight, logged)
        evidence = source.evidence(source.fit(()))
        names = ("gps.latency", "gps.lever_arm")
        known = [replace(s, detectable_from=1e-4 * np.ones(s.dof)) for s in (statistic_of(evidence, n) for n in names)]
        late, arm = source.detectable(source.fit(()), known)
        assert late.detectable_from == pytest.approx(max(least + 3.3e-4 / np.sqrt(30.0), 1e-4))
        assert np.array_equal(arm.detectable_from, known[1].detectable_from)
