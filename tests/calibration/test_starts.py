"""A log that begins badly: a first reading far off."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.calibration.levels.preparation import prepared
from sinan.estimator.filter.layout import P_N
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import Initial, Recording, Stream
from tests.estimator.analytic_flight import fly


@pytest.fixture(scope="module")
def flown() -> tuple[Recording, FloatArray]:
    """Half a minute that declares nothing but its field, and the true states."""
    recording, truth = fly(1, duration=30.0, sensors=("mag", "baro", "gps"))
    return recording.replace(sensors={}, initial=Initial()), truth


def with_stream(recording: Recording, name: str, **columns: FloatArray) -> Recording:
    """With other columns in a stream."""
    stream = recording.streams[name]
    return recording.replace(streams={**recording.streams, name: Stream(stream.t, {**stream.columns, **columns})})


@pytest.mark.parametrize(("name", "column", "off"), [("gps", "north", 500.0), ("baro", "height", -1000.0)])
def test_one_first_reading_does_not_move_a_flight(
    flown: tuple[Recording, FloatArray], name: str, column: str, off: float
) -> None:
    """All readings after it were doubted: a first fix 500 m off moved an aeroplane by 490 m for good, a first height
    1000 m off lifted one by 840 m.
    """
    recording, truth = flown
    wrong = recording.streams[name][column].copy()
    wrong[0] += off
    ready = prepared(with_stream(recording, name, **{column: wrong}))
    assert (
        f"{name}: the first reading, far from what follows as no motion is, left out: it had not settled" in ready.notes
    )
    away = ready.run().imu_x[:, P_N] - truth[:, P_N]
    assert np.sqrt(np.mean(np.sum(away[len(away) // 2 :] ** 2, axis=1))) < 5.0
