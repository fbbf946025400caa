"""Excerpts of a long log: which they are, and what they tell of its sizes."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.calibration.levels import excerpts
from sinan.calibration.levels.excerpts import EXCERPTS, LONG, SECONDS, excerpts_of
from sinan.calibration.levels.fit import problem_of
from sinan.calibration.levels.preparation import prepared
from sinan.calibration.levels.problem import Problem
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import GYRO, Recording, Stream
from sinan.sensors.window import between
from tests.estimator.analytic_flight import SPECS, fly

DURATION = 300.0
SHARE = DURATION / EXCERPTS
RATES = {"imu": 20.0, "mag": 4.0, "baro": 4.0, "gps": 2.0}


@pytest.fixture(scope="module")
def flown() -> Recording:
    """Five minutes that declare nothing."""
    recording, _ = fly(6, duration=DURATION, sensors=("gps", "baro"), rates=RATES)
    return recording.replace(sensors={})


def with_imu(recording: Recording, t: FloatArray | None = None, rates: FloatArray | None = None) -> Recording:
    """Other stamps, or so many times the rates of turn."""
    imu = recording.streams["imu"]
    columns = {**imu.columns, **({} if rates is None else {name: rates * imu[name] for name in GYRO})}
    return recording.replace(streams={**recording.streams, "imu": Stream(imu.t if t is None else t, columns)})


def begins(found: tuple[Recording, ...]) -> FloatArray:
    return np.array([one.streams["imu"].t[0] for one in found])


def test_each_share_of_the_time_has_the_excerpt_that_turns_most(flown: Recording) -> None:
    """The rates of one share are large in its last 45 s alone."""
    t = flown.streams["imu"].t
    lively = (t >= 2.0 * SHARE - 45.0) & (t < 2.0 * SHARE)
    found = excerpts_of(with_imu(flown, rates=np.where(lively, 3.0, 1.0)))
    assert np.array_equal(begins(found) // SHARE, np.arange(EXCERPTS))
    assert begins(found)[1] >= 2.0 * SHARE - 45.0
    for one in found:
        for stream in one.streams.values():
            assert stream.t[-1] - stream.t[0] == pytest.approx(SECONDS, abs=1.0)


def test_a_log_that_is_not_long_or_lacks_a_stream_is_heard_whole(flown: Recording) -> None:
    short = between(flown, 0.0, LONG)
    assert excerpts_of(short) == (short,)
    baro = flown.streams["baro"]
    late = flown.replace(streams={**flown.streams, "baro": baro.rows(baro.t > 0.9 * DURATION)})
    assert excerpts_of(late) == (late,)


def test_an_excerpt_has_no_gap_and_is_of_one_log(flown: Recording) -> None:
    t = flown.streams["imu"].t
    later = np.where(t >= 0.5 * SHARE, 10.0, 0.0)
    for recording in (with_imu(flown, t + later), flown.replace(breaks=(0.5 * SHARE,))):
        first = excerpts_of(recording)[0].streams["imu"].t
        assert np.max(np.diff(first)) < 0.1
        assert not first[0] < 0.5 * SHARE <= first[-1]


def test_an_imu_that_changes_its_rate_is_cut_into_no_less_than_whole_excerpts(flown: Recording) -> None:
    """Shares are by samples: that of 2000 Hz is shorter than an excerpt."""
    t = flown.streams["imu"].t
    last = t >= t[-1] - SHARE
    fast = with_imu(flown, np.where(last, t[~last][-1] + np.cumsum(last) * 5e-4, t))
    assert excerpts_of(fast) == (fast,)


def climbing() -> Recording:
    """Half a minute that rises by 3 m/s and declares nothing."""
    recording, _ = fly(9, duration=32.0, sensors=("gps", "mag", "baro"), rates={**RATES, "mag": 10.0, "imu": 50.0})
    gps, baro = recording.streams["gps"], recording.streams["baro"]
    fixes = {**gps.columns, "down": gps["down"] - 3.0 * gps.t, "vel_down": gps["vel_down"] - 3.0}
    heights = {"height": baro["height"] + 3.0 * baro.t}
    streams = {**recording.streams, "gps": Stream(gps.t, fixes), "baro": Stream(baro.t, heights)}
    return recording.replace(sensors={}, streams=streams)


def heard_in_four_seconds(recording: Recording) -> Problem:
    """Its sizes, the field a state, in four excerpts of 4 s."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(excerpts, "SECONDS", 4.0)
        patch.setattr(excerpts, "LONG", 20.0)
        found = excerpts_of(recording)
    assert len(found) == EXCERPTS
    field = recording.environment.magnetic_field
    return problem_of(recording, field, np.diag([0.02, 0.01, 0.03]) ** 2).heard_in(found)


def test_the_gradient_of_excerpts_is_that_of_their_posterior() -> None:
    """Of every size, by differences; what first states say, too."""
    problem = heard_in_four_seconds(climbing())
    theta = 0.3 * np.random.default_rng(2).standard_normal(len(problem.sizes))
    value, gradient = problem.value_and_gradient(theta)
    assert value == pytest.approx(problem.value(theta), abs=1e-6)
    for i, size in enumerate(problem.sizes):
        if size.linear:
            continue
        step = np.zeros(len(theta))
        step[i] = 0.01
        slope = (problem.value(theta + step) - problem.value(theta - step)) / 0.02
        assert gradient[i] == pytest.approx(slope, rel=0.05, abs=1.0), (size.sensor, size.key)


def test_pressures_tell_what_heights_tell_in_excerpts() -> None:
    """They count from the first of an excerpt, 24 m above the first of the log."""
    recording = climbing()
    baro = recording.streams["baro"]
    pressure = 101325.0 * (1.0 - 2.25577e-5 * baro["height"]) ** 5.25588  # of the standard atmosphere
    streams = {**recording.streams, "baro": Stream(baro.t, {"pressure": pressure})}
    heights, pressures = (heard_in_four_seconds(one) for one in (recording, recording.replace(streams=streams)))
    none = np.zeros(len(heights.sizes))
    assert heights.value(none) == pytest.approx(pressures.value(none), abs=5.0)


def test_the_sizes_of_a_long_log_are_found_in_its_excerpts(flown: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    """And its filter runs on all of it."""
    monkeypatch.setattr(excerpts, "SECONDS", 10.0)
    monkeypatch.setattr(excerpts, "LONG", 80.0)
    recording = between(flown, 0.0, 120.0)
    recording = recording.replace(streams={name: recording.streams[name] for name in ("imu", "gps")})
    ready = prepared(recording)
    assert f"{EXCERPTS} excerpts" in " ".join(ready.notes)
    assert ready.run().t_end == pytest.approx(recording.streams["imu"].t[-1])
    for key in ("noise_std", "velocity_noise_std"):
        assert getattr(ready.levels.specs["gps"], key) == pytest.approx(getattr(SPECS["gps"], key), rel=0.3)
    short = prepared(between(recording, 0.0, 20.0))
    assert "excerpts" not in " ".join(short.notes)
