"""Bounds of place and speed: what they say of a motion, by numbers written out here."""

from __future__ import annotations

import numpy as np

from sinan.sensors.bounds import Bounds
from sinan.sensors.motion import Motion


def a_motion() -> Motion:
    """Two instants, half a metre north and one down, the second turned and on its way west."""
    turned = [np.cos(1.0), 0.0, 0.0, np.sin(1.0)]
    return Motion(
        t=np.array([0.0, 0.5]), p_n=np.array([[0.5, 0.0, 0.0], [0.5, -0.2, 1.0]]),
        v_n=np.array([[0.1, 0.0, 0.0], [0.0, -0.8, 0.3]]), q_nb=np.array([[1.0, 0.0, 0.0, 0.0], turned]),
    )  # fmt: skip


def test_the_place_reads_how_far_off_the_body_is() -> None:
    place = Bounds(place=0.5, speed=2.0).sensors["place"]
    assert np.array_equal(place.predict(a_motion()), [[0.5, 0.0, 0.0], [0.5, -0.2, 1.0]])
    assert np.array_equal(place.R, np.diag([0.25, 0.25, 0.25]))
    assert np.array_equal(place.jacobian(a_motion())["position"], np.array([np.eye(3), np.eye(3)]))
    assert place.bias is None


def test_a_height_that_is_measured_is_not_bounded() -> None:
    place = Bounds(place=0.5, speed=2.0, height=False).sensors["place"]
    assert np.array_equal(np.diag(place.R)[:2], [0.25, 0.25])
    assert place.R[2, 2] > 1e6


def test_the_speed_reads_how_fast_it_is() -> None:
    speed = Bounds(place=0.5, speed=2.0).sensors["speed"]
    assert np.array_equal(speed.predict(a_motion()), [[0.1, 0.0, 0.0], [0.0, -0.8, 0.3]])
    assert np.array_equal(speed.R, np.diag([4.0, 4.0, 4.0]))
    assert np.array_equal(speed.jacobian(a_motion())["velocity"], np.array([np.eye(3), np.eye(3)]))
    assert speed.bias is None
