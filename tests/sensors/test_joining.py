"""Logs of one vehicle as one recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import flight_model
from sinan.estimator.filter.run_filter import run_filter
from sinan.sensors.errors import InputError
from sinan.sensors.joining import joined
from sinan.sensors.recording import NO_HEIGHT, Initial, SensorSpec, Stream, tells_height
from tests.estimator.analytic_flight import fly


def test_each_log_is_filtered_as_it_is_alone() -> None:
    logs = [fly(seed, duration=6.0)[0].replace(initial=Initial()) for seed in (1, 2)]
    both = joined(logs)
    model = flight_model(both, gate_level=None)
    together = run_filter(Flight(both, model), engine="numba")
    alone = [run_filter(Flight(log, model), engine="numba") for log in logs]
    rows = np.cumsum([0, *(len(one.imu_t) for one in alone)])
    assert len(together.imu_t) == rows[-1]
    for one, first, last, shift in zip(alone, rows[:-1], rows[1:], (0.0, 1000.0), strict=True):
        assert np.allclose(together.imu_t[first:last], one.imu_t + shift, rtol=0.0, atol=1e-9)
        # readings of one instant may change places by rounding
        assert np.allclose(together.imu_x[first:last], one.imu_x, rtol=0.0, atol=2e-3)
    assert together.log_likelihood == pytest.approx(sum(one.log_likelihood for one in alone), abs=0.1)


def test_a_stream_of_one_log_alone_is_read_there() -> None:
    first, second = fly(1, duration=4.0)[0], fly(2, duration=4.0, sensors=("mag", "gps"))[0]
    both = joined([first, second.replace(sensors=first.sensors)])
    assert float(both.streams["baro"].t[-1]) < 4.1
    assert float(both.streams["gps"].t[-1]) > 1000.0
    assert any(note.startswith("log 2") and "1000 s" in note for note in both.notes)


def test_fixes_of_one_log_that_tell_no_height_tell_none_among_others() -> None:
    first, second = (fly(seed, duration=4.0)[0] for seed in (1, 2))
    gps = first.streams["gps"]
    flat = Stream(gps.t, {**gps.columns, "down": np.zeros(len(gps)), "epv": np.full(len(gps), NO_HEIGHT)})
    for logs in ([first.replace(streams={**first.streams, "gps": flat}), second], [first, second]):
        fixes = joined(logs).streams["gps"]
        assert np.array_equal(tells_height(fixes), (fixes.t > 500.0) | (logs[0] is first))


def test_one_log_is_itself() -> None:
    log = fly(1, duration=2.0)[0]
    assert joined([log]) is log


def test_logs_that_declare_different_instruments_are_of_two_vehicles() -> None:
    log = fly(1, duration=2.0)[0]
    other = log.replace(name="other", sensors={**log.sensors, "mag": SensorSpec(noise_std=0.5)})
    with pytest.raises(InputError, match="sensors"):
        joined([log, other])
    elsewhere = replace(log.environment, magnetic_field=np.array([0.3, 0.0, 0.1]))
    with pytest.raises(InputError, match="environment"):
        joined([log, log.replace(environment=elsewhere)])
