"""A filter that loses its way for an instant finds back; a receiver that jumps is no reason for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.calibration.levels import upsets
from sinan.calibration.levels.levels import Levels, first_levels
from sinan.calibration.levels.sizes import sizes_of
from sinan.calibration.levels.upsets import with_upsets
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.events import WITHHELD
from sinan.estimator.filter.flight_model import Upset
from sinan.estimator.filter.imu import imu_table
from sinan.estimator.filter.inputs import RunInputs, prepare
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.layout import Q_NB
from sinan.experiments.benchmarks.bounds_cases import CASES
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.recording import POSITION, VELOCITY, Recording, SensorSpec, Stream
from sinan.sensors.rotation import quaternion_conjugate, quaternion_log, quaternion_multiply
from tests.calibration.upset_study import SHOCKS, minutes
from tests.estimator.analytic_flight import SLOW_IMU, fly

#: When the gyroscope reads a turn that is none [s], and how large it is [rad].
SHOCK, TURN = 30.0, 1.0


@pytest.fixture(scope="module")
def flown() -> tuple[Recording, FloatArray]:
    """A minute without any declared noise, whose heading shows in accelerations alone; and the true quaternions."""
    recording, truth = fly(21, duration=60.0, sensors=("gps", "baro"), rates=SLOW_IMU)
    return recording.replace(sensors={}), truth[:, Q_NB]


@pytest.fixture(scope="module")
def calm(flown: tuple[Recording, FloatArray]) -> Recording:
    """The minute."""
    return flown[0]


def with_column(recording: Recording, stream: str, name: str, add: np.ndarray) -> Recording:
    """With something added to a column."""
    one = recording.streams[stream]
    streams = {**recording.streams, stream: Stream(one.t, {**one.columns, name: one[name] + add})}
    return recording.replace(streams=streams)


@pytest.fixture(scope="module")
def shaken(calm: Recording) -> Recording:
    """The same with a turn about the vertical axis that the gyroscope reads for a tenth of a second."""
    t = calm.streams["imu"].t
    pulse = ((t >= SHOCK) & (t < SHOCK + 0.1)).astype(float)
    return with_column(calm, "imu", "gyro_z", pulse * TURN / (np.sum(pulse) * float(np.median(np.diff(t)))))


def levels_of(recording: Recording) -> Levels:
    """All sizes at their medians."""
    return first_levels(recording, sizes_of(recording), None, None)


def attitude_error(recording: Recording, levels: Levels, q: FloatArray, since: float) -> float:
    """RMS from a time on [rad], against true quaternions."""
    journal = run(prepare(levels.flight(recording)), "numba")
    off = quaternion_log(quaternion_multiply(quaternion_conjugate(q), journal.imu_x[:, Q_NB]))
    return float(np.sqrt(np.mean(np.sum(off[journal.imu_t > since] ** 2, axis=1))))


def test_one_shock_is_one_upset() -> None:
    """That of `bounds_of_work`; taken for 0.1 s late, fixes in quick turns half a minute later were two more."""
    assert CASES["shock"]().words == ("1 upsets",)


def test_a_shock_is_found_and_the_attitude_with_it(shaken: Recording, flown: tuple[Recording, FloatArray]) -> None:
    levels = levels_of(shaken)
    found = with_upsets(shaken, levels)
    assert len(found.upsets) == 1
    assert found.upsets[0].t == pytest.approx(SHOCK, abs=1.0)
    assert found.upsets[0].attitude >= 0.3
    before, after = (attitude_error(shaken, one, flown[1], SHOCK + 5.0) for one in (levels, found))
    assert after < 0.3 * before


def test_a_calm_log_and_a_receiver_that_jumps_have_none(calm: Recording) -> None:
    t = calm.streams["gps"].t
    jumped = with_column(calm, "gps", POSITION[0], 30.0 * (t > SHOCK))
    gone = with_column(calm, "gps", POSITION[1], 30.0 * ((t > SHOCK) & (t < SHOCK + 8.0)))
    for recording in (calm, jumped, gone):
        levels = levels_of(recording)
        assert with_upsets(recording, levels) is levels


def erring(recording: Recording, every: int, kind: str) -> Recording:
    """One fix of `every`, of a receiver that drifts by 60 m and comes back, or tells a false velocity for 8 s."""
    gps = recording.streams["gps"].rows(slice(None, None, every))
    one = recording.replace(streams={**recording.streams, "gps": gps})
    if kind == "drift":
        return with_column(one, "gps", POSITION[0], np.interp(gps.t, [20.0, 30.0, 35.0, 45.0], [0.0, 60.0, 60.0, 0.0]))
    return with_column(one, "gps", VELOCITY[0], 5.0 * ((gps.t > 30.0) & (gps.t < 38.0)))


@pytest.mark.parametrize("kind", ["drift", "velocity"])
@pytest.mark.parametrize("every", [1, 2])
def test_a_receiver_that_drifts_or_tells_a_false_velocity_is_no_upset(calm: Recording, every: int, kind: str) -> None:
    recording = erring(calm, every, kind)
    levels = levels_of(recording)
    assert run(prepare(levels.flight(recording)), "numba", 0).nis_per_dof()["gps"] > 3.0
    assert with_upsets(recording, levels) is levels


def test_a_shock_is_found_beside_a_receiver_that_jumped_before(shaken: Recording) -> None:
    t = shaken.streams["gps"].t
    both = with_column(shaken, "gps", POSITION[1], 30.0 * ((t > 10.0) & (t < 16.0)))
    assert [one.t for one in with_upsets(both, levels_of(both)).upsets] == [pytest.approx(SHOCK, abs=1.0)]


def test_two_fixes_tell_no_time_between_fixes(calm: Recording) -> None:
    gps = calm.streams["gps"]
    few = calm.replace(
        sensors={"gps": SensorSpec(noise_std=0.5, velocity_noise_std=0.1, bias_std=0.0, bias_walk=0.0)},
        streams={
            **calm.streams,
            "gps": with_column(calm, "gps", POSITION[0], 300.0 * (gps.t > gps.t[0])).streams["gps"].rows(slice(0, 2)),
        },
    )
    assert with_upsets(few, levels_of(few)).upsets == ()


def test_an_upset_outside_a_table_is_in_none_of_its_intervals(calm: Recording) -> None:
    levels = levels_of(calm)
    plain = imu_table(levels.flight(calm))
    table = imu_table(replace(levels, upsets=(Upset(-30.0, 1.0, 1.0), Upset(1000.0, 1.0, 1.0))).flight(calm))
    assert np.array_equal(table.q_gyro, plain.q_gyro)
    assert np.array_equal(table.q_accel, plain.q_accel)


def test_what_declares_its_noise_or_measures_no_place_is_left_alone(shaken: Recording) -> None:
    levels = levels_of(shaken)
    assert with_upsets(shaken, replace(levels, tail=None)).upsets == ()
    streams = {name: stream for name, stream in shaken.streams.items() if name != "gps"}
    unplaced = shaken.replace(streams=streams)
    assert with_upsets(unplaced, levels_of(unplaced)).upsets == ()


@pytest.mark.parametrize("most", [upsets.MOST // 2, 2 * upsets.MOST])
def test_half_and_twice_as_many_runs_looked_at_give_the_same(
    shaken: Recording, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    levels = levels_of(shaken)
    expected = with_upsets(shaken, levels).upsets
    monkeypatch.setattr(upsets, "MOST", most)
    assert with_upsets(shaken, levels).upsets == expected


@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("name", ["INSTANTS", "FINER"])
def test_half_and_twice_of_the_instants_tried_find_the_same_shock(
    shaken: Recording, flown: tuple[Recording, FloatArray], name: str, factor: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    levels = replace(levels_of(shaken), axes_std=0.0)  # the gyroscope has no error of scale that a shock would change
    usual = attitude_error(shaken, with_upsets(shaken, levels), flown[1], SHOCK + 5.0)
    monkeypatch.setattr(upsets, name, tuple(factor * one for one in getattr(upsets, name)))
    found = with_upsets(shaken, levels)
    assert [one.t for one in found.upsets] == [pytest.approx(SHOCK, abs=1.2)]
    assert attitude_error(shaken, found, flown[1], SHOCK + 5.0) < 1.3 * usual


def test_an_upset_adds_its_variances_to_the_interval_that_it_is_in(shaken: Recording) -> None:
    plain = imu_table(levels_of(shaken).flight(shaken))
    table = imu_table(with_upsets(shaken, levels_of(shaken)).flight(shaken))
    (upset,) = with_upsets(shaken, levels_of(shaken)).upsets
    h = np.diff(table.t)
    for added, size in ((table.q_gyro - plain.q_gyro, upset.attitude), (table.q_accel - plain.q_accel, upset.velocity)):
        k = np.flatnonzero(added) if size else np.searchsorted(table.t, [upset.t], side="right") - 1
        assert len(k) == 1
        assert table.t[k[0]] <= upset.t < table.t[k[0] + 1]
        assert added[k[0]] * h[k[0]] == pytest.approx(size**2)


def test_a_turn_of_more_than_one_opening_can_tell(calm: Recording, flown: tuple[Recording, FloatArray]) -> None:
    t = calm.streams["imu"].t
    pulse = ((t >= SHOCK) & (t < SHOCK + 0.1)).astype(float)
    rolled = with_column(calm, "imu", "gyro_x", pulse * 1.83 / (np.sum(pulse) * float(np.median(np.diff(t)))))
    levels = levels_of(rolled)
    found = with_upsets(rolled, levels)
    before, after = (attitude_error(rolled, one, flown[1], SHOCK + 5.0) for one in (levels, found))
    assert after < 0.3 * before


def test_upsets_are_told_from_a_receiver_that_errs() -> None:
    """Of minutes that had no part in the rule; `python -m tests.calibration.upset_study` has more of them."""
    drawn = list(minutes(20, np.random.default_rng(5)))
    found = [(one.kind in SHOCKS, bool(with_upsets(one.recording, one.levels).upsets)) for one in drawn]
    assert all(upset for shock, upset in found if shock)
    assert sum(upset for shock, upset in found if not shock) <= 0.15 * len(found)


def test_fixes_without_which_no_state_follows_are_no_lapse(shaken: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    def fragile(inputs: RunInputs, engine: str, stride: int) -> Journal:
        if np.any(inputs.events.status == WITHHELD):
            raise InputError("log", "no finite state", "fixes")
        return run(inputs, engine, stride)

    monkeypatch.setattr(upsets, "run", fragile)
    assert len(with_upsets(shaken, levels_of(shaken)).upsets) == 1
