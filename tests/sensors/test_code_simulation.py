"""Simulated pseudoranges and the data link, each against another derivation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.sensors import dgps
from sinan.sensors.code_receiver import CA_CHIP, CLASSES, CodeReceiver
from sinan.sensors.data_link import DataLink, apply_link, parse_link
from sinan.sensors.errors import InputError
from sinan.sensors.pseudorange import L1, L2, ionosphere_free, pseudoranges
from sinan.sensors.pseudorange_simulation import START, Air, Fault, constellation, simulate_ranges
from sinan.sensors.range_error import RangeError, aged_variance, line_weights
from tests.estimator import gnss_simulation as simulation

MILLIMETRE = 1e-3
SILENT = CodeReceiver("silent", ("C1C",), CA_CHIP, noise=1e-9, clock_drift=0.0, clock_noise=0.0)
WHERE = np.tile(simulation.RECEIVER, (4, 1))
T = START + 300.0 * np.arange(4)


def test_ranges_are_those_of_light_that_travels_in_the_other_way_of_counting() -> None:
    """Satellite by satellite, epoch by epoch, with the signal's instant instead of its travel time (test code)."""
    navigation = constellation(3)
    ours = simulate_ranges(SILENT, navigation, T, WHERE, seed=5)
    # of the same seed: four numbers for the walk of a clock that has none, then the offset
    rng = np.random.default_rng([5, 2])
    rng.standard_normal(4)
    clock = 1e5 * rng.uniform(-1.0, 1.0) / 299792458.0
    theirs = simulation.observe(navigation, T, clock=clock)
    key = {(e, s): v for e, s, v in zip(theirs.epoch, theirs.satellite, theirs.values["C1C"], strict=True)}
    both = [
        (v, key[e, s]) for e, s, v in zip(ours.epoch, ours.satellite, ours.values["C1C"], strict=True) if (e, s) in key
    ]
    assert len(both) > 0.9 * len(ours.epoch)
    np.testing.assert_allclose(*np.array(both).T, atol=MILLIMETRE)


def test_two_frequencies_leave_no_ionosphere_and_no_group_delay() -> None:
    two = CodeReceiver("two", ("C1W", "C2W"), 29.3, noise=1e-9, clock_noise=0.0)
    navigation = constellation(3)
    with_air = simulate_ranges(two, navigation, T, WHERE, air=Air(0.0, 2.0), seed=1)
    free = simulate_ranges(two, navigation, T, WHERE, seed=1)
    assert np.min(with_air.values["C1W"] - free.values["C1W"]) > 1.0
    a, b = (ionosphere_free(one).values["C0W"] for one in (with_air, free))
    np.testing.assert_allclose(a, b, atol=MILLIMETRE)
    delay = np.array([navigation.kepler["group_delay"][navigation.kepler["satellite"] == s][0] for s in free.satellite])
    np.testing.assert_allclose(free.values["C1W"] - b, 299792458.0 * delay, atol=MILLIMETRE)
    ranges = pseudoranges(with_air, navigation, "G", "p_two")
    assert np.isinf(ranges.frequency).all()
    assert not ranges.group_delay.any()
    assert pytest.approx((77 / 60) ** 2) == (L1 / L2) ** 2


def test_a_fault_begins_when_it_does() -> None:
    navigation = constellation(3)
    name = str(simulate_ranges(SILENT, navigation, T, WHERE).satellite[0])
    plain, off = (
        simulate_ranges(SILENT, navigation, T, WHERE, faults=f) for f in ((), (Fault(name, 3.0, 0.01, 300.0),))
    )
    change = off.values["C1C"] - plain.values["C1C"]
    expected = np.where(off.satellite == name, np.array([0.0, 3.0, 6.0, 9.0])[off.epoch], 0.0)
    np.testing.assert_allclose(change, expected, atol=1e-6)


def test_a_chip_a_tenth_as_long_has_a_tenth_of_the_noise() -> None:
    power = np.array([35.0, 45.0])
    a, p = CodeReceiver("a", ("C1C",), 293.05), CodeReceiver("b", ("C1C",), 29.305)
    np.testing.assert_allclose(a.sigma(power), 10.0 * p.sigma(power))
    assert a.sigma(np.array([45.0]))[0] == pytest.approx(293.05 * np.sqrt(0.25 / 10**4.5), rel=0.01)
    for name, total in (("course_ca", 20.0), ("course_p", 2.0)):
        one = CLASSES[name]
        assert np.hypot(one.sigma(power)[0], one.slow(np.array([1.0]))[0]) == pytest.approx(total)


@pytest.mark.parametrize("order", [1, 2])
def test_draws_have_the_autocovariance_that_is_stated(order: int) -> None:
    """20,000 processes at uneven instants: within five sigma of each entry."""
    process, t = RangeError(2.0, 30.0, order), np.array([0.0, 1.0, 2.0, 12.0, 50.0, 90.0])
    drawn = process.draw(t, 20_000, np.random.default_rng(1))
    expected = process.autocovariance(t[:, None] - t[None, :])
    scatter = np.sqrt((expected**2 + 16.0) / 20_000)
    assert np.max(np.abs(drawn @ drawn.T / 20_000 - expected) / scatter) < 5.0


def test_the_variance_of_an_aged_correction_by_hand() -> None:
    """One measurement, first order: 2 s^2 (1 - exp(-a / T)) + noise; a line through a straight line predicts it."""
    one = aged_variance((RangeError(3.0, 40.0),), 0.25, np.zeros(1), np.ones(1), 10.0)
    assert one == pytest.approx(2.0 * 9.0 * (1.0 - np.exp(-0.25)) + 0.25)
    back = np.arange(11.0)
    assert line_weights(back, 7.0) @ (5.0 - 0.3 * back) == pytest.approx(5.0 + 0.3 * 7.0)
    held = np.polyval(np.polyfit(-back, np.sin(back), 1), 0.0)
    assert line_weights(back, 7.0, rate=False) @ np.sin(back) == pytest.approx(held)


@pytest.mark.parametrize(("loss", "run"), [(0.0, None), (0.3, None), (0.4, 6.0)])
def test_the_mean_age_is_that_of_the_chain_of_losses(loss: float, run: float | None) -> None:
    """200,000 messages; asked ten times between each two."""
    link = DataLink(interval=5.0, delay=3.0, loss=loss, run=run, seed=2)
    t = 5.0 * np.arange(200_000)
    there = t[link.arrived(t)]
    asked = 1e3 + 0.25 + 0.5 * np.arange(1_900_000)
    age = asked - there[np.searchsorted(there, asked - link.delay, side="right") - 1]
    assert np.mean(age) == pytest.approx(link.mean_age, rel=0.02)
    assert len(there) / len(t) == pytest.approx(1.0 - loss, abs=0.01)


def test_raw_observations_and_corrections_say_the_same_where_nothing_is_lost() -> None:
    """But for the steps of the message: 2 cm, and 2 mm/s over the age."""
    navigation = constellation(3)
    t = START + np.arange(60.0)
    where = np.tile(simulation.RECEIVER, (60, 1))
    base, rover = (
        pseudoranges(simulate_ranges(CLASSES["ca"], navigation, t, where, seed=k), navigation, "G") for k in (0, 1)
    )
    found = [
        apply_link(base, where[0], DataLink(content, 0.0, delay=5.0), rover, navigation, ())
        for content in ("corrections", "raw")
    ]
    np.testing.assert_array_equal(found[0].age, found[1].age)
    assert np.nanmax(np.abs(found[0].value - found[1].value)) < 0.01 + 5.0 * 0.001 + 1e-9
    assert np.isnan(found[0].value[rover.time < t[0] + 5.0]).all()
    assert np.nanmax(found[0].age) == 5.0


def test_a_base_that_sends_knows_nothing_of_what_comes() -> None:
    """A jump after an epoch changes no correction of that epoch."""
    navigation = constellation(3)
    t = START + np.arange(40.0)
    where = np.tile(simulation.RECEIVER, (40, 1))
    base = pseudoranges(simulate_ranges(CLASSES["ca"], navigation, t, where), navigation, "G")
    jumped = replace(
        base, value=base.value + np.where((base.epoch >= 20) & (base.satellite == base.satellite[0]), 50.0, 0.0)
    )
    early = base.epoch < 20
    for past, same in ((True, True), (False, False)):
        a, b = (dgps.corrections(one, where[0], (), lowest=-2.0, past=past) for one in (base, jumped))
        assert np.allclose(a.value[early], b.value[early]) is same


def test_a_link_is_read_and_what_it_cannot_be_is_said() -> None:
    assert parse_link("delay=5, loss=0.2,content=raw,rate=no") == DataLink("raw", delay=5.0, loss=0.2, rate=False)
    for text, expected in (("speed=3", "interval=S"), ("loss=1", "below 1"), ("loss=0.9,run=2", "at least 9")):
        with pytest.raises(InputError, match=expected):
            parse_link(text)
