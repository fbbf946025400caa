"""A long log is heard in parts: which, and what they tell of its sizes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from sinan.calibration.levels.fit import likeliest, problem_of
from sinan.calibration.levels.long_log import LONG, PARTS, SECONDS, heard_in_parts
from sinan.calibration.levels.preparation import prepared
from sinan.sensors.recording import GYRO, Recording, Stream
from sinan.sensors.window import between
from tests.estimator.analytic_flight import fly

DURATION = 300.0


@pytest.fixture(scope="module")
def bare() -> Recording:
    """Five minutes that declare nothing."""
    flown, _ = fly(6, duration=DURATION, sensors=("gps",), rates={"imu": 20.0, "gps": 2.0})
    return flown.replace(sensors={})


def test_each_share_of_the_time_has_the_part_that_turns_most(bare: Recording) -> None:
    """The rates of one share are large in its last 40 s alone."""
    imu = bare.streams["imu"]
    share = DURATION / PARTS
    lively = (imu.t >= 2.0 * share - 40.0) & (imu.t < 2.0 * share)
    rates = {name: np.where(lively, 3.0, 1.0) * imu[name] for name in GYRO}
    recording = bare.replace(streams={**bare.streams, "imu": Stream(imu.t, {**imu.columns, **rates})})
    heard = heard_in_parts(recording)
    t = heard.streams["imu"].t
    begins = np.array([t[0], *heard.breaks])
    assert len(begins) == PARTS
    assert np.array_equal((begins // share).astype(int), np.arange(PARTS))
    assert 2.0 * share - 40.0 <= begins[1] <= 2.0 * share - SECONDS
    for begin, end in pairwise([*begins, DURATION]):
        mine = t[(t >= begin) & (t < end)]
        assert mine[-1] - mine[0] == pytest.approx(SECONDS, abs=0.1)
    inside = np.any([(recording.streams["gps"].t >= b) & (recording.streams["gps"].t < b + SECONDS) for b in begins], 0)
    assert np.array_equal(heard.streams["gps"].t, recording.streams["gps"].t[inside])


def test_a_log_that_is_not_long_or_not_the_same_throughout_is_heard_whole(bare: Recording) -> None:
    short = between(bare, 0.0, LONG)
    assert heard_in_parts(short) is short
    gps = bare.streams["gps"]
    late = bare.replace(streams={**bare.streams, "gps": gps.rows(gps.t > 0.9 * DURATION)})
    assert heard_in_parts(late) is late


def test_another_log_that_begins_in_a_part_begins_there_still(bare: Recording) -> None:
    t = bare.streams["imu"].t
    first = float(t[len(t) // PARTS - 100])
    assert first in heard_in_parts(bare.replace(breaks=(first,))).breaks


def test_parts_tell_the_sizes_that_the_whole_log_tells(bare: Recording) -> None:
    """Within three sigma, and the levels are those of the whole log: its filter runs on all of it."""
    problem = problem_of(bare)
    whole, heard = likeliest(problem), likeliest(problem.over(heard_in_parts(bare)))
    assert [size.key for size in heard.found] == [size.key for size in whole.found]
    for size, one, other in zip(whole.found, whole.sigmas, heard.sigmas, strict=True):
        a, b = ((lv.value(size) if size.linear else np.log(lv.value(size))) for lv in (whole, heard))
        assert abs(a - b) < 3.0 * np.hypot(one, other), (size.sensor, size.key)


def test_a_reader_is_told(bare: Recording) -> None:
    said = f"{PARTS} parts of {SECONDS:g} s"
    ready = prepared(bare)
    assert any(said in note for note in ready.notes)
    assert ready.run().t_end == pytest.approx(bare.streams["imu"].t[-1])
    assert not any(said in note for note in prepared(between(bare, 0.0, 40.0)).notes)
