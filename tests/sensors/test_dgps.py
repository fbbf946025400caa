"""Range-domain corrections: exact without noise, aged to the rover's time, computed with the rover's message."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.estimator.positioning.location import locate
from sinan.sensors import dgps
from sinan.sensors.errors import InputError
from sinan.sensors.pseudorange import Pseudoranges, pseudoranges
from tests.estimator import gnss_simulation as simulation

MILLIMETRE, CENTIMETRE = 1e-3, 1e-2
EXACT = (
    "pseudorange.satellite_clock",
    "pseudorange.earth_rotation",
    "pseudorange.relativity",
    "pseudorange.group_delay",
)
NAVIGATION = simulation.messages("G")
BASE = simulation.RECEIVER + np.array([2000.0, -3000.0, 1500.0])


def receiver(position: np.ndarray, offset: float, epochs: int = 5, drift: float = 0.1) -> Pseudoranges:
    """A receiver whose satellites' ranges are all wrong by an offset and a drift of their own."""
    t = simulation.START + offset + 10.0 * np.arange(epochs)
    ranges = pseudoranges(simulation.observe(NAVIGATION, t, position), NAVIGATION, "G")
    number = np.array([int(name[1:]) for name in ranges.satellite.tolist()])
    return replace(ranges, value=ranges.value + 3.0 * number + drift * number * (ranges.time - simulation.START))


def error_of(rover: Pseudoranges, base: Pseudoranges) -> float:
    applied = dgps.apply(dgps.corrections(base, BASE, EXACT), rover, NAVIGATION)
    found = locate(rover, EXACT, correction=applied.value, exclude=False)
    return float(np.linalg.norm(found.fixes.position - simulation.RECEIVER, axis=1).max())


def test_what_both_see_goes_away() -> None:
    assert error_of(receiver(simulation.RECEIVER, 0.0), receiver(BASE, 0.0)) < CENTIMETRE


def test_time_tags_need_not_be_equal() -> None:
    rover, base = receiver(simulation.RECEIVER, 3.7482), receiver(BASE, 0.0)
    applied = dgps.apply(dgps.corrections(base, BASE, EXACT), rover, NAVIGATION)
    assert np.nanmax(np.abs(applied.age)) == pytest.approx(3.7482, abs=1e-6)
    assert error_of(rover, base) < 5.0 * CENTIMETRE


def test_a_clock_that_jumps_leaves_no_mark() -> None:
    base = receiver(BASE, 0.0)
    jumped = replace(base, value=base.value + 2.99792458e5 * (base.epoch >= 2))
    steady = dgps.corrections(base, BASE, EXACT)
    np.testing.assert_allclose(dgps.corrections(jumped, BASE, EXACT).value, steady.value, atol=MILLIMETRE)


def test_rate_is_that_of_the_range_error() -> None:
    given = dgps.corrections(receiver(BASE, 0.0), BASE, EXACT)
    number = np.array([int(name[1:]) for name in given.base.satellite.tolist()])
    relative = given.rate - given.rate.mean()
    np.testing.assert_allclose(relative, 0.1 * (number - number.mean()), atol=0.02)


def test_other_message_of_the_rover_is_used() -> None:
    """A second message with the satellite's clock 10 m off: correction and rover both use the rover's."""
    later = NAVIGATION.kepler.copy()
    later["af0"] += 10.0 / 299792458.0
    both = replace(NAVIGATION, kepler=np.concatenate([NAVIGATION.kepler, later]))
    rover, base = receiver(simulation.RECEIVER, 0.0, drift=0.0), receiver(BASE, 0.0, drift=0.0)
    given = dgps.corrections(base, BASE, EXACT)
    moved = replace(rover, message=rover.message + len(NAVIGATION.kepler))
    difference = dgps.apply(given, moved, both).value - dgps.apply(given, rover, both).value
    np.testing.assert_allclose(difference, 10.0, atol=MILLIMETRE)


def test_no_common_epoch_says_so() -> None:
    given = dgps.corrections(receiver(BASE, 0.0), BASE, EXACT)
    with pytest.raises(InputError, match="common satellites and epochs"):
        dgps.apply(given, receiver(simulation.RECEIVER, 900.0), NAVIGATION)


def test_a_base_on_the_other_side_of_the_earth_says_so() -> None:
    with pytest.raises(InputError, match="no satellite in sight"):
        dgps.corrections(receiver(BASE, 0.0), -BASE, EXACT)
