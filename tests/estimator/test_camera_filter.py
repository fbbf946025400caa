"""A camera that sees known points in the filter: what it gains, that it knows its errors, and effects of its own."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from sinan.estimator.evidence.sensitivity import sensitivity_pass
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import FlightModel, flight_model
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.layout import P_N, Q_NB
from sinan.estimator.filter.run_filter import run_filter
from sinan.estimator.filter.smoother import estimated_motion, smooth
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.arrays import FloatArray
from sinan.sensors.camera import Camera, Intrinsics
from sinan.sensors.covariates import camera_of, seen_points
from sinan.sensors.effects import effect
from sinan.sensors.errors import InputError
from sinan.sensors.formats.plain import read_recording, write_recording
from sinan.sensors.motion import Motion
from sinan.sensors.recording import Recording, SensorSpec, Stream
from sinan.sensors.rotation import (
    quaternion_conjugate,
    quaternion_from_matrix,
    quaternion_log,
    quaternion_multiply,
    rotation_exp,
)
from sinan.sensors.simulate import simulate

FALSE_ALARM = 1e-3
SIZE = np.array([640.0, 480.0])
#: Looks ahead and 40 deg down
C_BC = rotation_exp(np.array([0.0, -0.7, 0.0])) @ np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
CAMERA = Camera(0.7, Intrinsics(np.array([350.0, 352.0]), np.array([321.0, 238.0])), C_BC, np.array([0.12, 0.0, 0.05]))
SPEC = SensorSpec(
    noise_std=CAMERA.sigma, focal=CAMERA.intrinsics.f, centre=CAMERA.intrinsics.centre, lens="brown",
    mounting=quaternion_from_matrix(C_BC), lever_arm=CAMERA.l_b,
)  # fmt: skip


def with_camera(recording: Recording, truth: Motion, name: str, beta: FloatArray) -> Recording:
    """The flight with a camera that takes five pictures a second of marks on the ground, with an effect in it.

    Parameters
    ----------
    truth : of the flight, at many instants
    """
    rng = np.random.default_rng(1)
    t = np.arange(truth.t[0] + 0.3, truth.t[-1] - 0.3, 0.2)
    at = truth.at(t)
    places = np.column_stack([rng.uniform(-40.0, 40.0, (250, 2)), rng.uniform(-0.5, 0.5, 250)])
    rows = []
    for k in range(len(t)):
        uv = CAMERA.predict(at.rows(np.full(len(places), k)).with_covariates(point_n=places))
        with np.errstate(invalid="ignore"):
            inside = np.flatnonzero(np.all((uv > 0.0) & (uv < SIZE), axis=1))
        rows += [(t[k], float(i)) for i in inside[:6]]
    stamps, numbers = np.array(rows).T
    there = truth.at(stamps).with_covariates(point_n=places[numbers.astype(int)], camera=CAMERA.covariate(len(stamps)))
    plain = CAMERA.predict(there)
    if name == "camera.time_offset":
        earlier = truth.at(stamps - beta[0]).with_covariates(**there.covariates)
        plain = CAMERA.predict(earlier)
    elif name:
        plain = effect(name).apply(plain, beta, there, CAMERA)
    uv = plain + CAMERA.sigma * rng.standard_normal(plain.shape)
    stream = Stream(stamps, {"point": numbers, "u": uv[:, 0], "v": uv[:, 1]})
    return recording.replace(
        streams={**recording.streams, "camera": stream}, sensors={**recording.sensors, "camera": SPEC},
        points=np.column_stack([np.arange(len(places)), places]),
    )  # fmt: skip


@cache
def flown(name: str = "", beta: tuple[float, ...] = ()) -> tuple[Recording, Motion]:
    """Forty seconds of a square with everything and a camera, and the truth."""
    scenario = load_scenario("square")
    recording, _ = simulate(scenario, np.random.default_rng(3))
    streams = {n: s.rows(s.t < 40.0) for n, s in recording.streams.items()}
    recording = recording.replace(streams=streams)
    imu = recording.streams["imu"].t
    truth = scenario.trajectory().motion(np.arange(imu[0], imu[-1], 0.005))
    return with_camera(recording, truth, name, np.array(beta)), truth


def model_of(recording: Recording) -> FlightModel:
    return flight_model(recording, gate_level=None)


def errors(journal: Journal, truth: Motion) -> tuple[FloatArray, FloatArray]:
    """Position [m] and attitude [rad] errors of the filter along the IMU's instants, after ten seconds."""
    late = (journal.imu_t > journal.imu_t[0] + 10.0) & (journal.imu_t < truth.t[-1])
    x, at = journal.imu_x[late], truth.at(journal.imu_t[late])
    turn = quaternion_log(quaternion_multiply(quaternion_conjugate(x[:, Q_NB]), at.q_nb))
    return x[:, P_N] - at.p_n, turn


def test_a_camera_makes_a_flight_ten_times_as_sure_of_its_place() -> None:
    recording, truth = flown()
    bare = recording.replace(streams={n: s for n, s in recording.streams.items() if n != "camera"})
    without, with_it = (errors(run_filter(Flight(r, model_of(r))), truth) for r in (bare, recording))
    rms = [[float(np.sqrt(np.mean(np.sum(e**2, axis=1)))) for e in pair] for pair in (without, with_it)]
    assert rms[1][0] < 0.1 * rms[0][0]
    assert rms[1][1] < 0.7 * rms[0][1]


def test_its_innovations_are_as_large_as_they_say() -> None:
    recording, _ = flown()
    journal = run_filter(Flight(recording, model_of(recording)))
    nis = journal.stream("camera").nis
    assert np.sum(np.isfinite(nis)) > 500
    low, high = chi2.ppf([FALSE_ALARM / 2, 1.0 - FALSE_ALARM / 2], 2 * np.sum(np.isfinite(nis)))
    assert low < np.nansum(nis) < high


def test_the_state_is_off_by_as_much_as_its_covariance_says() -> None:
    """Position and attitude at the end of the flight, in sigma: no one of six beyond four."""
    recording, truth = flown()
    journal = run_filter(Flight(recording, model_of(recording)))
    at = truth.at(journal.imu_t[-1:])
    error = np.concatenate(
        [
            at.p_n[0] - journal.x_end[P_N],
            quaternion_log(quaternion_multiply(quaternion_conjugate(journal.x_end[Q_NB]), at.q_nb[0])),
        ]
    )
    P = journal.P_end[np.ix_([0, 1, 2, 6, 7, 8], [0, 1, 2, 6, 7, 8])]
    assert error @ np.linalg.solve(P, error) < chi2.isf(FALSE_ALARM, 6)
    assert np.sqrt(P[0, 0]) < 0.1


def test_both_engines_agree() -> None:
    recording, _ = flown()
    part = {n: s.rows(s.t < recording.streams["imu"].t[0] + 4.0) for n, s in recording.streams.items()}
    short = recording.replace(streams={n: s for n, s in part.items() if len(s) > 1})
    a, b = (run_filter(Flight(short, model_of(short)), engine=engine) for engine in ("numba", "filterpy"))  # type: ignore[arg-type]
    np.testing.assert_allclose(a.x_end, b.x_end, atol=1e-9)
    np.testing.assert_allclose(a.P_end, b.P_end, atol=1e-9)


SIZES = {
    "camera.focal": (0.02, -0.015),
    "camera.principal_point": (8.0, -6.0),
    "camera.distortion": (-0.1, 0.05, 2e-3, -1e-3),
    "camera.misalignment": (0.03, -0.02, 0.04),
    "camera.lever_arm": (0.15, -0.1, 0.1),
    "camera.time_offset": (0.04,),
}


@pytest.mark.parametrize("name", SIZES)
def test_an_effect_in_the_model_takes_the_error_away(name: str) -> None:
    """Without it the innovations are too large; with it, in its exact form, they are noise."""
    recording, _ = flown(name, SIZES[name])
    plain = run_filter(Flight(recording, model_of(recording)))
    known = run_filter(Flight(recording, model_of(recording)), {name: np.array(SIZES[name])})
    before, after = (float(np.nanmean(journal.stream("camera").nis)) / 2.0 for journal in (plain, known))
    assert before > 1.3
    assert after == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("name", SIZES)
def test_innovations_answer_as_the_sensitivity_says(name: str) -> None:
    """Central differences of whole runs, projected on S^-1/2 S_beta, against it, as of every other sensor's effects."""
    recording, _ = flown()
    part = {n: s.rows(s.t < 20.0) for n, s in recording.streams.items()}
    short = recording.replace(streams=part)
    model, entry = model_of(short), effect(name)
    motion = estimated_motion(run_filter(Flight(short, model)))
    journal, found = sensitivity_pass(Flight(short, model), [entry], motion=motion, keep_rows=1)

    def by_reading(one: Journal, rows: FloatArray) -> FloatArray:
        order = np.lexsort((one.index, one.sensor))
        return np.concatenate([rows[one.row[j] : one.row[j + 1]] for j in order])

    W = by_reading(journal, found.rows)
    for k in range(entry.size):
        size = min(0.02 * entry.plausible[k], 10.0 / np.linalg.norm(W[:, k]))
        runs = [run_filter(Flight(short, model), {name: sign * size * np.eye(entry.size)[k]}) for sign in (1.0, -1.0)]
        ahead, behind = (np.nan_to_num(by_reading(one, one.white)) for one in runs)
        change = -(ahead - behind) / (2.0 * size)
        assert change @ W[:, k] / (W[:, k] @ W[:, k]) == pytest.approx(1.0, abs=0.02), f"component {k}"


def test_a_recording_with_a_camera_is_written_and_read(tmp_path: Path) -> None:
    recording, _ = flown()
    write_recording(recording, tmp_path / "run")
    again = read_recording(tmp_path / "run")
    np.testing.assert_array_equal(again.points, recording.points)
    np.testing.assert_array_equal(again.streams["camera"].t, recording.streams["camera"].t)
    camera = camera_of(again)
    np.testing.assert_array_equal(camera.intrinsics.values, CAMERA.intrinsics.values)
    np.testing.assert_allclose(camera.C_bc, C_BC, atol=1e-12)
    np.testing.assert_array_equal(camera.l_b, CAMERA.l_b)
    assert camera.sigma == CAMERA.sigma


def test_what_a_camera_lacks_is_said() -> None:
    recording, _ = flown()
    for spec, says in (
        (replace(SPEC, focal=None), r"\[sensors.camera\] focal: not declared"),
        (replace(SPEC, coefficients=np.ones(7)), "a brown lens has at most"),
        (replace(SPEC, mounting=np.array([1.0, 1.0, 0.0, 0.0])), "mounting: norm 1.41"),
    ):
        with pytest.raises(InputError, match=says):
            camera_of(recording.replace(sensors={"camera": spec}))
    with pytest.raises(InputError, match=r"point 0; expected a point of points.csv|expected a point of points.csv"):
        seen_points(recording.replace(points=recording.points[200:]), len(recording.streams["camera"]))  # type: ignore[index]


def test_time_does_not_run_back_between_pictures() -> None:
    recording, _ = flown()
    stream = recording.streams["camera"]
    turned = Stream(stream.t[::-1], dict(stream.columns))
    with pytest.raises(InputError, match="increasing time"):
        recording.replace(streams={**recording.streams, "camera": turned})


def test_the_smoother_takes_it_too() -> None:
    """Its place is better than the filter's, which does not know what comes later."""
    recording, truth = flown()
    journal = run_filter(Flight(recording, model_of(recording)))
    late = (journal.imu_t > 5.0) & (journal.imu_t < truth.t[-1])
    rms = [
        float(np.sqrt(np.mean((x[late, P_N] - truth.at(journal.imu_t[late]).p_n) ** 2)))
        for x in (journal.imu_x, smooth(journal).x)
    ]
    assert rms[1] < rms[0]
