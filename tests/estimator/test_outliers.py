"""Wrong readings among their neighbours: found where they are, and not where the noise is merely unruly."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.evidence.intervals.outliers import wrong_among
from sinan.estimator.filter.flight import Flight
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import NO_HEIGHT, Stream
from tests.estimator.analytic_flight import fly

N = 3000
#: Logarithm of the p-value at which one of a hundred hypotheses passes at one per cent.
NEEDED = float(np.log(1e-4))


def noise(kind: str, rng: np.random.Generator) -> FloatArray:
    """(N, 3) errors without a wrong reading."""
    white = rng.standard_normal((N, 3))
    if kind == "white":
        return white
    if kind == "slow besides":  # first-order Gauss-Markov, five times as large as the white part
        return white + 5.0 * np.asarray(
            lfilter([np.sqrt(1.0 - 0.99**2)], [1.0, -0.99], rng.standard_normal((N, 3)), axis=0)
        )
    if kind == "heavy tail":
        return white / np.sqrt(rng.chisquare(4.0, (N, 1)) / 4.0)
    if kind == "louder for a while":
        return white * np.where((np.arange(N) > 1000) & (np.arange(N) < 1300), 8.0, 1.0)[:, None]
    assert kind == "a step"
    return white + np.where(np.arange(N) > 1500, 30.0, 0.0)[:, None]


KINDS = ["white", "slow besides", "heavy tail", "louder for a while", "a step"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [1, 2])
def test_none_is_said_of_noise_alone(kind: str, seed: int) -> None:
    found = wrong_among(noise(kind, np.random.default_rng(seed)))
    assert found is not None
    assert found.log_p > NEEDED or len(found.row) < 3


@pytest.mark.parametrize("kind", KINDS)
def test_one_in_a_hundred_is_found_where_it_is(kind: str) -> None:
    rng = np.random.default_rng(3)
    error, wrong = noise(kind, rng), rng.choice(N, N // 100, replace=False)
    direction = rng.standard_normal((len(wrong), 3))
    off = rng.uniform(12.0, 25.0, (len(wrong), 1)) * (8.0 if kind == "louder for a while" else 1.0)
    error[wrong] += off * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    found = wrong_among(error)
    assert found is not None
    assert found.log_p < NEEDED
    assert len(np.intersect1d(found.row, wrong)) > 0.75 * len(wrong)
    assert len(np.setdiff1d(found.row, wrong)) <= 0.2 * len(wrong)
    assert found.share == len(found.row) / N


def test_none_is_said_of_one_component_with_a_heavy_tail() -> None:
    """The law that a model of found noise has of every innovation: of 1,160 streams one was named."""
    named = 0
    for seed in range(60):
        rng = np.random.default_rng([7, seed])
        found = wrong_among(rng.standard_normal((600, 1)) / np.sqrt(rng.chisquare(4.0, (600, 1)) / 4.0))
        assert found is not None
        named += found.log_p < NEEDED and len(found.row) >= 3
    assert named <= 1


def test_some_are_found_of_one_component_with_a_heavy_tail() -> None:
    rng = np.random.default_rng(5)
    error, wrong = rng.standard_normal((600, 1)) / np.sqrt(rng.chisquare(8.0, (600, 1)) / 8.0), np.arange(50, 550, 50)
    error[wrong] += rng.choice([-1.0, 1.0], (10, 1)) * rng.uniform(15.0, 25.0, (10, 1))
    found = wrong_among(error)
    assert found is not None
    assert found.log_p < NEEDED
    assert np.array_equal(np.intersect1d(found.row, wrong), wrong)
    assert len(found.row) <= 12


def test_a_disturbance_of_neighbours_is_none() -> None:
    rng = np.random.default_rng(4)
    error = rng.standard_normal((N, 1))
    for first in rng.choice(np.arange(100, N - 100, 50), 10, replace=False):
        error[first : first + 6] += 15.0
    found = wrong_among(error)
    assert found is not None
    assert len(found.row) < 3


@pytest.mark.parametrize("rows", [4, 10])
def test_a_fix_that_is_held_is_counted_once(rows: int) -> None:
    """Each fix of a moving receiver in several rows, whose errors differ as the body moves on: none is wrong by that,
    and of ten that are each counts once.
    """
    recording, _ = fly(21, duration=60.0)
    gps = recording.streams["gps"]
    wrong = np.arange(17, len(gps), 60)
    north = gps["north"].copy()
    north[wrong] += 15.0
    step = float(np.median(np.diff(gps.t))) / rows
    for column in (gps["north"], north):
        columns = {name: np.repeat(values, rows) for name, values in {**gps.columns, "north": column}.items()}
        slow = Stream((gps.t[:, None] + step * np.arange(rows)).ravel(), columns)
        logged = recording.replace(streams={**recording.streams, "gps": slow})
        found = FlightSource(Flight.of(recording), logged=logged)._wrong_among_logged["gps"]
        assert found.readings <= len(gps)
        if column is north:
            assert np.array_equal(found.row, wrong)
        else:
            assert found.log_p > NEEDED


@pytest.mark.parametrize("error", [np.zeros((200, 1)), np.arange(20.0)[:, None]])
def test_nothing_is_said_of_too_few_or_of_equal_readings(error: FloatArray) -> None:
    assert wrong_among(error) is None


def test_what_stands_for_a_height_is_no_wrong_reading() -> None:
    """One fix in four is two-dimensional: where they were counted, 47 were wrong, and none of the ten that are."""
    recording, _ = fly(21, duration=60.0)
    gps = recording.streams["gps"]
    flat, wrong = np.arange(len(gps)) % 4 == 0, np.arange(17, len(gps), 60)
    north = gps["north"].copy()
    north[wrong] += 15.0
    heights = {"down": np.where(flat, 0.0, gps["down"]), "epv": np.where(flat, 2.0 * NO_HEIGHT, 1.0)}
    fixes = Stream(gps.t, {**gps.columns, **heights, "north": north})
    recording = recording.replace(streams={**recording.streams, "gps": fixes})
    source = FlightSource(Flight.of(recording), logged=recording)
    assert np.array_equal(source._wrong_among_logged["gps"].row, wrong)
