"""Fixes are measured at regular instants, whenever their message was logged."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.calibration.levels import instants as rule
from sinan.calibration.levels.instants import at_regular_instants, regular_instants
from sinan.sensors.recording import Recording, Stream


def logged(n: int = 600, period: float = 0.2, seed: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """(n,) instants of fixes and the stamps of a loop of 50 Hz that begins anywhere: a part of them one turn early; a
    clock that is 40 ppm fast; fixes that are missing.
    """
    rng = np.random.default_rng(seed)
    instants = 3.0 + period * np.delete(np.arange(n), [50, 51, 52, 300]) * (1.0 + 40e-6)
    return instants, instants + 0.11 - 0.02 * (rng.random(len(instants)) < 0.2)


def test_stamps_of_a_loop_become_regular_and_keep_how_late_they_are() -> None:
    instants, stamps = logged()
    assert np.max(np.abs(regular_instants(stamps) - instants - 0.11)) < 1e-3


def test_lateness_that_grows_is_followed() -> None:
    instants, stamps = logged()
    growing = 0.05 * np.sin((instants - instants[0]) / 60.0)
    assert np.max(np.abs(regular_instants(stamps + growing) - instants - growing - 0.11)) < 3e-3


@pytest.mark.parametrize("neighbours", [rule.NEIGHBOURS, 2 * rule.NEIGHBOURS])
def test_as_many_and_twice_as_many_neighbours_follow_a_lateness(
    neighbours: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rule, "NEIGHBOURS", neighbours)
    test_lateness_that_grows_is_followed()


def test_half_as_many_neighbours_take_stamps_that_are_early_for_a_lateness(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rule, "NEIGHBOURS", rule.NEIGHBOURS // 2)
    instants, stamps = logged()
    assert np.max(np.abs(regular_instants(stamps) - instants - 0.11)) > 0.015


@pytest.mark.parametrize(("factor", "stay"), [(0.5, [True, True]), (1.0, [False, True]), (2.0, [False, False])])
def test_half_and_twice_of_what_is_regular(factor: float, stay: list[bool], monkeypatch: pytest.MonkeyPatch) -> None:
    """Stamps of which three in four scatter by less than 0.07 and 0.15 of the period; one off by 0.18 and 0.35."""
    instants, _ = logged()
    spread = np.random.default_rng(2).uniform(-1.0, 1.0, len(instants)) / 0.75
    with monkeypatch.context() as changed:
        changed.setattr(rule, "REGULAR", factor * rule.REGULAR)
        stamps = [instants + 0.2 * scatter * spread for scatter in (0.07, 0.15)]
        assert [np.array_equal(regular_instants(t), t) for t in stamps] == stay
    monkeypatch.setattr(rule, "NEAR", factor * rule.NEAR)
    for off, stays in zip((0.18, 0.35), stay, strict=True):
        t = instants.copy()
        t[200] += 0.2 * off
        assert (regular_instants(t)[200] == t[200]) == stays


def test_stamps_that_are_regular_or_that_are_of_no_regular_receiver_stay() -> None:
    instants, _ = logged()
    assert regular_instants(instants) == pytest.approx(instants, abs=1e-6)
    irregular = np.cumsum(np.random.default_rng(6).uniform(0.5, 1.5, 400))
    assert np.array_equal(regular_instants(irregular), irregular)
    assert np.array_equal(regular_instants(irregular[:5]), irregular[:5])


def test_a_stamp_far_from_its_instant_stays_and_two_logs_are_two_clocks() -> None:
    instants, stamps = logged()
    stamps[200] += 0.07
    assert regular_instants(stamps)[200] == stamps[200]
    later = instants + 1000.077
    columns = {axis: np.zeros(2 * len(instants)) for axis in ("north", "east", "down")}
    both = Stream(np.concatenate([logged()[1], later]), columns)
    found = at_regular_instants(Recording("here", "flight", {"gps": both}, breaks=(900.0,)))[0].streams["gps"].t
    assert np.max(np.abs(found - np.concatenate([instants + 0.11, later]))) < 1e-3


def test_a_recording_says_how_far_its_stamps_were_moved() -> None:
    instants, stamps = logged()
    columns = dict.fromkeys(("north", "east", "down"), 0.1 * instants)
    recording, notes = at_regular_instants(Recording("here", "flight", {"gps": Stream(stamps, columns)}))
    assert np.array_equal(recording.streams["gps"]["north"], columns["north"])
    assert np.max(np.abs(recording.streams["gps"].t - instants - 0.11)) < 1e-3
    assert notes == ["gps: stamps moved by up to 20 ms, to regular instants every 0.2 s"]
    assert at_regular_instants(Recording("here", "flight", {"gps": Stream(instants, columns)}))[1] == []
