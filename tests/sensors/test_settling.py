"""A receiver's first fixes may be anywhere; what comes after them says so."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from sinan.sensors.arrays import FloatArray
from sinan.sensors.formats.geodetic import geodetic_columns, to_ned
from sinan.sensors.recording import GEODETIC, VELOCITY, Stream
from sinan.sensors.settling import unsettled


def circles(rate: float = 5.0, n: int = 200) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Stamps, places and velocities of fixes in circles of 30 m at 6 m/s, good to decimetres."""
    rng, t = np.random.default_rng(3), np.arange(n) / rate
    angle = 0.2 * t
    p = 30.0 * np.stack([np.sin(angle), -np.cos(angle), 0.0 * t], axis=-1)
    v = 6.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * t], axis=-1)
    return t, p + 0.3 * rng.standard_normal(p.shape), v + 0.05 * rng.standard_normal(v.shape)


@pytest.mark.parametrize("rate", [1.0, 5.0])
@pytest.mark.parametrize("far", [500.0, 5e6])
@pytest.mark.parametrize("count", [1, 3, 20])
def test_the_first_fixes_elsewhere_are_counted(count: int, far: float, rate: float) -> None:
    t, p, v = circles(rate)
    p[:count, 0] += far * np.arange(1, count + 1)[::-1] ** 0.5
    assert unsettled(t, p, v) == count


def test_without_velocities_what_no_aircraft_flies_is_out() -> None:
    t, p, _ = circles()
    p[:2] += 5e6
    assert unsettled(t, p) == 2


def test_a_height_far_off_is_out_and_a_height_that_nobody_tells_is_no_step() -> None:
    t, p, v = circles()
    heights = np.full((len(t), 1), 120.0)
    assert unsettled(t, heights + np.where(t < 0.1, -1000.0, 0.0)[:, None]) == 1
    p[::2, 2] = np.nan
    assert unsettled(t, p, v) == 0


def glitch(p: FloatArray) -> None:
    p[40:60] += 200.0


def converged(p: FloatArray) -> None:
    p[:60] += 2.0


def mostly_elsewhere(p: FloatArray) -> None:
    p[:120] += 500.0


def one_wild_fix(p: FloatArray) -> None:
    p[30] += 1e5


@pytest.mark.parametrize("of", [glitch, converged, mostly_elsewhere, one_wild_fix])
def test_what_comes_back_what_is_small_and_what_is_the_most_stays(of: Callable[[FloatArray], None]) -> None:
    t, p, v = circles()
    of(p)
    assert unsettled(t, p, v) == 0


@pytest.mark.parametrize("told", [True, False])
def test_an_outage_is_no_reason(told: bool) -> None:
    t, p, v = circles(1.0)
    keep = (t < 10.0) | (t > 70.0)
    p[:, 0] += 8.0 * t
    v[:, 0] += 8.0
    assert unsettled(t[keep], p[keep], v[keep] if told else None) == 0


def test_what_moves_between_two_rests_while_no_fix_comes_is_no_reason() -> None:
    """Of thirty fixes at rest, an outage of half a minute and thirty fixes elsewhere the first thirty were left out."""
    rng = np.random.default_rng(4)
    t = np.concatenate([np.arange(30.0), np.arange(60.0, 95.0)])
    p = rng.normal(0.0, 0.5, (len(t), 3)) + np.where(t > 45.0, 1500.0, 0.0)[:, None] * [1.0, 0.0, 0.0]
    assert unsettled(t, p, rng.normal(0.0, 0.1, p.shape)) == 0


def test_the_origin_is_where_the_receiver_has_settled() -> None:
    """It was at latitude and longitude zero, and the vertical of the log that of the gulf of Guinea."""
    t, p, v = circles()
    lla = geodetic_columns(p, (47.4, 8.5, 400.0))
    lla[:2] = 0.0
    stream = Stream(t, dict(zip((*GEODETIC, *VELOCITY), np.hstack([lla, v]).T, strict=True)))
    streams, origin, notes = to_ned("log", {"gps": stream}, None)
    assert origin == pytest.approx(tuple(lla[2]))
    assert notes[0].startswith("no [origin]: fix 3 of gps, where it has settled, is taken (47.4")
    assert np.hypot(streams["gps"]["north"][2:], streams["gps"]["east"][2:]).max() < 70.0
