"""The first attitude of a flight whose effects are known, and a base receiver that has nothing to see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.estimator.filter.alignment import align
from sinan.estimator.filter.effect_forms import Along, Terms
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import FlightModel, flight_model
from sinan.estimator.filter.imu import imu_table
from sinan.estimator.filter.layout import DTHETA, Q_NB
from sinan.estimator.filter.run_filter import run_filter
from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects import effect
from sinan.sensors.recording import MAG, POSITION, Initial, Recording, SensorSpec, Stream
from sinan.sensors.rotation import quaternion_conjugate, quaternion_log, quaternion_multiply
from tests.estimator.analytic_flight import SPECS, analytic_motion, fly

DEGREE = np.pi / 180.0
IRON = np.array([0.15, 0.02, -0.03])


@pytest.fixture(scope="module")
def bent() -> tuple[Recording, FloatArray]:
    """A flight of unknown first attitude with small errors beside iron that bends the field, and its true states."""
    recording, truth = fly(3, duration=5.0, noise=0.1)
    mag = recording.streams["mag"]
    field = mag.array(MAG) + effect("mag.cross_axis").regressor(analytic_motion(mag.t)) @ IRON
    streams = {**recording.streams, "mag": Stream(mag.t, dict(zip(MAG, field.T, strict=True)))}
    return recording.replace(streams=streams, initial=Initial()), truth


def start_error(recording: Recording, model: FlightModel, truth: FloatArray) -> float:
    """Angle between the first attitude and the true one [rad]."""
    q = align(Flight(recording, model))[0]
    return float(np.linalg.norm(quaternion_log(quaternion_multiply(quaternion_conjugate(truth[0, Q_NB]), q))))


def corrected(recording: Recording, model: FlightModel, beta: FloatArray) -> Recording:
    terms = Terms.of({"mag.cross_axis": beta})
    table = imu_table(Flight(recording, model))
    return Along(Flight(recording, model), terms, analytic_motion(table.t), table).without_effects


def test_bent_field_turns_the_start(bent) -> None:
    recording, truth = bent
    assert start_error(recording, flight_model(recording), truth) > DEGREE


def test_start_from_the_corrected_field_is_nearer_the_truth(bent) -> None:
    recording, truth = bent
    model = flight_model(recording)
    plain = start_error(recording, model, truth)
    assert start_error(corrected(recording, model, IRON), model, truth) < 0.5 * plain


def test_no_effect_leaves_the_field(bent) -> None:
    recording, _ = bent
    same = corrected(recording, flight_model(recording), np.zeros(3))
    assert np.array_equal(same.streams["mag"].array(MAG), recording.streams["mag"].array(MAG))


def test_filter_with_the_effect_starts_nearer_the_truth(bent) -> None:
    """Its first state, once it knows the effect."""
    recording, truth = bent
    model = flight_model(recording)
    errors = []
    for betas in ({}, {"mag.cross_axis": IRON}):
        journal = run_filter(Flight(recording, model), betas, engine="numba", stride=1)
        d = model.layout.difference(truth[:1], journal.x[:1])[0, DTHETA]
        errors.append(float(np.linalg.norm(d)))
    assert errors[1] < 0.5 * errors[0]


# ---- base receiver


def with_base(gps: SensorSpec) -> Recording:
    recording, _ = fly(5, duration=10.0)
    stamps = np.arange(10) + 0.5
    north, east, down = np.random.default_rng(6).normal(scale=0.3, size=(3, len(stamps)))
    base = Stream(stamps, dict(zip(POSITION, (north, east, down), strict=True)))
    specs = {**SPECS, "gps": gps, "base": SensorSpec(noise_std=0.3)}
    return recording.replace(streams={**recording.streams, "base": base}, sensors=specs)


WITHOUT_BIAS = replace(SPECS["gps"], bias_std=0.0, bias_walk=0.0)


def test_base_beside_a_gps_without_bias_is_left_out_with_a_note() -> None:
    model = flight_model(with_base(WITHOUT_BIAS))
    assert "base" not in model.sensors
    assert [note for note in model.notes if "base" in note] == [
        "base: left out, the gps is declared to have no bias that it could see"
    ]


def test_flight_with_that_base_is_that_without_it() -> None:
    recording = with_base(WITHOUT_BIAS)
    streams = {name: stream for name, stream in recording.streams.items() if name != "base"}
    alone = recording.replace(streams=streams)
    ends = [run_filter(Flight.of(r), engine="numba").x_end for r in (recording, alone)]
    assert np.array_equal(ends[0], ends[1])


def test_base_beside_a_gps_with_bias_is_used() -> None:
    assert "base" in flight_model(with_base(SPECS["gps"])).sensors
