"""Every fault of every stream: a named error, or a state that stays finite and an error that stays bounded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import flight_model
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.relinearise import run_relinearised
from sinan.estimator.filter.run_filter import run_filter
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.recording import Initial, Recording, Stream
from tests.estimator.analytic_flight import fly

STREAMS = ("imu", "mag", "baro", "laser", "gps")
AIDING = STREAMS[1:]
BOUND = 5.0  # sigma that an error may reach at the end where the fault is noticed
METRES = 5.0  # error of the position that an unnoticed fault may leave
LIMIT = {"mag": 0.5, "baro": 9.0, "laser": 9.0, "gps": 5.0}  # at which a stream is clipped, inside what it reads

Injected = Callable[[Stream], Stream]


@pytest.fixture(scope="module")
def flown() -> tuple[Recording, FloatArray]:
    return fly(31, duration=30.0)


def injected(recording: Recording, name: str, fault: Injected) -> Recording:
    return recording.replace(streams={**recording.streams, name: fault(recording.streams[name])})


def with_columns(stream: Stream, change: Callable[[FloatArray], FloatArray]) -> Stream:
    return Stream(stream.t, {name: change(values) for name, values in stream.columns.items()})


def run(recording: Recording) -> Journal:
    return run_filter(Flight.of(recording), engine="numba")


def worst(journal: Journal, truth: FloatArray) -> float:
    """Largest error at the end in units of its own sigma."""
    assert np.all(np.isfinite(journal.x_end))
    error = journal.model.layout.difference(truth[-1:], journal.x_end[None])[0]
    return float(np.max(np.abs(error) / np.sqrt(np.diag(journal.P_end))))


def bad_value(value: float) -> Injected:
    def put(stream: Stream) -> Stream:
        first = next(iter(stream.columns))
        values = stream[first].copy()
        values[len(values) // 2] = value
        return Stream(stream.t, {**stream.columns, first: values})

    return put


def swapped(stream: Stream) -> Stream:
    """Two neighbours in the wrong order."""
    order = np.arange(len(stream))
    order[[20, 21]] = [21, 20]
    return stream.rows(order)


def doubled(stream: Stream) -> Stream:
    """One row twice."""
    return stream.rows(np.sort(np.append(np.arange(len(stream)), 20)))


@pytest.mark.parametrize("name", STREAMS)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_value_that_is_no_number_is_named(flown, name: str, value: float) -> None:
    with pytest.raises(InputError, match=rf"stream {name}, row \d+: {value} in column \w+; expected a number"):
        injected(flown[0], name, bad_value(value))


@pytest.mark.parametrize("name", STREAMS)
@pytest.mark.parametrize(("fault", "row"), [(swapped, 22), (doubled, 22)])
def test_time_that_does_not_increase_is_named(flown, name: str, fault: Injected, row: int) -> None:
    with pytest.raises(InputError, match=rf"stream {name}, row {row}: .*strictly increasing time"):
        injected(flown[0], name, fault)


def test_a_flight_without_an_imu_is_named(flown) -> None:
    recording = flown[0].replace(streams={name: flown[0].streams[name] for name in AIDING})
    with pytest.raises(InputError, match="no stream imu"):
        run(recording)


@pytest.mark.parametrize("name", AIDING)
def test_a_stream_that_begins_late(flown, name: str) -> None:
    recording, truth = flown
    journal = run(injected(recording, name, lambda s: s.rows(s.t > 15.0)))
    assert worst(journal, truth) < BOUND


@pytest.mark.parametrize("name", AIDING)
def test_a_stream_that_ends_early(flown, name: str) -> None:
    recording, truth = flown
    journal = run(injected(recording, name, lambda s: s.rows(s.t < 15.0)))
    assert worst(journal, truth) < BOUND


@pytest.mark.parametrize("name", AIDING)
def test_a_single_reading_of_a_stream(flown, name: str) -> None:
    recording, truth = flown
    journal = run(injected(recording, name, lambda s: s.rows(np.array([100]))))
    assert worst(journal, truth) < BOUND


@pytest.mark.parametrize("name", AIDING)
def test_lateness_that_nobody_told_is_bounded(flown, name: str) -> None:
    """Two tenths of a second, for which a gate would refuse the whole stream and lose the state: 100 m after 30 s."""
    recording, truth = flown
    journal = run(injected(recording, name, lambda s: Stream(s.t + 0.2, s.columns)))
    error = journal.model.layout.difference(truth[-1:], journal.x_end[None])[0]
    assert np.linalg.norm(error[:3]) < METRES
    if name in ("gps", "mag"):
        assert any(f"{name}: the gate refused" in str(note) for note in journal.notes)


@pytest.mark.parametrize("name", AIDING)
def test_a_saturated_stream_is_bounded_and_said(flown, name: str) -> None:
    recording, truth = flown
    limit = LIMIT[name]
    journal = run(injected(recording, name, lambda s: with_columns(s, lambda v: np.clip(v, -limit, limit))))
    error = journal.model.layout.difference(truth[-1:], journal.x_end[None])[0]
    assert np.linalg.norm(error[:3]) < METRES
    assert any(str(note).startswith((f"{name}: saturated", f"{name}: frozen")) for note in journal.notes)


@pytest.mark.parametrize("name", AIDING)
def test_a_stream_that_goes_wrong_for_good_has_no_weight(flown, name: str) -> None:
    """A factor of 100 from 5 s on: next to nothing of it gets into the state."""
    recording, truth = flown
    given = recording.replace(initial=replace(recording.initial, position_std=0.5))
    journal = run(injected(given, name, lambda s: with_columns(s, lambda v: np.where(s.t > 5.0, 100.0 * v, v))))
    after = journal.stream(name).t > 5.0
    assert np.median(journal.stream(name).weight[after]) < 0.05
    assert any(f"{name}: the gate refused" in str(note) for note in journal.notes)
    assert worst(journal, truth) < BOUND


@pytest.mark.parametrize("noise", [0.0, -1.0])
@pytest.mark.parametrize("name", ["accel", "gyro", "mag", "baro", "laser", "gps"])
def test_no_sensor_may_declare_zero_or_negative_noise(flown, name: str, noise: float) -> None:
    recording = flown[0]
    key = "noise_density" if name in ("accel", "gyro") else "noise_std"
    specs = {**recording.sensors, name: replace(recording.spec(name), **{key: noise})}
    with pytest.raises(InputError, match=rf"\[sensors.{name}\] {key}.*expected a positive number"):
        flight_model(recording.replace(sensors=specs))


@pytest.mark.parametrize("gap", [0.001, 0.01, 0.1, 1.0, 10.0])
def test_imu_gap(flown, gap: float) -> None:
    """Bounded in the plain filter; within its sigma where the attitude lost in the gap is not linearised about."""
    recording, truth = flown
    holed = injected(recording, "imu", lambda s: s.rows((s.t < 12.0) | (s.t >= 12.0 + gap)))
    for start in (recording.initial, Initial()):
        journal = run(holed.replace(initial=start))
        error = journal.model.layout.difference(truth[-1:], journal.x_end[None])[0]
        assert np.linalg.norm(error[:3]) < METRES
        cured = run_relinearised(Flight(holed.replace(initial=start), flight_model(holed)), engine="numba")
        assert worst(cured, truth) < BOUND


def test_a_first_state_kilometres_away_never_ends_in_silence(flown) -> None:
    recording, _ = flown
    far = replace(recording.initial, position=np.array([5e3, 0.0, 0.0]))
    journal = run(recording.replace(initial=far))
    assert np.all(np.isfinite(journal.x_end))
    assert any("gps: the gate refused 100 %" in str(note) for note in journal.notes)
