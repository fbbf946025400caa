"""A gap that nothing bridges: each side of it is a run of its own, of one model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.estimator.evidence.level_scores import level_scores
from sinan.estimator.evidence.sensitivity import sensitivity_pass
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import FlightModel, flight_model
from sinan.estimator.filter.inputs import RunInputs, prepare
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.pieces import journal_pieces
from sinan.estimator.filter.run_filter import run_filter
from sinan.estimator.filter.smoother import smooth
from sinan.sensors.recording import Initial, Recording
from sinan.sensors.window import between
from tests.estimator.analytic_flight import fly

#: The IMU is silent between the two, which is long enough for every turn [s].
FIRST, SECOND = (0.0, 12.0), (40.0, 55.0)


def a_log() -> tuple[Recording, FlightModel]:
    """A flight whose IMU is silent for half of it; the other sensors are not."""
    whole, _ = fly(7, duration=55.0)
    imu = whole.streams["imu"]
    kept = (imu.t < FIRST[1]) | (imu.t >= SECOND[0])
    recording = whole.replace(streams={**whole.streams, "imu": imu.rows(kept)}, initial=Initial())
    return recording, flight_model(recording, gate_level=None)


@pytest.fixture(scope="module")
def log() -> tuple[Recording, FlightModel]:
    """The log and its model."""
    return a_log()


def alone(recording: Recording, model: FlightModel, part: tuple[float, float], stride: int = 1) -> Journal:
    return run(prepare(since_the_start(recording, model, part)), "numba", stride)


def since_the_start(recording: Recording, model: FlightModel, part: tuple[float, float]) -> Flight:
    """A part of the log, whose biases have walked since the log began."""
    return Flight(between(recording, *part), model.after(part[0]))


def test_each_stretch_is_a_run_of_its_own(log: tuple[Recording, FlightModel]) -> None:
    recording, model = log
    both = run(prepare(Flight(recording, model)), "numba")
    for part in (FIRST, SECOND):
        own = alone(recording, model, part)
        mine = (both.t >= part[0]) & (both.t <= own.t_end)
        theirs = own.status == 0
        assert np.array_equal(both.t[mine & (both.status == 0)], own.t[theirs])
        assert np.array_equal(both.nis[mine & (both.status == 0)], own.nis[theirs])
        at = np.isin(both.imu_t, own.imu_t)
        assert np.array_equal(both.imu_x[at], own.imu_x)
        assert np.allclose(both.imu_var[at], own.imu_var, rtol=1e-12)
    silent = (both.t > FIRST[1]) & (both.t < SECOND[0])
    assert np.sum(silent) > 100
    assert np.all(both.status[silent] == 2)
    assert [note.start for note in both.notes if "new stretch" in str(note)] == [pytest.approx(FIRST[1], abs=0.01)]


def test_the_readable_engine_does_the_same(log: tuple[Recording, FlightModel]) -> None:
    recording, model = log
    short = between(recording, 9.0, 43.0)
    fast, slow = (run(prepare(Flight(short, model)), engine) for engine in ("numba", "filterpy"))
    assert np.array_equal(fast.status, slow.status)
    assert np.nanmax(np.abs(fast.nis - slow.nis)) < 1e-6
    assert np.max(np.abs(fast.imu_x - slow.imu_x)) < 1e-6


def test_nothing_later_is_smoothed_into_what_was_before(log: tuple[Recording, FlightModel]) -> None:
    recording, model = log
    both = smooth(run(prepare(Flight(recording, model)), "numba"), sigmas=True)
    for part in (FIRST, SECOND):
        own = smooth(alone(recording, model, part), sigmas=True)
        assert np.array_equal(both.x[np.isin(both.t, own.t)], own.x)
        at = np.isin(both.t_sigma, own.t_sigma)
        assert np.array_equal(both.sigma[at], own.sigma[np.isin(own.t_sigma, both.t_sigma)])


def test_levels_are_of_both(log: tuple[Recording, FlightModel]) -> None:
    recording, model = log
    both = level_scores(prepare(Flight(recording, model)))
    first, second = (level_scores(prepare(since_the_start(recording, model, part))) for part in (FIRST, SECOND))
    assert np.allclose(both.start, first.start + second.start, rtol=1e-9)
    walked = np.zeros(model.layout.n)
    for process in model.processes:
        block = model.layout.slice(process.block)
        walked[block] = process.walk**2 * SECOND[0] * np.diag(second.start)[block]
    assert np.allclose(both.bias, first.bias + second.bias + walked, rtol=1e-9)
    assert float(np.sum(both.q_gyro)) == pytest.approx(float(np.sum(first.q_gyro) + np.sum(second.q_gyro)))
    assert float(np.sum(both.loglik)) == pytest.approx(float(np.sum(first.loglik) + np.sum(second.loglik)))


def test_a_bias_walks_on_while_nothing_is_read() -> None:
    """A receiver's error of 0.1 m that walks by 0.3 m/sqrt(s) is one of 1.9 m after 40 s."""
    recording, _ = a_log()
    walking = replace(recording.spec("gps"), bias_std=0.1, bias_walk=0.3)
    recording = recording.replace(sensors={**recording.sensors, "gps": walking})
    inputs = prepare(Flight.of(recording))
    ((_, P),) = inputs.later
    assert np.diag(P)[inputs.model.layout.slice("b_gps")] == pytest.approx(0.1**2 + 0.3**2 * SECOND[0], rel=1e-3)


def test_the_score_of_a_walk_counts_what_it_has_done_between_two_stretches() -> None:
    """By the logarithm of walk^2, against differences of log L."""
    recording, _ = a_log()

    def inputs(share: float) -> RunInputs:
        walking = replace(recording.spec("baro"), bias_std=0.1, bias_walk=0.3 * np.sqrt(share))
        return prepare(Flight.of(recording.replace(sensors={**recording.sensors, "baro": walking}), gate_level=None))

    higher, lower = (float(np.sum(level_scores(inputs(np.exp(step))).loglik)) for step in (0.01, -0.01))
    found = level_scores(inputs(1.0)).bias[inputs(1.0).model.layout.slice("b_baro")]
    assert float(np.sum(found)) == pytest.approx((higher - lower) / 0.02, rel=1e-3)


def test_information_of_an_effect_adds(log: tuple[Recording, FlightModel]) -> None:
    recording, model = log
    effects = ("accel.scale", "gps.latency", "mag.scale")
    _, both = sensitivity_pass(Flight(recording, model), effects)
    parts = [sensitivity_pass(since_the_start(recording, model, part), effects)[1] for part in (FIRST, SECOND)]
    together = sum(one.information.sum(axis=0) for one in parts)
    assert np.allclose(both.information.sum(axis=0), together, rtol=1e-3, atol=1e-3 * np.max(np.abs(together)))


def test_pieces_begin_anew_too(log: tuple[Recording, FlightModel]) -> None:
    recording, model = log
    whole = run(prepare(Flight(recording, model)), "numba")
    x_end = [piece.x_end for piece in journal_pieces(Flight(recording, model), "numba", seconds=5.0)][-1]
    assert np.array_equal(x_end, whole.x_end)


def test_a_gap_in_which_hardly_anything_turns_is_bridged() -> None:
    """A tenth of a second is, and no stretch ends there."""
    whole, _ = fly(7, duration=20.0)
    imu = whole.streams["imu"]
    recording = whole.replace(streams={**whole.streams, "imu": imu.rows((imu.t < 10.0) | (imu.t > 10.1))})
    inputs = prepare(Flight.of(recording))
    assert inputs.imu.starts == (0,)
    assert np.sum(inputs.imu.row < 0) > 0


def test_a_break_is_none_that_anything_bridges() -> None:
    whole, _ = fly(7, duration=20.0)
    imu = whole.streams["imu"]
    kept = imu.rows((imu.t < 10.0) | (imu.t > 10.1))
    second = float(kept.t[kept.t > 10.05][0])
    recording = whole.replace(streams={**whole.streams, "imu": kept}, breaks=(second,))
    inputs = prepare(Flight.of(recording))
    assert [float(inputs.imu.t[i]) for i in inputs.imu.starts] == [float(imu.t[0]), second]


def test_a_stretch_that_no_first_state_can_be_found_in_is_left_out() -> None:
    """Half a second between two long gaps."""
    recording, model = a_log()
    imu = fly(7, duration=55.0)[0].streams["imu"]
    kept = (imu.t < 12.0) | ((imu.t > 25.0) & (imu.t < 25.5)) | (imu.t >= 40.0)
    with_crumb = recording.replace(streams={**recording.streams, "imu": imu.rows(kept)})
    plain, crumb = (run_filter(Flight(one, model), engine="numba") for one in (recording, with_crumb))
    assert np.array_equal(plain.imu_x, crumb.imu_x)
    assert any("too short" in str(note) for note in crumb.notes)


@pytest.mark.parametrize("lost", ["gps", "mag", "baro"])
def test_a_stretch_may_lack_a_stream_that_another_has(lost: str) -> None:
    """A receiver, a compass or a barometer that is silent after the gap: the filter goes on without it."""
    recording, model = a_log()
    stream = recording.streams[lost]
    recording = recording.replace(streams={**recording.streams, lost: stream.rows(stream.t < FIRST[1])})
    journal = run(prepare(Flight(recording, model)), "numba")
    assert np.all(np.isfinite(journal.imu_x))
    assert not np.any(journal.stream(lost).t > SECOND[0])
