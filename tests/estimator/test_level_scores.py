"""Derivatives of the likelihood by every level against differences of the likelihood itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.estimator.evidence.level_scores import LevelScores, level_scores
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import FlightModel, flight_model
from sinan.estimator.filter.inputs import RunInputs, prepare
from sinan.estimator.filter.layout import DTHETA
from sinan.sensors.recording import Recording, SensorSpec
from tests.estimator.analytic_flight import SPECS, fly
from tests.estimator.test_engines import COLOURED

#: What differences leave, of the larger of the two and of one; a compass on a slope of the motion is not quite linear.
AGREEMENT, OF_ONE, CURVED = 0.03, 0.1, 0.25
STEP = 1e-3
ALL = {**SPECS, **COLOURED}


@pytest.fixture(scope="module")
def recording() -> Recording:
    return fly(11, duration=25.0)[0]


def model_of(recording: Recording, specs: dict[str, SensorSpec]) -> FlightModel:
    return flight_model(recording, specs=specs, gate_level=None)


def known_attitude(recording: Recording, specs: dict[str, SensorSpec]) -> RunInputs:
    """A run whose start is known well, so that it is linear in what is left."""
    inputs = prepare(Flight(recording, model_of(recording, specs)))
    P = inputs.P.copy()
    P[DTHETA, :], P[:, DTHETA] = 0.0, 0.0
    P[DTHETA, DTHETA] = 1e-6 * np.eye(3)
    return replace(inputs, P=P)


@pytest.fixture(scope="module")
def scored(recording: Recording) -> tuple[RunInputs, LevelScores]:
    inputs = known_attitude(recording, ALL)
    return inputs, level_scores(inputs)


def by_difference(recording: Recording, sensor: str, key: str) -> float:
    """d log L / d log of a size by central differences of whole runs."""
    ends = []
    for sign in (1.0, -1.0):
        value = getattr(ALL[sensor], key) * np.exp(sign * STEP)
        journal = run(known_attitude(recording, {**ALL, sensor: replace(ALL[sensor], **{key: value})}), "numba", 0)
        ends.append(journal.log_likelihood)
    return float((ends[0] - ends[1]) / (2.0 * STEP))


def of_rows(inputs: RunInputs, scores: LevelScores, sensor: str, part: slice) -> float:
    k = np.flatnonzero(inputs.events.sensor == inputs.events.sensors.index(sensor))
    rows = (inputs.events.row[k][:, None] + np.arange(inputs.model.sensors[sensor].size)[part]).ravel()
    return float(2.0 * np.sum(scores.r[rows] * inputs.events.r[rows]))


@pytest.mark.parametrize(
    ("sensor", "key", "part"),
    [
        ("gps", "noise_std", slice(0, 3)),
        ("gps", "velocity_noise_std", slice(3, 6)),
        ("baro", "noise_std", slice(None)),
        ("laser", "noise_std", slice(None)),
    ],
)
def test_white_noise_of_readings(
    recording: Recording, scored: tuple[RunInputs, LevelScores], sensor: str, key: str, part: slice
) -> None:
    expected = by_difference(recording, sensor, key)
    assert of_rows(*scored, sensor, part) == pytest.approx(expected, rel=AGREEMENT, abs=OF_ONE)


@pytest.mark.parametrize("sensor", ["accel", "gyro"])
def test_white_noise_of_the_imu(recording: Recording, scored: tuple[RunInputs, LevelScores], sensor: str) -> None:
    inputs, scores = scored
    by, q = getattr(scores, f"q_{sensor}"), getattr(inputs.imu, f"q_{sensor}")
    expected = by_difference(recording, sensor, "noise_density")
    assert 2.0 * np.sum(by * q) == pytest.approx(expected, rel=AGREEMENT, abs=OF_ONE)


@pytest.mark.parametrize(
    ("sensor", "key", "block"),
    [
        ("gps", "colour_std", "c_gps"),
        ("gps", "velocity_colour_std", "c_gps_velocity"),
        ("baro", "colour_std", "c_baro"),
        ("gps", "bias_walk", "b_gps"),
        ("accel", "bias_walk", "b_accel"),
        ("gyro", "bias_walk", "b_gyro"),
    ],
)
def test_biases_and_colour(
    recording: Recording, scored: tuple[RunInputs, LevelScores], sensor: str, key: str, block: str
) -> None:
    inputs, scores = scored
    place = inputs.model.layout.slice(block)
    found = 2.0 * float(np.sum(scores.bias[place]))
    if "colour" in key:  # it is stationary from the start
        found += 2.0 * float(np.trace(scores.start[place, place])) * float(inputs.P[place.start, place.start])
    assert found == pytest.approx(by_difference(recording, sensor, key), rel=AGREEMENT, abs=OF_ONE)


@pytest.mark.parametrize(("sensor", "blocks"), [("gps", ("c_gps", "c_gps_velocity")), ("baro", ("c_baro",))])
def test_time_constants(
    recording: Recording, scored: tuple[RunInputs, LevelScores], sensor: str, blocks: tuple[str, ...]
) -> None:
    inputs, scores = scored
    time = np.sum(scores.time_of_part, axis=0)
    found = sum(float(np.sum(time[inputs.model.layout.slice(block)])) for block in blocks)
    assert found == pytest.approx(by_difference(recording, sensor, "colour_time"), rel=AGREEMENT, abs=OF_ONE)


def test_a_magnetometer_but_for_its_curvature(recording: Recording, scored: tuple[RunInputs, LevelScores]) -> None:
    expected = by_difference(recording, "mag", "noise_std")
    assert of_rows(*scored, "mag", slice(None)) == pytest.approx(expected, rel=CURVED, abs=OF_ONE)


def test_scores_do_not_depend_on_the_stretches(
    scored: tuple[RunInputs, LevelScores], monkeypatch: pytest.MonkeyPatch
) -> None:
    inputs, whole = scored
    monkeypatch.setattr("sinan.estimator.evidence.level_scores.PART", 700)
    parts = level_scores(inputs)
    assert np.allclose(parts.r, whole.r, rtol=1e-6, atol=1e-6 * np.max(np.abs(whole.r)))
    assert np.allclose(parts.bias, whole.bias, rtol=1e-6, atol=1e-9)
