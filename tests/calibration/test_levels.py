"""Sizes that nobody declares, found from a simulated log whose sizes are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.calibration.levels.fit import Problem, first_levels, fit_levels, sizes_of
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.inputs import prepare
from sinan.sensors.bounds import Bounds
from sinan.sensors.noise import colour, random_walk
from sinan.sensors.recording import POSITION, Recording, Stream
from tests.estimator.analytic_flight import fly

#: A size from a minute of readings.
FACTOR = 1.6
COLOUR_STD, COLOUR_TIME, LATE = 0.8, 2.0, 0.15


@pytest.fixture(scope="module")
def bare() -> Recording:
    """A minute without any declared noise, whose GPS has colour and is late."""
    recording, _ = fly(21, duration=60.0, sensors=("gps", "mag", "baro"))
    gps = recording.streams["gps"]
    error = random_walk(gps.t, colour("c_gps", 3, COLOUR_STD, COLOUR_TIME), np.random.default_rng(5))
    columns = {**gps.columns, **{name: gps[name] + error[:, k] for k, name in enumerate(POSITION)}}
    late = Stream(gps.t + LATE, columns)
    return recording.replace(sensors={}, streams={**recording.streams, "gps": late})


def test_colour_and_delay_of_a_gps_are_found(bare: Recording) -> None:
    levels = fit_levels(bare, bare.environment.magnetic_field)
    assert levels.latency["gps"] == pytest.approx(LATE, abs=0.02)
    assert 1.0 / FACTOR < levels.specs["gps"].colour_std / COLOUR_STD < FACTOR
    assert 1.0 / FACTOR**2 < levels.specs["gps"].colour_time / COLOUR_TIME < FACTOR**2


def test_the_gradient_is_that_of_the_posterior(bare: Recording) -> None:
    """Along a direction that moves every size, about a point that is not the start."""
    sizes = sizes_of(bare)
    problem = Problem(bare, sizes, first_levels(bare, sizes, bare.environment.magnetic_field, None))
    rng = np.random.default_rng(3)
    theta, direction = problem.maximise(np.zeros(len(sizes)), 4)[0], rng.normal(size=len(sizes))
    _, gradient = problem.value_and_gradient(theta + 0.2 * direction)
    ends = [problem.value(theta + (0.2 + step) * direction) for step in (0.02, -0.02)]
    assert gradient @ direction == pytest.approx((ends[0] - ends[1]) / 0.04, rel=0.1)


def test_what_is_declared_stays(bare: Recording) -> None:
    declared, _ = fly(21, duration=10.0, sensors=("gps", "mag", "baro"))
    assert not sizes_of(declared)
    partly = bare.replace(sensors={"baro": declared.spec("baro")})
    asked = {(size.sensor, size.key) for size in sizes_of(partly)}
    assert not any(sensor == "baro" for sensor, _ in asked)
    assert ("gps", "colour_std") in asked


def test_bounds_are_as_wide_as_the_motion_needs() -> None:
    """A flight of tens of metres without position is not held to a hand's place."""
    recording, _ = fly(23, duration=30.0, sensors=("mag",))
    bare = recording.replace(sensors={})
    levels = fit_levels(bare, recording.environment.magnetic_field)
    assert levels.bounds is not None
    held = replace(levels, bounds=Bounds(0.05, 0.1))
    journals = [run(prepare(bare, one.model(bare)), "numba", 0) for one in (levels, held)]
    assert journals[0].nis_per_dof()["place"] < 2.0 < journals[1].nis_per_dof()["place"]
