"""The pseudorange model, term by term: which code is taken, where the satellite stands, how much a range is worth.

Numbers are worked out by hand or from geometry that has only one answer; `test_pseudorange` has the measured side.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import SPEED_OF_LIGHT, WGS84_A
from sinan.sensors.effects.pseudorange_troposphere import zenith_delay
from sinan.sensors.formats.rinex import GLONASS, Navigation
from sinan.sensors.formats.rinex_observation import Observations
from sinan.sensors.formats.rinex_text import WEEK
from sinan.sensors.motion import Motion
from sinan.sensors.pseudorange import (
    MODELLED,
    Pseudoranges,
    circumstances,
    code_variance,
    describe,
    elevation_azimuth,
    full_size,
    ionosphere_left,
    line_of_sight,
    modelled,
    pseudoranges,
    sum_of,
)
from tests.estimator import gnss_simulation as simulation

MILLIMETRE = 1e-3
NAN = np.nan
EQUATOR = np.array([WGS84_A, 0.0, 0.0])  # latitude and longitude zero, on the ellipsoid: up is x, east y, north z
EXACT = (
    "pseudorange.satellite_clock",
    "pseudorange.earth_rotation",
    "pseudorange.relativity",
    "pseudorange.group_delay",
)


def navigation() -> Navigation:
    """Messages of GPS, Galileo, QZSS and BeiDou, and of one GLONASS satellite on channel -3."""
    known = simulation.messages("GEJC")
    glonass = np.zeros(1, dtype=GLONASS)
    glonass["satellite"], glonass["channel"] = "R01", -3.0
    glonass["time"] = simulation.WEEK_NUMBER * WEEK + simulation.START
    glonass["x"], glonass["y"], glonass["vz"] = 2.0e7, 1.58e7, 3.0e3
    return replace(known, glonass=glonass)


def observed(satellites: list[str], **codes: list[float]) -> Observations:
    """One row a satellite, all at the messages' own time."""
    values = {code: np.array(value) for code, value in codes.items()}
    t, epoch = np.array([simulation.START]), np.zeros(len(satellites), dtype=np.int64)
    names = np.array(satellites, dtype="<U3")
    return Observations("my.obs", 3.04, None, simulation.WEEK_NUMBER, t, epoch, names, values, ())


def test_the_preferred_code_is_taken_with_its_frequency_and_strength() -> None:
    """By satellite: both codes; the second alone; BeiDou by B1I, by its older name, by B3I; another system's code."""
    names = ["G01", "E01", "E02", "C06", "C07", "C08", "R01", "J01"]
    ranges = pseudoranges(
        observed(
            names,
            C1C=[2.1e7, 2.2e7, NAN, NAN, NAN, NAN, 2.3e7, NAN],
            C1X=[2.4e7, NAN, 2.5e7, NAN, NAN, NAN, NAN, 2.6e7],
            C2I=[2.9e7, NAN, NAN, 3.1e7, NAN, NAN, NAN, NAN],
            C1I=[NAN, NAN, NAN, 3.9e7, 3.2e7, NAN, NAN, NAN],
            C6I=[NAN, NAN, NAN, 3.8e7, 3.7e7, 3.3e7, NAN, NAN],
            S1C=[41.0, 42.0, NAN, NAN, NAN, NAN, 43.0, NAN],
            S1=[99.0, 98.0, 44.0, NAN, 45.0, NAN, 97.0, 46.0],
        ),
        navigation(),
        "GEJCR",
    )
    assert ranges.satellite.tolist() == names
    np.testing.assert_array_equal(ranges.value, [2.1e7, 2.2e7, 2.5e7, 3.1e7, 3.2e7, 3.3e7, 2.3e7, 2.6e7])
    L1, B1, B3, G1 = 1575.42e6, 1561.098e6, 1268.52e6, 1602e6 - 3.0 * 562.5e3
    np.testing.assert_array_equal(ranges.frequency, [L1, L1, L1, B1, B1, B3, G1, L1])
    np.testing.assert_array_equal(ranges.strength, [41.0, 42.0, 44.0, NAN, 45.0, NAN, 43.0, 46.0])
    assert not ranges.journal


def test_a_group_delay_is_that_of_the_signal_and_a_velocity_that_of_who_needs_it() -> None:
    """BeiDou's clocks are meant for B3I, GLONASS's have the relativity in them."""
    names = ["G01", "C06", "C08", "R01"]
    ranges = pseudoranges(
        observed(names, C1C=[2.1e7, NAN, NAN, 2.1e7], C2I=[NAN, 3e7, NAN, NAN], C6I=[NAN, NAN, 3e7, NAN]),
        navigation(),
        "GCR",
    )
    messages = navigation().kepler
    delay = [float(messages["group_delay"][messages["satellite"] == name][0]) for name in ("G01", "C06")]
    np.testing.assert_allclose(ranges.group_delay, [*delay, 0.0, 0.0], atol=1e-20)
    speed = np.linalg.norm(ranges.velocity, axis=1)
    assert np.all(speed[:3] > 1000.0)
    assert speed[3] == 0.0
    assert np.all(np.linalg.norm(ranges.position, axis=1) > 2e7)


def test_a_system_that_is_not_asked_for_is_left_out() -> None:
    both = observed(["G01", "E01"], C1C=[2.1e7, 2.1e7])
    assert pseudoranges(both, navigation(), "E").satellite.tolist() == ["E01"]
    assert pseudoranges(both, navigation(), "N").satellite.tolist() == []


def test_what_is_no_range_is_left_out_and_said_once_each() -> None:
    """9,999 km, 100,001 km and none at all; of the last there is nothing to say."""
    given = observed(["G01", "G02", "G03", "G04"], C1C=[9.999e6, 2.2e7, 1.00001e8, NAN])
    ranges = pseudoranges(replace(given, journal=("read",)), replace(navigation(), journal=("found",)), "G")
    assert ranges.satellite.tolist() == ["G02"]
    assert ranges.journal[:2] == ("read", "found")
    assert [("G01" in line, "G03" in line) for line in ranges.journal[2:]] == [(True, False), (False, True)]
    assert all(line.endswith("no possible pseudorange: left out") for line in ranges.journal[2:])
    assert "2022-03-10 00:00:00" in ranges.journal[2]
    assert "9999000.000 m" in ranges.journal[2]


def test_the_strength_is_that_of_the_code_that_is_taken() -> None:
    """A strength without a range says nothing of the range of another code."""
    given = observed(["E01", "E02"], C1C=[NAN, 2.1e7], C1X=[2.2e7, NAN], S1C=[50.0, 40.0])
    np.testing.assert_array_equal(pseudoranges(given, navigation(), "E").strength, [NAN, 40.0])


def test_what_cannot_be_used_is_said_by_satellite_and_reason() -> None:
    """G01 in order, then twice 2.5 h before and later after its message; G03 too late once; G02 without a message."""
    known = navigation()
    known = replace(known, kepler=known.kepler[known.kepler["satellite"] != "G02"])
    t = simulation.START + np.array([-10800.0, -9000.0, 0.0, 10800.0])
    given = observed(["G01", "G01", "G02", "G01", "G02", "G01", "G03"], C1C=[2.1e7] * 7)
    given = replace(given, t=t, epoch=np.array([0, 1, 1, 2, 2, 3, 3]))
    ranges = pseudoranges(given, known, "G")
    assert ranges.satellite.tolist() == ["G01"]
    first, second, third = sorted(ranges.journal)
    assert first.startswith("my.obs, G01, 3 epochs from 2022-03-09 21:00:00")
    assert first.endswith("navigation message too old (nearest 2.5 h away): left out")
    assert second.startswith("my.obs, G02, 2 epochs from 2022-03-09 21:30:00")
    assert second.endswith("no navigation message: left out")
    assert third.startswith("my.obs, G03, 1 epochs from 2022-03-10 03:00:00")
    assert third.endswith("(nearest 3.0 h away): left out")


@pytest.mark.parametrize(("hours", "words"), [(1.5, "1.5 h"), (47.9, "47.9 h"), (72.0, "3 days")])
def test_a_span_of_time_has_a_unit_that_suits_it(hours: float, words: str) -> None:
    assert describe(3600.0 * hours) == words


@pytest.mark.parametrize(
    ("direction", "elevation", "azimuth"),
    [
        ([0.0, 0.0, 1.0], 0.0, 0.0),
        ([0.0, 1.0, 0.0], 0.0, 90.0),
        ([1.0, 0.0, -1.0], 45.0, 180.0),
        ([1.0, -np.sqrt(2.0), 1.0], 30.0, -54.7356),
        ([-1.0, 0.0, 1.0], -45.0, 0.0),
    ],
    ids=["north", "east", "half up in the south", "north-west", "below the horizon"],
)
def test_directions_over_the_equator(direction: list[float], elevation: float, azimuth: float) -> None:
    satellite = (EQUATOR + 1e7 * np.array(direction))[None]
    found = elevation_azimuth(satellite, EQUATOR[None], np.zeros(1), np.zeros(1))
    np.testing.assert_allclose(np.degrees(np.concatenate(found)), [elevation, azimuth], atol=1e-4)


def test_directions_over_any_place_are_those_of_scipy_s_turns() -> None:
    """Turned by the longitude about z and by minus the latitude about y, x, y, z become up, east, north."""
    rng = np.random.default_rng(2)
    latitude, longitude = rng.uniform(-1.5, 1.5, 50), rng.uniform(-3.1, 3.1, 50)
    elevation, azimuth = rng.uniform(-0.1, 1.5, 50), rng.uniform(-3.1, 3.1, 50)
    level = np.cos(elevation)
    told = np.column_stack([np.sin(elevation), level * np.sin(azimuth), level * np.cos(azimuth)])
    receiver = rng.uniform(-6e6, 6e6, (50, 3))
    turns = Rotation.from_euler("ZY", np.column_stack([longitude, -latitude]))
    found = elevation_azimuth(receiver + 2e7 * turns.apply(told), receiver, latitude, longitude)
    np.testing.assert_allclose(found, [elevation, azimuth], atol=1e-9)


def test_the_direction_of_a_satellite_is_what_the_distance_falls_by() -> None:
    """3, 4, 12: a distance of 13; a step towards the satellite shortens it by as much."""
    satellite, receiver = np.array([[4.0, 6.0, 15.0]]), np.array([[1.0, 2.0, 3.0]])
    distance, slope = line_of_sight(satellite, receiver)
    assert distance[0] == pytest.approx(13.0)
    np.testing.assert_allclose(slope[0], [-3.0 / 13.0, -4.0 / 13.0, -12.0 / 13.0])


def two(**changes: object) -> Pseudoranges:
    """A GPS satellite straight over the equator and one 30 deg up in the south-east, 10 s later."""
    t = np.array([100.0, 110.0])
    position = EQUATOR + 2e7 * np.array([[1.0, 0.0, 0.0], [1.0, np.sqrt(1.5), -np.sqrt(1.5)]])
    zero = np.zeros(2)
    ranges = Pseudoranges(
        "here", 2200, t, np.array([0, 1]), np.array(["G05", "G06"]), 2e7 + zero, np.array([1575.42e6, 1561.098e6]),
        position, np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), zero, np.array([2e-9, -3e-9]), np.array([2.0, 0.0]),
        zero, np.array([0, 1]), None, None, (),
    )  # fmt: skip
    return replace(ranges, **changes)  # type: ignore[arg-type]


AT_BOTH = np.stack([EQUATOR, EQUATOR])


def test_what_the_effects_are_told() -> None:
    ranges = two(klobuchar=simulation.KLOBUCHAR)
    told = circumstances(ranges, AT_BOTH, faulty=np.array([False, True])).covariates
    np.testing.assert_array_equal(told["satellite_position"], ranges.position)
    np.testing.assert_array_equal(told["satellite_velocity"], ranges.velocity)
    np.testing.assert_array_equal(told["receiver_position"], AT_BOTH)
    np.testing.assert_array_equal(told["group_delay"], [2e-9, -3e-9])
    np.testing.assert_array_equal(told["frequency"], ranges.frequency)
    np.testing.assert_allclose([told["latitude"], told["longitude"]], 0.0, atol=1e-12)
    np.testing.assert_allclose(told["height"], 0.0, atol=1e-6)
    np.testing.assert_allclose(np.degrees(told["elevation"]), [90.0, 30.0])
    assert np.degrees(told["azimuth"][1]) == pytest.approx(135.0)
    np.testing.assert_array_equal(told["elapsed"], [0.0, 10.0])
    np.testing.assert_array_equal(told["faulty"], [0.0, 1.0])
    np.testing.assert_array_equal(told["klobuchar"], np.stack([simulation.KLOBUCHAR] * 2))
    assert circumstances(ranges, AT_BOTH).t.tolist() == [100.0, 110.0]


def test_what_is_not_known_the_effects_are_not_told() -> None:
    told = circumstances(two(), AT_BOTH).covariates
    assert "klobuchar" not in told
    assert "faulty" not in told


def test_receivers_of_a_moving_vehicle_are_taken_by_epoch() -> None:
    """The second epoch 90 deg of longitude further east: its satellite is below the horizon there."""
    moved = np.stack([EQUATOR, [0.0, WGS84_A, 0.0]])
    told = circumstances(two(epoch=np.array([1, 0])), moved).covariates
    np.testing.assert_allclose(np.degrees(told["longitude"]), [90.0, 0.0], atol=1e-9)


def test_the_size_that_is_known_beforehand() -> None:
    """One, but the troposphere's zenith delay, and none of an ionosphere without coefficients."""
    motion = circumstances(two(), AT_BOTH)
    known = motion.with_covariates(klobuchar=np.stack([simulation.KLOBUCHAR] * 2))
    for name in EXACT:
        np.testing.assert_array_equal(full_size(name, motion), 1.0)
    np.testing.assert_array_equal(full_size("pseudorange.ionosphere", motion), 0.0)
    np.testing.assert_array_equal(full_size("pseudorange.ionosphere", known), 1.0)
    expected = zenith_delay(np.zeros(2), np.zeros(2))
    np.testing.assert_allclose(full_size("pseudorange.troposphere", motion), expected, rtol=1e-9)


def test_effects_add_each_at_its_size() -> None:
    """At the zenith: 2 ns of group delay are 0.5996 m, the troposphere its zenith delay, the relativity 2 r.v / c."""
    motion = circumstances(two(), AT_BOTH)
    group = SPEED_OF_LIGHT * 2e-9
    air = float(zenith_delay(np.zeros(1), np.zeros(1))[0])
    clock = 2.0 * (WGS84_A + 2e7) * 1.0 / SPEED_OF_LIGHT
    names = ("pseudorange.group_delay", "pseudorange.troposphere", "pseudorange.relativity")
    assert sum_of(motion, names)[0] == pytest.approx(group + air + clock, abs=MILLIMETRE)
    assert sum_of(motion, names[:1])[0] == pytest.approx(group)
    np.testing.assert_array_equal(sum_of(motion, ()), 0.0)
    np.testing.assert_array_equal(modelled(two(), AT_BOTH, ()), 0.0)
    np.testing.assert_array_equal(modelled(two(), AT_BOTH, names), sum_of(motion, names))


def test_the_earth_s_rotation_enters_exactly() -> None:
    """While the signal travels its satellite's frame turns by w tau; tau is that of the turned path, to 10 um."""
    ranges = two()
    p = ranges.position[1]
    straight = path = float(np.linalg.norm(p - EQUATOR))
    for _ in range(5):
        angle = 7.2921151467e-5 * path / SPEED_OF_LIGHT
        c, s = np.cos(angle), np.sin(angle)
        path = float(np.linalg.norm(np.array([c * p[0] + s * p[1], c * p[1] - s * p[0], p[2]]) - EQUATOR))
    assert abs(path - straight) > 10.0
    found = modelled(ranges, AT_BOTH, ["pseudorange.earth_rotation"])[1]
    assert found == pytest.approx(path - straight, abs=1e-5)


def test_a_range_less_what_is_modelled_is_geometry_and_clocks() -> None:
    """Exact simulated ranges: |p_s - p_r| + c clock_rx is left, to a millimetre."""
    ranges = simulation.simulated("G")
    where = np.tile(simulation.RECEIVER, (5, 1))
    straight = np.linalg.norm(ranges.position - simulation.RECEIVER, axis=1)
    left = ranges.value - modelled(ranges, where, EXACT) - straight - SPEED_OF_LIGHT * 3e-4
    assert np.max(np.abs(left)) < 2.0 * MILLIMETRE
    assert set(EXACT) < set(MODELLED)


def test_what_a_range_is_worth() -> None:
    """RTKLIB's variance by hand. At 30 deg, sin E = 1/2, a delay of 10 m, 0.5 m of accuracy:
    0.81 (1 + 2) + 0.25 + (0.2 x 10)^2 + 0.3^2 + (0.3 / 0.6)^2 = 7.02 m^2."""
    both = two(satellite=np.array(["G05", "R06"]), accuracy=np.array([0.5, 0.0]))
    found = code_variance(both, np.radians([30.0, 90.0]), np.array([10.0, 0.0]))
    assert found[0] == pytest.approx(7.02)
    # GLONASS overhead without a promise: 2.25 x 0.81 x 2 + 2.4^2 + 0.09 + (0.3 / 1.1)^2
    assert found[1] == pytest.approx(2.25 * 1.62 + 5.76 + 0.09 + (0.3 / 1.1) ** 2)
    assert code_variance(both, np.radians([30.0, 90.0]))[0] == pytest.approx(3.02)
    low = code_variance(both, np.radians([1.0, 5.0]))
    assert low[0] == pytest.approx(0.81 * (1.0 + 1.0 / np.sin(np.radians(5.0))) + 0.25 + 0.09 + left_of_air(5.0))


def left_of_air(elevation_deg: float) -> float:
    """(0.3 / (sin E + 0.1))^2."""
    return float((0.3 / (np.sin(np.radians(elevation_deg)) + 0.1)) ** 2)


def at(elevation_deg: FloatArray, azimuth_deg: FloatArray, frequency: float = 1575.42e6) -> Motion:
    """Circumstances of satellites in these directions."""
    covariates = {
        "elevation": np.radians(elevation_deg),
        "azimuth": np.radians(azimuth_deg),
        "frequency": np.full(len(elevation_deg), frequency),
    }
    return Motion(t=np.zeros(len(elevation_deg)), covariates=covariates)


def test_what_the_broadcast_ionosphere_leaves_is_half_of_it_and_a_field() -> None:
    """Pierce points at E = 30 deg: psi = pi (0.0137 / (1/6 + 0.11) - 0.022) = 0.08645 rad, 551.4 km of the 1000."""
    found = ionosphere_left(at(np.full(3, 30.0), np.array([0.0, 90.0, 180.0])), np.full(3, 8.0))
    far = 4.0 * 0.5514
    np.testing.assert_allclose(found, [[4.0, far, 0.0], [4.0, 0.0, far], [4.0, -far, 0.0]], atol=1e-3)
    little = ionosphere_left(at(np.array([30.0]), np.zeros(1)), np.array([0.5]))
    assert little[0, 0] == pytest.approx(0.25)


def test_an_ionosphere_that_is_not_known_is_five_metres_overhead() -> None:
    """Times the obliquity 1 + 16 (0.53 - E / pi)^3, and the square of the frequencies' ratio."""
    overhead = ionosphere_left(at(np.array([90.0]), np.array([0.0])), np.zeros(1))
    assert overhead[0, 0] == pytest.approx(5.0 * (1.0 + 16.0 * 0.03**3))
    low = ionosphere_left(at(np.array([30.0]), np.array([0.0]), 1561.098e6), np.zeros(1))
    obliquity = 1.0 + 16.0 * (0.53 - 1.0 / 6.0) ** 3
    assert low[0, 0] == pytest.approx(5.0 * obliquity * (1575.42 / 1561.098) ** 2)
    below = ionosphere_left(at(np.array([-20.0]), np.array([0.0])), np.full(1, 2.0))
    horizon = ionosphere_left(at(np.array([0.0]), np.array([0.0])), np.full(1, 2.0))
    assert below[0, 1] == pytest.approx(horizon[0, 1])


def test_each_system_has_its_clock() -> None:
    names = np.array(["C06", "G05", "E11", "G06", "R01", "J02"])
    number, letters = two(satellite=names).clock_groups()
    assert letters == ("G", "E", "J", "C", "R")
    assert [letters[k] for k in number.tolist()] == ["C", "G", "E", "G", "R", "J"]
