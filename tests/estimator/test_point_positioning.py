"""Point positioning: exact on a simulated constellation, from any start, and honest about what it can check."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sinan.estimator.positioning import integrity
from sinan.estimator.positioning.location import locate
from sinan.estimator.positioning.point_positioning import bancroft, solve
from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import SPEED_OF_LIGHT
from sinan.sensors.errors import InputError
from tests.estimator import gnss_simulation as simulation

MILLIMETRE = 1e-3
EXACT = (
    "pseudorange.satellite_clock",
    "pseudorange.earth_rotation",
    "pseudorange.relativity",
    "pseudorange.group_delay",
)
DEGREE = np.deg2rad(1.0)


def sky(elevation_deg: FloatArray, azimuth_deg: FloatArray) -> FloatArray:
    """(n, 3) satellites 22,000 km from the simulated receiver."""
    R = integrity.east_north_up(simulation.RECEIVER[None])[0]
    el, az = np.radians(elevation_deg), np.radians(azimuth_deg)
    enu = np.stack([np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)], axis=-1)
    return simulation.RECEIVER + 2.2e7 * enu @ R


EIGHT = sky(np.array([15.0, 30, 45, 60, 75, 20, 50, 35]), np.array([0.0, 50, 100, 150, 200, 250, 300, 350]))
CLOCK = 1234.5  # m


def ranges_of(satellites: FloatArray) -> FloatArray:
    return np.linalg.norm(satellites - simulation.RECEIVER, axis=1) + CLOCK


def one_epoch(satellites: FloatArray, ranges: FloatArray, **options: object):  # type: ignore[no-untyped-def]
    return solve(satellites, ranges, np.zeros(len(ranges), dtype=np.int64), 1, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("count", [4, 8])
def test_bancroft_finds_the_receiver(count: int) -> None:
    roots = bancroft(EIGHT[:count], ranges_of(EIGHT[:count]))
    np.testing.assert_allclose(roots.position[0], simulation.RECEIVER, atol=MILLIMETRE)
    assert roots.clock[0] == pytest.approx(CLOCK, abs=MILLIMETRE)


def test_bancroft_gives_the_other_root_and_why_not() -> None:
    roots = bancroft(EIGHT[:4], ranges_of(EIGHT[:4]))
    assert roots.misfit[0] < MILLIMETRE
    other = np.linalg.norm(EIGHT[:4] - roots.position[1], axis=1)
    solves_squared = np.abs(np.abs(ranges_of(EIGHT[:4]) - roots.clock[1]) - other)
    assert solves_squared.max() < 10.0 * MILLIMETRE
    assert "root" in roots.reason


def test_bancroft_needs_four() -> None:
    with pytest.raises(InputError, match="at least four"):
        bancroft(EIGHT[:3], ranges_of(EIGHT[:3]))


def test_bancroft_refuses_one_satellite_four_times() -> None:
    with pytest.raises(InputError, match="hyperplane"):
        bancroft(EIGHT[[0, 0, 0, 0]], ranges_of(EIGHT[[0, 0, 0, 0]]))


def test_from_the_centre_of_the_earth() -> None:
    fix = one_epoch(EIGHT, ranges_of(EIGHT), start=np.zeros(3))
    np.testing.assert_allclose(fix.position[0], simulation.RECEIVER, atol=MILLIMETRE)


@settings(max_examples=50, deadline=None)
@given(st.tuples(*[st.floats(-1e8, 1e8)] * 3))
def test_from_any_start(start: tuple[float, float, float]) -> None:
    fix = one_epoch(EIGHT, ranges_of(EIGHT), start=np.array(start))
    np.testing.assert_allclose(fix.position[0], simulation.RECEIVER, atol=MILLIMETRE)


def test_simulated_constellation_to_a_millimetre() -> None:
    ranges = simulation.simulated("G", epochs=4)
    found = locate(ranges, EXACT)
    error = np.linalg.norm(found.fixes.position - simulation.RECEIVER, axis=1)
    assert error.max() < MILLIMETRE
    assert np.abs(found.fixes.clock[:, 0] - 3e-4 * SPEED_OF_LIGHT).max() < MILLIMETRE


def test_each_constellation_has_its_clock() -> None:
    ranges = simulation.simulated("GE", epochs=2)
    shifted = simulation.replace(ranges, value=ranges.value + 50.0 * (ranges.system == "E"))
    found = locate(shifted, EXACT)
    assert found.clock_names == ("G", "E")
    np.testing.assert_allclose(np.diff(found.fixes.clock, axis=1), 50.0, atol=MILLIMETRE)
    np.testing.assert_allclose(found.fixes.position, np.tile(simulation.RECEIVER, (2, 1)), atol=MILLIMETRE)


def test_epochs_without_enough_satellites_do_not_stop_the_others() -> None:
    ranges = simulation.simulated("G", epochs=3)
    few = ranges.rows((ranges.epoch != 1) | (np.cumsum(ranges.epoch == 1) <= 3))
    found = locate(few, EXACT, mask=0.0)
    assert found.fixes.solved.tolist() == [True, False, True]


def test_four_satellites_check_nothing() -> None:
    fix = one_epoch(EIGHT[:4], ranges_of(EIGHT[:4]))
    zero, group = np.zeros(4, dtype=np.int64), np.zeros(4, dtype=np.int64)
    checks = integrity.check(fix, EIGHT[:4], zero, group, np.ones(4))
    assert checks.statement(0) == integrity.UNCHECKED
    assert np.isinf(checks.mdb).all()
    assert np.isinf(checks.horizontal[0])


def test_covariance_is_that_of_simulated_fixes() -> None:
    """2000 fixes; the largest deviation of a variance stays below 5 sigma of its estimate (false alarm 1e-6)."""
    rng = np.random.default_rng(3)
    runs, sigma = 2000, np.linspace(0.5, 2.0, 8)
    noisy = ranges_of(EIGHT) + sigma * rng.standard_normal((runs, 8))
    fix = solve(
        np.tile(EIGHT, (runs, 1)), noisy.ravel(), np.repeat(np.arange(runs), 8), runs, variance=np.tile(sigma**2, runs)
    )
    ratio = np.var(fix.position, axis=0) / np.diag(fix.covariance[0])[:3]
    assert np.abs(ratio - 1.0).max() < 5.0 * np.sqrt(2.0 / runs)
    assert fix.sse.mean() == pytest.approx(4.0, abs=5.0 * np.sqrt(8.0 / runs))


def test_minimal_detectable_bias_is_found_in_four_of_five() -> None:
    """The w-test of the biased satellite exceeds its bound in 80 % of 4000 runs, within 5 sigma of the binomial."""
    rng = np.random.default_rng(5)
    runs = 4000
    epoch, group = np.repeat(np.arange(runs), 8), np.zeros(8 * runs, dtype=np.int64)
    satellites, variance = np.tile(EIGHT, (runs, 1)), np.ones(8 * runs)
    clean = one_epoch(EIGHT, ranges_of(EIGHT))
    mdb = integrity.check(clean, EIGHT, epoch[:8], group[:8], np.ones(8)).mdb[2]
    noisy = ranges_of(EIGHT) + rng.standard_normal((runs, 8))
    noisy[:, 2] += mdb
    fix = solve(satellites, noisy.ravel(), epoch, runs, variance=variance)
    w = integrity.check(fix, satellites, epoch, group, variance).w.reshape(runs, 8)
    share = np.mean(np.abs(w[:, 2]) > integrity.CRITICAL)
    assert share == pytest.approx(0.8, abs=5.0 * np.sqrt(0.16 / runs))


def test_w_test_takes_out_the_bad_satellite() -> None:
    ranges = simulation.simulated("GE", epochs=3)
    name = str(ranges.satellite[3])
    bad = simulation.with_bias(ranges, name, np.full(3, 60.0))
    found = locate(bad, EXACT)
    assert set(bad.satellite[found.excluded].tolist()) == {name}
    np.testing.assert_allclose(found.fixes.position, np.tile(simulation.RECEIVER, (3, 1)), atol=MILLIMETRE)


def test_dilution_of_a_known_sky() -> None:
    """One satellite at the zenith, three on the horizon 120 deg apart: HDOP^2 = 4/3, VDOP^2 = 4/3, TDOP^2 = 1/3."""
    satellites = sky(np.array([90.0, 0, 0, 0]), np.array([0.0, 0, 120, 240]))
    fix = one_epoch(satellites, ranges_of(satellites))
    zero = np.zeros(4, dtype=np.int64)
    d = integrity.dilution(fix, satellites, zero, zero)
    assert d.horizontal[0] == pytest.approx(np.sqrt(4 / 3), rel=1e-5)
    assert d.vertical[0] == pytest.approx(np.sqrt(4 / 3), rel=1e-5)
    assert d.time[0] == pytest.approx(np.sqrt(1 / 3), rel=1e-5)


def test_common_errors_are_those_of_their_covariance() -> None:
    """A column of common errors gives the weighted least squares of its full covariance."""
    rng = np.random.default_rng(11)
    common = rng.standard_normal((8, 1)) * 3.0
    noisy = ranges_of(EIGHT) + rng.standard_normal(8)
    fix = one_epoch(EIGHT, noisy, field=common, start=simulation.RECEIVER)
    d = EIGHT - fix.position[0]
    A = np.column_stack([-d / np.linalg.norm(d, axis=1)[:, None], np.ones(8)])
    inverse = np.linalg.inv(np.eye(8) + common @ common.T)
    C = np.linalg.inv(A.T @ inverse @ A)
    np.testing.assert_allclose(fix.covariance[0][:4, :4], C, rtol=1e-6, atol=1e-9)
    left = A.T @ inverse @ (noisy - np.linalg.norm(d, axis=1) - fix.clock[0, 0])
    np.testing.assert_allclose(left, 0.0, atol=1e-6)
