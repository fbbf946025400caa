"""What the last digit of a log hides: found from the readings, also where an effect moves them."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.sensors.formats.geodetic import geodetic_columns, ned_columns
from sinan.sensors.last_digit import last_digit, rounding_variance
from sinan.sensors.recording import POSITION
from sinan.sensors.rounding import rounding_of_places

#: Length of a degree of the meridian on WGS-84 at the equator and at the poles [m]; at 45 deg it is between them.
DEGREE = (110574.0, 111694.0)


def walk(n: int = 2000, std: float = 0.05, seed: int = 3) -> np.ndarray:
    """A random walk (n,), in steps smaller than the digits that are tried."""
    return np.cumsum(np.random.default_rng(seed).standard_normal(n)) * std


@pytest.mark.parametrize("step", [0.1, 0.01, 1.0 / 16.0])
def test_the_step_of_rounded_readings_is_found(step: float) -> None:
    assert last_digit(np.round(walk() / step) * step) == pytest.approx(step)


def test_the_step_is_found_where_an_offset_or_a_scale_is_put_in() -> None:
    rounded = np.round(walk(), 1)
    moved = rounded.copy()
    moved[1300:] += 0.437
    assert last_digit(moved) == pytest.approx(0.1)
    assert last_digit(1.03 * rounded) == pytest.approx(0.103)


def test_readings_with_digits_enough_have_next_to_none() -> None:
    values = walk()
    assert last_digit(values) < 1e-3 * np.std(np.diff(values))
    assert last_digit(values[:60]) < 0.2 * np.std(np.diff(values))
    assert last_digit(np.full(500, 3.0)) == 0.0
    assert last_digit(np.zeros(0)) == 0.0


def test_the_variance_is_that_of_the_error_of_rounding() -> None:
    values = np.column_stack([walk(std=0.3), walk(std=0.3, seed=4)])
    rounded = np.column_stack([np.round(values[:, 0], 1), np.round(values[:, 1] / 0.5) * 0.5])
    assert rounding_variance(rounded) == pytest.approx(np.var(rounded - values, axis=0), rel=0.1)


def test_digits_of_a_degree_are_metres_north_and_east() -> None:
    origin = (60.0, 25.0, 30.0)
    ned = np.column_stack([100.0 * walk(seed=5), 100.0 * walk(seed=6), walk(seed=7)])
    lla = geodetic_columns(ned, origin)
    lla[:, :2] = np.round(lla[:, :2], 5)
    columns = ned_columns(lla, origin)
    north, east, down = np.sqrt(12.0 * rounding_of_places(np.column_stack([columns[a] for a in POSITION]), origin))
    assert DEGREE[0] < 1e5 * north < DEGREE[1]
    assert 1e5 * east / np.cos(np.deg2rad(60.0)) == pytest.approx(DEGREE[1], rel=2e-3)
    assert down < 1e-3


def test_an_angle_that_never_changes_has_the_digits_of_the_other() -> None:
    origin = (-37.87, 144.676, 0.0)
    ned = np.column_stack([walk(seed=5), np.zeros(len(walk())), walk(seed=7)])
    lla = geodetic_columns(ned, origin)
    lla[:, :2] = np.round(lla[:, :2], 6)
    columns = ned_columns(lla, origin)
    places = np.column_stack([columns[a] for a in POSITION])
    assert len(np.unique(lla[:, 1])) == 1
    north, east, _ = np.sqrt(12.0 * rounding_of_places(places, origin))
    assert DEGREE[0] < 1e6 * north < DEGREE[1]
    assert 1e6 * east / np.cos(np.deg2rad(37.87)) == pytest.approx(DEGREE[1], rel=3e-3)
