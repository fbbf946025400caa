"""Gauss-Newton with halved steps, of an angle whose tangent is linear: whole steps from far off lead ever farther."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.estimator.evidence.gauss_newton import least
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError


def cost(x: FloatArray) -> float:
    return float(np.arctan(x[0]) ** 2)


def ahead(x: FloatArray, halvings: int = 11) -> tuple[FloatArray, int] | None:
    return None if abs(x[0]) < 1e-9 else (-np.arctan(x) * (1.0 + x**2), halvings)


def moved(x: FloatArray, step: FloatArray) -> FloatArray:
    return x + step


def within(x: FloatArray, step: FloatArray) -> FloatArray:
    if np.abs(x + step) > 10.0:
        raise InputError("here", f"{x + step}", "what has a model")
    return x + step


@pytest.mark.parametrize("tried", [moved, within])
def test_steps_that_lead_up_or_to_no_model_are_halved(tried: object) -> None:
    assert abs(least(np.array([9.0]), cost, ahead, tried, 50)[0]) < 1e-9  # type: ignore[arg-type]


def test_a_step_is_halved_as_often_as_it_is_worth() -> None:
    assert least(np.array([9.0]), cost, lambda x: ahead(x, 1), moved, 50)[0] == 9.0


def test_no_more_points_are_tried_than_are_allowed() -> None:
    points = []

    def tried(x: FloatArray, step: FloatArray) -> FloatArray:
        points.append(x + step)
        return points[-1]

    least(np.array([9.0]), cost, ahead, tried, 4)
    assert len(points) == 3


def test_a_step_that_gains_too_little_is_the_last() -> None:
    reached = least(np.array([1.0]), cost, ahead, moved, 50, settled=1e9)
    assert reached[0] == 1.0 + ahead(np.array([1.0]))[0][0]  # type: ignore[index]
