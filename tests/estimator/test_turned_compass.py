"""The turn of a compass's axes against those of the IMU as a state, by other derivations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sinan.calibration.levels.levels import first_levels
from sinan.calibration.levels.sizes import sizes_of
from sinan.estimator.evidence.observability import is_nuisance
from sinan.estimator.evidence.sensitivity import sensitivity_pass
from sinan.estimator.filter.alignment import first_state
from sinan.estimator.filter.effect_forms import Terms, reference_motion
from sinan.estimator.filter.engine_filterpy import ReadableFilter
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import FlightModel, flight_model
from sinan.estimator.filter.inputs import prepare
from sinan.estimator.filter.layout import DTHETA, Q_NB
from sinan.estimator.filter.relinearise import run_relinearised
from sinan.estimator.filter.run_filter import run_filter
from sinan.estimator.filter.smoother import smooth
from sinan.sensors.arrays import FloatArray
from sinan.sensors.bounds import Bounds
from sinan.sensors.effects import effect
from sinan.sensors.recording import MAG, Initial, Recording, SensorSpec, Stream
from sinan.sensors.rotation import quaternion_conjugate, quaternion_log, quaternion_multiply
from tests.estimator.analytic_flight import SPECS, analytic_motion, fly
from tests.estimator.test_engines import AGREEMENT, difference
from tests.estimator.test_gyro_axes import off_a_prior

TURN = np.array([0.02, -0.015, 0.025])
STD = 0.02


def turned(duration: float, share: float = 1.0, t: FloatArray = TURN, sensors: tuple[str, ...] = ("mag",)) -> Recording:
    """An attitude flight whose compass is turned by so much of t."""
    recording, _ = fly(22, duration=duration, sensors=sensors)
    mag = recording.streams["mag"]
    read = Rotation.from_rotvec(-share * t).apply(mag.array(MAG))
    return recording.replace(
        streams={**recording.streams, "mag": Stream(mag.t, {**mag.columns, **dict(zip(MAG, read.T, strict=True))})}
    )


def model_of(recording: Recording, std: float = STD, field_std: float = 0.01) -> FlightModel:
    specs: dict[str, SensorSpec] = {"mag": replace(SPECS["mag"], bias_walk=0.0)}
    field = field_std**2 * np.eye(3) if field_std else None
    return flight_model(
        recording, specs=specs, bounds=Bounds(6.0, 4.0), field=field, gate_level=None, axes_std=0.01, turned_std=std
    )


def test_the_engines_agree() -> None:
    flight = Flight(turned(5.0), model_of(turned(5.0)))
    fast, slow = (run_filter(flight, engine=engine) for engine in ("numba", "filterpy"))
    assert difference(fast, slow) < AGREEMENT
    place = flight.model.layout.nominal("s_mag")
    assert np.max(np.abs(fast.imu_x[-1, place])) > 1e-3
    fast, slow = (run_relinearised(flight, engine=engine) for engine in ("numba", "filterpy"))
    assert difference(fast, slow) < AGREEMENT


def test_h_is_the_derivative_of_the_prediction() -> None:
    """By the readable engine: a step of the state, and what the prediction of a reading changes by."""
    flight = Flight(turned(1.0), model_of(turned(1.0)))
    engine, layout = ReadableFilter(prepare(flight)), flight.model.layout
    engine.x[layout.nominal("s_mag")], engine.x[layout.nominal("field")] = TURN, [0.02, 0.01, -0.03]
    k = int(np.flatnonzero(engine.inputs.events.sensor == engine.inputs.events.sensors.index("mag"))[0])
    _, H = engine.prediction("mag", k)
    x = engine.x.copy()
    left_out = 2.0 * float(np.linalg.norm(TURN))  # of attitude and field: the turn of what they change
    for j in range(layout.n):
        d, ends = np.zeros(layout.n), []
        d[j] = 1e-6
        for sign in (1.0, -1.0):
            engine.x = layout.retract(x, sign * d)
            ends.append(engine.prediction("mag", k)[0])
        column = (ends[0] - ends[1]) / 2e-6
        own = j in range(*layout.slice("s_mag").indices(layout.n))
        assert np.max(np.abs(column - H[:, j])) < (1e-7 if own else left_out)


@pytest.mark.parametrize("sensors", [("mag",), ("mag", "gps")])
def test_the_first_attitude_knows_of_it(sensors: tuple[str, ...]) -> None:
    """Its covariance with t is what a turn of the readings turns it by; `align`, and `align_in_motion`."""

    def start(t: FloatArray) -> tuple[FloatArray, FloatArray]:
        recording = turned(25.0, t=t, sensors=sensors)
        return first_state(Flight(recording.replace(initial=Initial()), model))

    model = model_of(turned(25.0, sensors=sensors))
    straight, P = start(np.zeros(3))
    for axis in range(3):
        t = 1e-4 * np.eye(3)[axis]
        found, _ = start(t)
        error = quaternion_log(quaternion_multiply(quaternion_conjugate(found[Q_NB]), straight[Q_NB]))
        known = P[DTHETA, model.layout.slice("s_mag")][:, axis] / STD**2
        assert np.max(np.abs(error / 1e-4 - known)) < 0.05 * np.max(np.abs(known))


def test_it_is_what_the_effect_with_a_prior_is() -> None:
    """Friedland's separate-bias filter: information of the effect L without the state, (L^-1 + STD^2)^-1 with it."""
    recording = turned(30.0, 0.02)
    known = replace(recording.initial, quaternion=analytic_motion(np.zeros(1)).q_nb[0], attitude_std=1e-3)
    recording = recording.replace(initial=known)
    without = Flight(recording, model_of(recording, 0.0))
    journal = run_filter(without, engine="numba")
    motion = reference_motion(journal, Terms(), journal.run.imu)
    found = []
    for std in (0.0, STD):
        flight = Flight(recording, model_of(recording, std, 0.0)).believing(relinearise=True)
        _, one = sensitivity_pass(flight, [effect("mag.misalignment")], motion=motion)
        found.append(one.total[0])
    without_it, with_it = off_a_prior(found, STD)
    assert with_it < 0.05
    assert without_it > 1.0


def test_the_turn_is_found_and_the_attitude_is_nearer_for_it() -> None:
    recording, errors = turned(60.0), []
    t = recording.streams["imu"].t
    q_true = analytic_motion(t).q_nb
    for std in (0.0, STD):
        model = model_of(recording, std)
        smoothed = smooth(run_filter(Flight(recording, model), engine="numba"), sigmas=True)
        wrong = quaternion_log(quaternion_multiply(quaternion_conjugate(q_true), smoothed.x[:, Q_NB]))
        errors.append(float(np.sqrt(np.mean(np.sum(wrong**2, axis=1)))))
    place, part = model.layout.nominal("s_mag"), model.layout.slice("s_mag")
    assert np.max(np.abs(smoothed.x[0, place] - TURN) / smoothed.sigma[0, part]) < 4.0
    assert np.max(smoothed.sigma[0, part]) < 0.5 * STD
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize(
    ("streams", "specs", "there"),
    [
        (("mag",), {}, True),
        (("mag", "gps"), {}, True),
        (("mag",), {"mag": SensorSpec(noise_std=0.01)}, True),
        (("mag",), {"mag": SensorSpec(noise_std=0.01, bias_std=0.01, bias_walk=0.0)}, True),
        (("mag",), {"gyro": SensorSpec(noise_density=1e-4)}, False),
    ],
)
def test_it_is_a_state_where_nobody_declares_the_noise_of_the_gyroscope(
    streams: tuple[str, ...], specs: dict[str, SensorSpec], there: bool
) -> None:
    recording, _ = fly(3, duration=5.0, sensors=streams)
    recording = recording.replace(sensors=specs)
    levels = first_levels(recording, sizes_of(recording), None, None)
    assert levels.flight(recording).model.layout.has("s_mag") == there
    assert is_nuisance("s_mag")
