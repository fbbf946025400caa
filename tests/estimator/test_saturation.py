"""One axis that is stuck, and a rate beyond the instrument's range: noted, and no worse than the readings were."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.estimator.filter.faults import Note, stuck_runs
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.imu import ImuTable, beyond_the_range, imu_table
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import ACCEL, GYRO, Recording, SensorSpec, Stream

RATE = 400.0  # Hz
NOISE = 2e-3  # rad/s
AMPLITUDE, LIMIT = 3.0, 2.5  # rad/s: of the swing, and of the instrument
COUNT = 0.05  # rad/s, one count of a coarse converter
T = np.arange(4000) / RATE
SWING = AMPLITUDE * np.sin(2.0 * np.pi * 1.5 * T)
SPECS = {
    "accel": SensorSpec(noise_density=2e-3, bias_std=0.1, bias_walk=0.0),
    "gyro": SensorSpec(noise_std=NOISE, bias_std=5e-3, bias_walk=0.0),
}


def noise(columns: int, seed: int = 1) -> FloatArray:
    return np.asarray(np.random.default_rng(seed).standard_normal((len(T), columns)))


def samples(rate_x: FloatArray) -> FloatArray:
    """(n, 6) force and rate of a body that swings about its first axis."""
    u = NOISE * noise(6)
    u[:, 2] -= 9.81
    u[:, 3] = rate_x
    return u


def table_of(rate_x: FloatArray) -> ImuTable:
    imu = Stream(T, dict(zip((*ACCEL, *GYRO), samples(rate_x).T, strict=True)))
    recording = Recording("swing", "flight", {"imu": imu}, SPECS)
    return imu_table(Flight.of(recording))


def notes_of(rate_x: FloatArray) -> list[Note]:
    return beyond_the_range(T, samples(rate_x))[1]


def test_one_axis_that_holds_its_value_is_stuck() -> None:
    x = noise(3)
    x[400:450, 1] = x[400, 1]
    assert stuck_runs(x) == [(400, 450)]


def test_noise_is_not_stuck() -> None:
    """Of 100 streams of noise as coarse as half its sigma; the level is 1e-6 an axis."""
    assert not any(stuck_runs(np.round(2.0 * noise(3, seed)) / 2.0) for seed in range(100))


def test_coarse_converter_at_rest_is_not_stuck() -> None:
    """It moves, then rests with noise below a count: all axes repeat."""
    x = noise(3)
    x[1000:1400] = 0.1 * noise(3, 2)[1000:1400]
    assert stuck_runs(np.round(2.0 * x) / 2.0) == []


def coarse(rate: FloatArray) -> FloatArray:
    """(n, 3) in counts: a rate as given with noise of 0.2 counts, and two axes that swing with noise of one count."""
    others = SWING[:, None] * np.array([0.1, 0.2])
    return np.round(np.column_stack([rate, others]) / COUNT + np.array([0.2, 1.0, 1.0]) * noise(3))


def steady_amid_swings() -> FloatArray:
    """A rate that swings but for 1.5 s, in which it goes through 0.8 counts."""
    return np.where(np.abs(T - 5.0) < 0.75, COUNT * (T - 5.0) / 1.5 * 0.8, SWING)


def test_coarse_axis_that_turns_steadily_is_not_stuck() -> None:
    """A loop with level wings: the roll axis is within one count, which it leaves and meets again by its noise."""
    reading = coarse(steady_amid_swings())
    assert np.mean(reading[1700:2300, 0] == 0.0) > 0.8
    assert stuck_runs(reading) == []


@pytest.mark.parametrize("start", [400, 1950, 3300])
def test_coarse_axis_that_is_stuck_amid_swings_is_found(start: int) -> None:
    """A second of one value, whatever it is when it starts and is released to."""
    reading = coarse(SWING)
    reading[start : start + 400, 0] = reading[start, 0]
    (found,) = stuck_runs(reading)
    assert abs(found[0] - start) < 4
    assert abs(found[1] - start - 400) < 4


def test_a_single_axis_has_nothing_to_be_stuck_against() -> None:
    x = noise(1)
    x[400:450] = x[400]
    assert stuck_runs(x) == []


def test_stuck_axis_is_a_gap_of_the_table() -> None:
    rate = SWING + NOISE * noise(1)[:, 0]
    rate[400:450] = rate[400]
    table = table_of(rate)
    frozen = [note for note in table.notes if note.kind == "frozen"]
    assert [(n.stream, n.start, n.stop) for n in frozen] == [("gyro", T[400], T[449])]


def test_unclipped_noise_has_no_note() -> None:
    assert not any(beyond_the_range(T, noise(6, seed))[1] for seed in range(50))


def test_unclipped_swing_has_no_note() -> None:
    assert notes_of(SWING + NOISE * noise(1)[:, 0]) == []


def test_coarse_swing_has_no_note() -> None:
    """A converter with coarse counts stays at its largest value too, for as long as the swing is within a count."""
    assert notes_of(COUNT * np.round(SWING / COUNT)) == []


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_clipped_swing_is_noted(sign: float) -> None:
    """One note each time that it is beyond the limit, on one side or on both."""
    clipped = np.minimum(sign * SWING + NOISE * noise(1)[:, 0], LIMIT)
    notes = notes_of(sign * clipped)
    assert [(n.stream, n.kind) for n in notes] == [("gyro", "saturated")] * 15


def mean_in_arcs(rate: FloatArray) -> float:
    """Mean rate while the true one is beyond the limit, its sign taken off [rad/s]."""
    beyond = np.abs(SWING) > LIMIT
    return float(np.mean((rate * np.sign(SWING))[beyond]))


def test_restored_mean_is_nearer_the_truth() -> None:
    clipped = np.clip(SWING + NOISE * noise(1)[:, 0], -LIMIT, LIMIT)
    restored, truth = mean_in_arcs(table_of(clipped).u[:, 3]), mean_in_arcs(SWING)
    assert abs(restored - truth) < 0.5 * abs(mean_in_arcs(clipped) - truth)


def test_restored_variance_is_larger_where_the_rate_was_not_seen() -> None:
    table = table_of(np.clip(SWING + NOISE * noise(1)[:, 0], -LIMIT, LIMIT))
    inside = np.abs(SWING[:-1]) > LIMIT + 0.1
    assert np.min(table.q_gyro[inside]) > 100.0 * np.median(table.q_gyro[np.abs(SWING[:-1]) < LIMIT - 0.1])


def test_variance_of_the_other_instrument_stays() -> None:
    plain = table_of(SWING + NOISE * noise(1)[:, 0])
    clipped = table_of(np.clip(SWING + NOISE * noise(1)[:, 0], -LIMIT, LIMIT))
    assert np.array_equal(clipped.q_accel, plain.q_accel)


def test_miss_is_within_three_of_its_sigma() -> None:
    """Over each arc: integral of the restored rate against the true one, in the sigma that the table gives it."""
    table = table_of(np.clip(SWING + NOISE * noise(1)[:, 0], -LIMIT, LIMIT))
    h, beyond = np.diff(T), np.abs(SWING[:-1]) > LIMIT
    edges = np.flatnonzero(np.diff(np.concatenate([[0], beyond.astype(int), [0]])))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        miss = np.sum((h * (table.u[:-1, 3] - SWING[:-1]))[start:stop])
        assert abs(miss) < 3.0 * np.sqrt(np.sum((h * table.q_gyro)[start:stop]))


@pytest.mark.parametrize("axes", [[2], [0, 1, 2, 3, 4, 5]])
def test_reading_that_drops_to_zero_is_no_arc(axes: list[int]) -> None:
    """The third axis reads -9.8 m/s^2 otherwise: zero is its largest reading, but a jump, not a swing past a limit."""
    u = samples(SWING)
    u[1600:2000, axes] = 0.0
    excess, notes = beyond_the_range(T, u)
    assert not np.any(excess)
    assert notes == []


@pytest.mark.parametrize("axes", [[2], [0, 1, 2, 3, 4, 5]])
def test_reading_that_drops_to_zero_is_in_no_sample(axes: list[int]) -> None:
    u = samples(SWING + NOISE * noise(1)[:, 0])
    u[1600:2000, axes] = 0.0
    imu = Stream(T, dict(zip((*ACCEL, *GYRO), u.T, strict=True)))
    recording = Recording("swing", "flight", {"imu": imu}, SPECS)
    assert np.max(imu_table(Flight.of(recording)).u[:, 2]) < -9.0


def test_clipped_axis_is_not_stuck_too() -> None:
    table = table_of(np.clip(SWING + NOISE * noise(1)[:, 0], -LIMIT, LIMIT))
    assert {note.kind for note in table.notes} == {"saturated"}


@pytest.mark.parametrize("levels", [2, 3, 5, 9])
def test_few_levels_are_no_limit(levels: int) -> None:
    """A body at rest whose noise is about one count."""
    counts = np.round(0.125 * levels * noise(1, levels)[:, 0])
    assert notes_of(COUNT * np.clip(counts, 0 if levels == 2 else -levels // 2, levels // 2)) == []


@pytest.mark.parametrize("frozen", [slice(-40, None), slice(None, 40)])
def test_log_that_begins_or_ends_frozen_keeps_its_ends(frozen: slice) -> None:
    """Readings are asked for between the first and the last stamp of the stream: the table covers them."""
    rng = np.random.default_rng(5)
    t = np.arange(2000) / 200.0
    u = rng.normal(0.0, 0.05, (len(t), 6)) + np.array([0.0, 0.0, -9.8, 0.0, 0.0, 0.0])
    u[frozen] = u[frozen][0]
    recording = Recording(
        "frozen end", "flight", {"imu": Stream(t, dict(zip((*ACCEL, *GYRO), u.T, strict=True)))}, SPECS
    )
    table = imu_table(Flight.of(recording))
    assert table.t[0] == t[0]
    assert table.t[-1] == t[-1]
