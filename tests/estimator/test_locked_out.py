"""A filter that starts far off believes no reading any more: its gate gives way, with effects in the model too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.layout import V_N
from sinan.estimator.filter.run_filter import run_filter
from tests.estimator.analytic_flight import fly


@pytest.mark.parametrize("betas", [{}, {"gps.lever_arm": [0.3, 0.0, -0.1]}], ids=["plain", "effects"])
@pytest.mark.parametrize("relinearise", [False, True])
def test_a_lost_filter_is_led_back(betas: dict[str, list[float]], relinearise: bool) -> None:
    """8 m/s off where 0.2 are said: refused for good, the velocity would stay lost; weighed, it is found."""
    recording, truth = fly(4, duration=20.0)
    assert recording.initial.velocity is not None
    lost = recording.replace(initial=replace(recording.initial, velocity=recording.initial.velocity + 8.0))
    journal = run_filter(Flight.of(lost, relinearise=relinearise), betas, engine="numba")
    assert np.linalg.norm(journal.imu_x[-1, V_N] - truth[-1, V_N]) < 0.5
    assert any("doubtful readings were given less weight" in str(note) for note in journal.notes)
