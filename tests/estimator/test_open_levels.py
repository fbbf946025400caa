"""What of an effect the noise takes up, where its sizes are found from the readings that have the effect in them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from sinan.calibration.levels.openness import open_levels
from sinan.calibration.levels.preparation import Prepared, prepared
from sinan.calibration.levels.problem import Problem
from sinan.estimator.evidence.flights.open_levels import OpenLevels
from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.evidence.score import statistic_of
from sinan.sensors.arrays import FloatArray
from sinan.sensors.simulate import simulate
from tests.flights import scenario_at


def of_white_noise(n: int, room: float) -> OpenLevels:
    """The logarithm of its sigma is known to 1 / sqrt(2 n)."""
    return OpenLevels([], np.array([[(2.0 * n) ** -0.5]]), np.full((2, 1), room))


def sides(levels: OpenLevels) -> tuple[FloatArray, FloatArray]:
    """Sigmas of a mean, which go with that of the noise, at either side."""
    (one,) = levels.axes
    return np.exp(-one)[None], np.exp(one)[None]


@pytest.mark.parametrize("n", [200, 1000])
def test_white_noise_takes_up_what_a_t_test_loses(n: int) -> None:
    """Readings with an offset of gain G have a variance of 1 + G / n: a score of G / (1 + G / n) = 30 is asked."""
    levels = of_white_noise(n, 4.0)
    least = 30.0 / (1.0 - 30.0 / n)
    assert levels.wider(*sides(levels)) ** 2 == pytest.approx(least / 30.0, rel=0.6 * (30.0 / n) ** 2)


def test_a_size_at_its_bound_takes_up_nothing_and_one_that_is_not_seen_neither() -> None:
    levels = of_white_noise(200, 0.0)
    assert levels.wider(*sides(levels)) == pytest.approx(1.0)
    unseen = np.full((1, 1), np.inf)
    assert of_white_noise(200, 4.0).wider(unseen, unseen) == pytest.approx(1.0)


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
    few = replace(levels, sides=levels.sides[-2:], axes=levels.axes[-2:])
    source = FlightSource(ready.flight, ready.recording, few)
    fit = source.fit(())
    known = {entry.name: statistic_of(source.evidence(fit), entry.name) for entry in source.candidates}
    wider = source.detectable(fit, list(known.values()))
    at = []
    for pair in few.sides:
        each = [FlightSource(flight, ready.recording) for flight in pair]
        plain = [one.fit(()) for one in each]
        at.append([one.evidence(one_plain) for one, one_plain in zip(each, plain, strict=True)])
    ratios = []
    for s in wider:
        less, more = (np.array([statistic_of(pair[side], s.name).std for pair in at]) for side in (0, 1))
        seen = np.isfinite(s.detectable_from)
        expected = known[s.name].detectable_from * few.wider(less, more)
        ratios += (s.detectable_from[seen] / expected[seen]).tolist()
    assert len(ratios) > 20
    assert np.median(np.abs(np.log(ratios))) < 0.02
    assert np.max(np.abs(np.log(ratios))) < 0.4
    assert FlightSource(ready.flight, ready.recording).detectable(fit, wider) is wider
