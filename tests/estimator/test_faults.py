"""Bad input: a named error, or a journalled and bounded consequence; the state never becomes NaN in silence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.estimator.filter.engine import run
from sinan.estimator.filter.faults import frozen_runs, saturated_runs
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import flight_model
from sinan.estimator.filter.imu import imu_table
from sinan.estimator.filter.inputs import prepare
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.run_filter import run_filter
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.recording import GYRO, Initial, Recording, SensorSpec, Stream
from tests.estimator.analytic_flight import SPECS, fly

BOUND = 5.0  # sigma that an error may reach at the end of a flight with a fault in it


@pytest.fixture(scope="module")
def flown() -> tuple[Recording, FloatArray]:
    return fly(21, duration=30.0)


def with_stream(recording: Recording, name: str, **changes: FloatArray) -> Recording:
    """The recording with some columns (or `t`) of a stream replaced."""
    stream = recording.streams[name]
    t = changes.pop("t", stream.t)
    return recording.replace(streams={**recording.streams, name: Stream(t, {**stream.columns, **changes})})


def without_rows(recording: Recording, name: str, t0: float, t1: float) -> Recording:
    """The recording with a hole in a stream."""
    stream = recording.streams[name]
    return recording.replace(streams={**recording.streams, name: stream.rows((stream.t < t0) | (stream.t >= t1))})


def worst(journal: Journal, truth: FloatArray) -> float:
    """Largest error at the end in units of its own sigma."""
    assert np.all(np.isfinite(journal.x_end))
    error = journal.model.layout.difference(truth[-1:], journal.x_end[None])[0]
    return float(np.max(np.abs(error) / np.sqrt(np.diag(journal.P_end))))


@pytest.mark.parametrize("gap", [0.001, 0.012, 0.1, 1.0, 10.0])
def test_imu_gap(flown, gap: float) -> None:
    recording, truth = flown
    journal = run_filter(
        Flight(without_rows(recording, "imu", 10.0, 10.0 + gap), flight_model(recording)), engine="numba"
    )
    assert worst(journal, truth) < BOUND
    assert any("gap" in str(note) for note in journal.notes) == (gap > 0.01)


def test_imu_gap_costs_certainty(flown) -> None:
    """Inside the gap the noise is that of the unseen motion, hundreds of times the instruments'."""
    recording, _ = flown
    table = imu_table(Flight(without_rows(recording, "imu", 10.0, 11.0), flight_model(recording)))
    inside = (table.t[:-1] > 9.992) & (table.t[:-1] < 10.99)
    assert np.min(table.q_gyro[inside]) > 100.0 * np.median(table.q_gyro)
    assert np.min(table.q_accel[inside]) > 100.0 * np.median(table.q_accel)


@pytest.mark.parametrize("name", ["gps", "mag", "baro", "laser"])
def test_stream_missing(flown, name: str) -> None:
    recording, _ = flown
    streams = {key: stream for key, stream in recording.streams.items() if key != name}
    journal = run_filter(Flight.of(recording.replace(streams=streams)), engine="numba")
    assert np.all(np.isfinite(journal.x_end))
    assert name not in journal.sensors


@pytest.mark.parametrize(
    ("name", "column"), [("mag", "mag_x"), ("gps", "north"), ("baro", "height"), ("laser", "range")]
)
def test_frozen_stream_is_left_out(flown, name: str, column: str) -> None:
    recording, truth = flown
    stream = recording.streams[name]
    late = stream.t > 15.0
    stuck = {c: np.where(late, values[late][0], values) for c, values in stream.columns.items()}
    journal = run_filter(Flight(with_stream(recording, name, **stuck), flight_model(recording)), engine="numba")
    assert journal.counts()[name]["faulty"] >= late.sum() - 1
    assert worst(journal, truth) < BOUND


def test_frozen_imu_is_a_gap(flown) -> None:
    recording, truth = flown
    imu = recording.streams["imu"]
    held = (imu.t > 10.0) & (imu.t < 11.0)
    stuck = {c: np.where(held, values[held][0], values) for c, values in imu.columns.items()}
    journal = run_filter(Flight(with_stream(recording, "imu", **stuck), flight_model(recording)), engine="numba")
    assert any("frozen" in str(note) for note in journal.notes)
    assert worst(journal, truth) < BOUND


def test_saturated_gyroscope_is_journalled(flown) -> None:
    recording, _ = flown
    imu = recording.streams["imu"]
    clipped = {c: np.clip(imu[c], -0.5, 0.5) for c in GYRO}
    journal = run_filter(Flight(with_stream(recording, "imu", **clipped), flight_model(recording)), engine="numba")
    assert any("gyro: saturated" in str(note) for note in journal.notes)
    assert np.all(np.isfinite(journal.x_end))


def test_outliers_are_refused_and_journalled(flown) -> None:
    recording, truth = flown
    north = recording.streams["gps"]["north"].copy()
    north[50::40] += 100.0
    journal = run_filter(Flight(with_stream(recording, "gps", north=north), flight_model(recording)), engine="numba")
    assert journal.rejected()["gps"] == len(north[50::40])
    assert worst(journal, truth) < BOUND


def test_robust_weights_keep_every_reading(flown) -> None:
    recording, truth = flown
    north = recording.streams["gps"]["north"].copy()
    north[50::40] += 20.0
    model = flight_model(recording, gate_level=None, robust_level=1e-3)
    journal = run_filter(Flight(with_stream(recording, "gps", north=north), model), engine="numba")
    assert journal.rejected()["gps"] == 0
    assert np.min(journal.stream("gps").weight) < 0.2
    assert worst(journal, truth) < BOUND


def test_late_stream_at_its_time_of_validity(flown) -> None:
    recording, _ = flown
    gps = recording.streams["gps"]
    late = with_stream(recording, "gps", t=gps.t + 0.15)
    told = run_filter(Flight.of(late, latency={"gps": 0.15}), engine="numba")
    prompt = run_filter(Flight.of(recording), engine="numba")
    assert np.nanmax(np.abs(told.stream("gps").nu - prompt.stream("gps").nu)) < 1e-6


def test_readings_outside_the_imu_are_journalled(flown) -> None:
    recording, truth = flown
    short = without_rows(recording, "imu", 0.0, 2.0)
    short = short.replace(initial=Initial())
    journal = run_filter(Flight.of(short), engine="numba")
    assert journal.counts()["gps"]["outside the IMU's time"] == int(np.sum(recording.streams["gps"].t < 2.0))
    assert worst(journal, truth) < BOUND


def test_readings_before_and_after_the_imu_are_two_stretches(flown) -> None:
    recording, _ = flown
    short = without_rows(without_rows(recording, "imu", 0.0, 2.0), "imu", 28.0, 40.0).replace(initial=Initial())
    imu, gps = short.streams["imu"].t, short.streams["gps"].t
    sides = [gps[gps < imu[0]], gps[gps > imu[-1]]]
    flight = Flight.of(short)
    notes = [note for note in prepare(flight).events.notes if note.stream == "gps" and "outside" in note.kind]
    assert [(note.start, note.stop) for note in notes] == [(side[0], side[-1]) for side in sides]
    assert [int(note.kind.split()[0]) for note in notes] == [len(side) for side in sides]


def test_no_aiding_at_all(flown) -> None:
    recording, _ = flown
    alone = recording.replace(streams={"imu": recording.streams["imu"]})
    journal = run_filter(Flight.of(alone), engine="numba")
    assert any("no aiding stream" in str(note) for note in journal.notes)
    assert np.all(np.isfinite(journal.x_end))


@pytest.mark.parametrize("value", [0.0, -0.1, float("nan")])
@pytest.mark.parametrize(
    ("sensor", "key"), [("mag", "noise_std"), ("accel", "noise_density"), ("gps", "velocity_noise_std")]
)
def test_impossible_noise(flown, sensor: str, key: str, value: float) -> None:
    recording, _ = flown
    specs = {**recording.sensors, sensor: replace(recording.spec(sensor), **{key: value})}
    with pytest.raises(InputError, match=rf"sensors.{sensor}\] {key}.*expected a positive number"):
        flight_model(recording.replace(sensors=specs))


def test_undeclared_noise_is_named(flown) -> None:
    recording, _ = flown
    bare = recording.replace(sensors={**SPECS, "baro": SensorSpec(bias_std=1.0, bias_walk=0.0)})
    with pytest.raises(InputError, match=r"sensors.baro\] noise_std: not declared"):
        flight_model(bare)
    assert flight_model(bare, specs={"baro": SensorSpec(noise_std=0.3)}).sensors["baro"].R[0, 0] == pytest.approx(0.09)


@pytest.mark.parametrize(
    ("changes", "place"),
    [
        ({"quaternion": np.zeros(4)}, "quaternion"),
        ({"position": np.array([0.0, np.nan, 0.0])}, "position"),
        ({"attitude_std": -0.1}, "attitude_std"),
        ({"velocity": np.zeros(2)}, "velocity"),
    ],
)
def test_impossible_first_state(flown, changes: dict[str, object], place: str) -> None:
    recording, _ = flown
    with pytest.raises(InputError, match=rf"\[initial\] {place}"):
        run_filter(
            Flight(recording.replace(initial=replace(recording.initial, **changes)), flight_model(recording)),
            engine="numba",
        )


@pytest.mark.parametrize("engine", ["numba", "filterpy"])
def test_a_state_that_overflows_is_an_error_with_time_and_sensor(flown, engine: str) -> None:
    inputs = prepare(Flight.of(flown[0], gate_level=None))
    u, inside = inputs.imu.u.copy(), (inputs.imu.t > 0.5) & (inputs.imu.t < 0.6)
    u[inside, :3] = 1e308  # beyond what a recording may hold
    with np.errstate(all="ignore"), pytest.raises(InputError, match=r"t = 0\.5.* s, sensor .*not finite"):
        run(replace(inputs, imu=replace(inputs.imu, u=u)), engine)


def test_poses_are_not_a_flight(flown) -> None:
    recording, _ = flown
    with pytest.raises(InputError, match="a flight with an imu stream"):
        flight_model(recording.replace(kind="poses"))


def test_coarse_converter_is_not_frozen() -> None:
    walk = np.round(np.cumsum(np.random.default_rng(1).normal(size=4000)) * 0.05)[:, None]
    assert frozen_runs(walk) == []


def test_frozen_run_is_found() -> None:
    x = np.random.default_rng(2).normal(size=(1000, 3))
    x[400:450] = x[400]
    assert frozen_runs(x) == [(400, 450)]


def test_saturated_run_is_found() -> None:
    x = np.clip(np.random.default_rng(3).normal(size=(500, 1)), -3.0, 1.0)
    x[100:110] = 1.5
    assert saturated_runs(x) == [(100, 110)]


def test_interval_noise_adds_up(flown) -> None:
    """Sum of q h over uneven intervals: sigma^2 times the squared weights of the samples."""
    recording, _ = flown
    imu = recording.streams["imu"]
    keep = np.random.default_rng(4).random(len(imu)) > 0.1
    keep[[0, -1]] = True
    thinned = recording.replace(streams={"imu": imu.rows(keep)})
    model = flight_model(recording, use=())
    table = imu_table(Flight(thinned, model))
    h = np.diff(table.t)
    w = 0.5 * (np.append(0.0, h) + np.append(h, 0.0))
    assert np.sum(table.q_accel * h) == pytest.approx(model.accel.sigma**2 * np.sum(w**2), rel=0.05)
