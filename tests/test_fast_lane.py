"""`pytest -m fast`: what is listed is there, is marked, and takes two minutes in all."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.conftest import FAST

TESTS = Path(__file__).parent
TWO_MINUTES = 120.0  # s, on one free core


def test_what_is_listed_is_there() -> None:
    assert [name for name in FAST if not (TESTS / name).is_file()] == []


def test_the_lane_is_as_long_as_is_said() -> None:
    assert sum(FAST.values()) <= TWO_MINUTES


def test_every_layer_is_in_the_lane() -> None:
    layers = {"sensors", "estimator", "calibration", "experiments", "contracts", "face"}
    assert layers <= {name.split("/")[0] for name in FAST}


def test_what_is_listed_is_marked(request: pytest.FixtureRequest) -> None:
    """This file is listed, so this test is marked; and of what was collected with it, all of the list and no more."""
    assert request.node.get_closest_marker("fast") is not None
    for item in request.session.items:
        listed = item.path.is_relative_to(TESTS) and item.path.relative_to(TESTS).as_posix() in FAST
        assert listed == (item.get_closest_marker("fast") is not None), item.nodeid
