"""Differential corrections, step by step, with numbers worked out by hand; `test_dgps` has the whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.sensors import dgps
from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import SPEED_OF_LIGHT
from sinan.sensors.dgps import Corrections
from sinan.sensors.errors import InputError
from sinan.sensors.formats.rinex_text import WEEK
from sinan.sensors.pseudorange import Pseudoranges, pseudoranges
from tests.estimator import gnss_simulation as simulation

MILLIMETRE = 1e-3
EXACT = (
    "pseudorange.satellite_clock",
    "pseudorange.earth_rotation",
    "pseudorange.relativity",
    "pseudorange.group_delay",
)
FIVE_DEGREES = np.deg2rad(5.0)


def table(t: list[float], epoch: list[int], satellites: list[str], week: int = 2200) -> Pseudoranges:
    """Rows with nothing in them but who and when."""
    n = len(epoch)
    zero, point = np.zeros(n), np.zeros((n, 3))
    return Pseudoranges(
        "base.obs", week, np.array(t), np.array(epoch), np.array(satellites), zero, np.full(n, 1575.42e6), point, point,
        zero, zero, zero, zero, np.zeros(n, dtype=np.int64), None, None, (),
    )  # fmt: skip


def given(base: Pseudoranges, value: list[float], rate: list[float] | None = None) -> Corrections:
    """Corrections of a base, with a variance that tells its row."""
    n = len(base)
    rates, values = np.zeros(n) if rate is None else np.array(rate), np.array(value)
    return Corrections(
        base, np.zeros(3), values, rates, 10.0 + np.arange(n), values, np.zeros((len(base.t), 1))
    )  # fmt: skip


def test_the_noise_of_a_receiver_grows_towards_the_horizon() -> None:
    """0.3 m for each of noise and multipath: 0.09 (1 + 1 / sin^2 E); below 5 deg as at 5 deg."""
    found = dgps.receiver_variance(table([0.0], [0, 0, 0], ["G01"] * 3), np.radians([90.0, 30.0, 1.0]))
    np.testing.assert_allclose(found, [0.18, 0.45, 0.09 * (1.0 + 1.0 / np.sin(FIVE_DEGREES) ** 2)])


def test_each_epoch_and_constellation_loses_its_weighted_mean() -> None:
    """GPS at the first epoch: 4 and 7 m with variances 1 and 2 have the mean (4 + 7 / 2) / (1 + 1 / 2) = 5."""
    base = table([0.0, 30.0], [0, 0, 0, 1, 1], ["G01", "G02", "E01", "G01", "E01"])
    value, variance = np.array([4.0, 7.0, 20.0, 9.0, -3.0]), np.array([1.0, 2.0, 5.0, 1.0, 1.0])
    left, clock = dgps.without_clock(base, value, variance)
    np.testing.assert_allclose(left, [-1.0, 2.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(clock, [[5.0, 20.0], [9.0, -3.0]])


def test_an_epoch_without_a_constellation_has_no_clock_of_it() -> None:
    base = table([0.0, 30.0, 60.0], [0, 1, 2], ["G01", "E01", "G01"])
    _, clock = dgps.without_clock(base, np.array([4.0, 7.0, 2.0]), np.ones(3))
    np.testing.assert_array_equal(clock, [[4.0, np.nan], [np.nan, 7.0], [2.0, np.nan]])


def test_a_line_through_what_is_near_in_time_gives_value_and_rate() -> None:
    """Within 30 s to either side. Against NumPy's straight line, satellite by satellite."""
    t = np.array([0.0, 10.0, 25.0, 40.0, 90.0, 110.0])  # the last two have but each other
    base = table(t.tolist(), [0, 1, 2, 3, 4, 5] * 3, ["G01"] * 6 + ["G02"] * 6 + ["E02"] * 6)
    rng = np.random.default_rng(1)
    value = np.concatenate([100.0 + 0.3 * t, 7.0 - 0.2 * t, 40.0 + 0.0 * t]) + rng.normal(0.0, 1.0, 18)
    smooth, rate = dgps.straight_lines(base, value)
    for rows in (np.arange(6), np.arange(6, 12), np.arange(12, 18)):
        for r in rows:
            near = rows[np.abs(base.time[rows] - base.time[r]) <= 30.0]
            if len(near) < 3:
                assert (smooth[r], rate[r]) == (value[r], 0.0)
            else:
                slope, start = np.polyfit(base.time[near], value[near], 1)
                assert rate[r] == pytest.approx(slope)
                assert smooth[r] == pytest.approx(start + slope * base.time[r])


def test_another_navigation_message_begins_another_line() -> None:
    """A jump of 50 m between two messages leaves no slope."""
    base = table([0.0, 5.0, 10.0, 15.0, 20.0, 25.0], [0, 1, 2, 3, 4, 5], ["G01"] * 6)
    base = replace(base, message=np.array([0, 0, 0, 1, 1, 1]))
    smooth, rate = dgps.straight_lines(base, np.array([1.0, 1.0, 1.0, 51.0, 51.0, 51.0]))
    np.testing.assert_allclose(smooth, [1.0, 1.0, 1.0, 51.0, 51.0, 51.0])
    np.testing.assert_allclose(rate, 0.0, atol=1e-12)


def test_a_line_through_tenths_of_a_second_has_a_slope() -> None:
    """At the end of the week, where the seconds have six digits before the point."""
    base = table([6e5, 6e5 + 0.1, 6e5 + 0.2], [0, 1, 2], ["G01"] * 3)
    _, rate = dgps.straight_lines(base, np.array([5.0, 5.2, 5.4]))
    np.testing.assert_allclose(rate, 2.0, rtol=1e-6)


def test_readings_at_one_instant_have_no_slope() -> None:
    base = table([5.0], [0, 0, 0], ["G01"] * 3)
    smooth, rate = dgps.straight_lines(base, np.array([1.0, 2.0, 4.0]))
    np.testing.assert_array_equal(smooth, [1.0, 2.0, 4.0])
    np.testing.assert_array_equal(rate, 0.0)


def test_the_nearest_correction_of_the_same_satellite_is_taken() -> None:
    """Before, between (nearer to the one before, to the one after, to both alike), after; and one that is not there."""
    base = table([100.0, 130.0], [0, 0, 1], ["G01", "G02", "G01"])
    rover = table([90.0, 110.0, 115.0, 120.0, 150.0], [0, 1, 2, 3, 4, 0], ["G01"] * 5 + ["G03"])
    row, age = dgps.nearest(given(base, [0.0] * 3), rover)
    assert row.tolist() == [0, 0, 0, 2, 2, -1]
    np.testing.assert_array_equal(age, [-10.0, 10.0, 15.0, -10.0, 20.0, np.nan])


def test_a_correction_of_the_week_before_is_as_near_as_its_time() -> None:
    base = table([WEEK - 10.0], [0], ["G01"], week=2199)
    row, age = dgps.nearest(given(base, [0.0]), table([5.0], [0], ["G01"], week=2200))
    assert row.tolist() == [0]
    np.testing.assert_allclose(age, [15.0])


def test_a_correction_ages_by_its_rate() -> None:
    """8 m and 0.5 m/s, 4 s before: 6 m. Of a satellite that the base has not seen there is none."""
    base = table([100.0], [0, 0], ["G01", "G02"])
    rover = table([96.0], [0, 0], ["G02", "G03"])
    found = dgps.apply(given(base, [3.0, 8.0], [9.0, 0.5]), rover, simulation.messages("G"))
    np.testing.assert_array_equal(found.value, [6.0, np.nan])
    np.testing.assert_array_equal(found.age, [-4.0, np.nan])
    np.testing.assert_array_equal(found.variance, [11.0, np.nan])


@pytest.mark.parametrize(("late", "used"), [(60.0, True), (61.0, False), (-60.0, True), (-61.0, False)])
def test_a_correction_is_used_for_a_minute_to_either_side(late: float, used: bool) -> None:
    corrections, rover = given(table([1000.0], [0], ["G01"]), [2.0]), table([1000.0 + late], [0], ["G01"])
    if used:
        assert dgps.apply(corrections, rover, simulation.messages("G")).value.tolist() == [2.0]
        return
    with pytest.raises(InputError, match="no satellite and epoch within 60 s of those of base"):
        dgps.apply(corrections, rover, simulation.messages("G"))


BASE = simulation.RECEIVER


def base_ranges(wrong: FloatArray | float = 0.0, **options: object) -> Pseudoranges:
    """A base with exact ranges, each satellite's off by `wrong` times its number."""
    ranges = simulation.simulated("GE", epochs=3, **options)  # type: ignore[arg-type]
    number = np.array([int(name[1:]) for name in ranges.satellite.tolist()])
    return replace(ranges, value=ranges.value + wrong * number)


def test_the_correction_of_an_exact_range_is_nothing_and_its_clock_the_base_s() -> None:
    found = dgps.corrections(base_ranges(), BASE, EXACT)
    np.testing.assert_allclose(found.value, 0.0, atol=2.0 * MILLIMETRE)
    np.testing.assert_allclose(found.rate, 0.0, atol=MILLIMETRE)
    np.testing.assert_allclose(found.clock, SPEED_OF_LIGHT * 3e-4, atol=2.0 * MILLIMETRE)
    np.testing.assert_array_equal(found.position, BASE)


def test_a_correction_is_what_is_too_long() -> None:
    """Less the mean of its constellation, weighted with the noise of the elevations."""
    ranges = base_ranges(wrong=2.0)
    found = dgps.corrections(ranges, BASE, EXACT)
    number = np.array([int(name[1:]) for name in found.base.satellite.tolist()])
    up = BASE / np.linalg.norm(BASE)
    away = found.base.position - BASE
    rough = np.degrees(np.arcsin(away @ up / np.linalg.norm(away, axis=1)))
    assert np.all(rough > 4.5)  # geocentric up, within 0.2 deg of the ellipsoid's
    np.testing.assert_allclose(found.variance, 0.09 * (1.0 + 1.0 / np.sin(np.radians(rough)) ** 2), rtol=0.08)
    for system in "GE":
        for k in range(3):
            mine = (found.base.system == system) & (found.base.epoch == k)
            off = 2.0 * (number[mine] - np.average(number[mine], weights=1.0 / found.variance[mine]))
            np.testing.assert_allclose(found.value[mine], off, atol=0.02)  # weights change over the line's three epochs


def test_low_satellites_make_no_corrections() -> None:
    ranges = base_ranges(lowest=1.0)
    low = dgps.corrections(ranges, BASE, EXACT, lowest=np.deg2rad(1.0))
    usual = dgps.corrections(ranges, BASE, EXACT)
    high = dgps.corrections(ranges, BASE, EXACT, lowest=np.deg2rad(30.0))
    assert len(high.base) < len(usual.base) < len(low.base) <= len(ranges)
    assert np.max(high.variance) < 0.45 < np.max(usual.variance)
    assert len(high.value) == len(high.base) == len(high.rate) == len(high.variance)


def test_what_is_modelled_is_taken_off_at_the_base_too() -> None:
    """Without the group delays the corrections have them."""
    ranges = base_ranges()
    found = dgps.corrections(ranges, BASE, EXACT[:3])
    delay = SPEED_OF_LIGHT * found.base.group_delay
    for system in "GE":
        mine = (found.base.system == system) & (found.base.epoch == 0)
        off = delay[mine] - np.average(delay[mine], weights=1.0 / found.variance[mine])
        np.testing.assert_allclose(found.value[mine], off, atol=5.0 * MILLIMETRE)


def test_a_correction_for_another_message_has_its_orbit_and_clock() -> None:
    """The base's correction with the rover's message is value + (c clock - distance) of that less of its own."""
    known = simulation.messages("G")
    later = known.kepler.copy()
    later["af0"] += 20.0 / SPEED_OF_LIGHT
    later["crc"] += 30.0  # lifts the orbit by up to 30 m
    both = replace(known, kepler=np.concatenate([known.kepler, later]))
    base = simulation.simulated("G", epochs=1)
    corrections = dgps.corrections(base, BASE, EXACT)
    rows = np.arange(len(base))
    rover = replace(base, message=np.where(rows % 2 == 0, base.message, base.message + len(known.kepler)))
    usable = rows % 3 != 1
    change = dgps.other_message(corrections, rows[usable], rover, usable, both)
    moved = simulation.observe(replace(known, kepler=later), base.t[:1])
    by_later = pseudoranges(replace(moved, values={"C1C": base.value}), replace(known, kepler=later), "G")
    assert by_later.satellite.tolist() == base.satellite.tolist()
    own = SPEED_OF_LIGHT * base.clock - np.linalg.norm(base.position - BASE, axis=1)
    new = SPEED_OF_LIGHT * by_later.clock - np.linalg.norm(by_later.position - BASE, axis=1)
    expected = np.where(rows % 2 == 0, 0.0, new - own)
    np.testing.assert_allclose(change, expected[usable], atol=MILLIMETRE)
    assert np.max(np.abs(change - 20.0 * (rows[usable] % 2))) > 5.0


def test_the_noise_of_a_corrected_range() -> None:
    """0.45 of the rover at 30 deg, 0.7 of the correction, and of a ray of 10 m what 100 km of 1,000 leave:
    (0.2 x 10 x 0.1)^2 = 0.04."""
    rover = table([0.0], [0, 0], ["G01", "G02"])
    applied = dgps.Applied(np.zeros(2), np.zeros(2), np.array([0.7, np.nan]))
    thirty = np.radians([30.0, 30.0])
    found = dgps.corrected_variance(rover, applied, thirty, np.full(2, 10.0), 1e5)
    np.testing.assert_allclose(found, [0.45 + 0.7 + 0.04, 0.45 + 0.04])
    far = dgps.corrected_variance(rover, applied, thirty, np.full(2, 10.0), 5e6)
    np.testing.assert_allclose(far, [0.45 + 0.7 + 4.0, 0.45 + 4.0])


def test_what_a_correction_leaves_of_a_field_goes_with_the_distance() -> None:
    left = np.array([[3.0, -2.0, 1.0]])
    np.testing.assert_allclose(dgps.common_left(left, 2e5), 0.2 * left)
    np.testing.assert_allclose(dgps.common_left(left, 3e6), left)


def test_a_correction_gains_the_variance_that_the_base_has_measured() -> None:
    """A random walk of 0.5 m/sqrt(s) beside noise of s_b: held for a seconds a correction is wrong by walk^2 a more.

    200 satellites of 400 s: the mean over pairs of a walk scatters by some per cent.
    """
    rng = np.random.default_rng(4)
    satellites, epochs, noise = 200, 400, 0.7
    walk = 0.5 * rng.standard_normal((epochs, satellites)).cumsum(axis=0)
    names = [f"S{k:03d}" for k in range(satellites)] * epochs
    t = np.arange(float(epochs))
    base = table(t.tolist(), np.repeat(np.arange(epochs), satellites).tolist(), names)
    value = (walk + noise * rng.standard_normal(walk.shape)).ravel()
    one = replace(given(base, value.tolist()), variance=np.full(len(base), noise**2))
    found = dgps.growth(one, rate=False)
    np.testing.assert_allclose(found.at(np.array([5.0, 20.0, -60.0])), [1.25, 5.0, 15.0], rtol=0.1)
    steady = replace(one, value=value - walk.ravel(), measured=value - walk.ravel())
    assert dgps.growth(steady, rate=False).at(np.array([60.0]))[0] < 0.01


def test_a_base_of_one_epoch_knows_of_no_growth() -> None:
    found = dgps.growth(given(table([0.0], [0, 0], ["G01", "G02"]), [1.0, 2.0]))
    np.testing.assert_array_equal(found.at(np.array([0.0, 60.0])), 0.0)
