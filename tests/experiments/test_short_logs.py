"""Logs of a row or a few: every command says in one line what is missing, or does what can be done."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
import pytest

from sinan.calibration.levels.preparation import prepared
from sinan.experiments.bias_observability.case import case_of_recording
from sinan.experiments.calibrate import calibrate_turns
from sinan.experiments.report.trace_words import detectable_sentence
from sinan.experiments.residual_loop.open_source import pose_source
from sinan.experiments.residual_loop.report import report
from sinan.experiments.residual_loop.run import trace_recording
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.errors import InputError
from sinan.sensors.recording import Environment, Recording
from sinan.sensors.simulate import simulate
from sinan.sensors.window import between


@pytest.fixture(scope="module")
def flight() -> Recording:
    return simulate(load_scenario("hover"), np.random.default_rng(3), [])[0]


def first_rows(recording: Recording, rows: int, *streams: str) -> Recording:
    """The first rows of some streams, of all where none is named."""
    cut = {n: s.rows(slice(0, rows)) if not streams or n in streams else s for n, s in recording.streams.items()}
    return recording.replace(streams=cut)


@pytest.mark.parametrize("rows", [1, 2, 3])
@pytest.mark.parametrize("sensor", ["accel", "gyro"])
def test_poses_of_a_few_rows(flight: Recording, rows: int, sensor: str) -> None:
    poses = first_rows(flight, rows).replace(kind="poses")
    with pytest.raises(InputError, match="0 static poses"):
        pose_source(poses, sensor)
    with pytest.raises(InputError, match="0 static poses"):
        calibrate_turns(poses, "full", None)


def test_a_flight_of_one_row(flight: Recording) -> None:
    for command in (prepared, case_of_recording, trace_recording):
        with pytest.raises(InputError, match="at least 2 IMU samples"):
            command(first_rows(flight, 1))
        with pytest.raises(InputError, match="at least 2 IMU samples"):
            command(first_rows(flight, 1, "imu").replace(environment=Environment(), sensors={}))


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_a_few_readings_leave_the_field_what_it_was_believed_to_be(flight: Recording, rows: int) -> None:
    ready = prepared(first_rows(flight, rows, "mag").replace(environment=Environment()))
    journal = ready.run()
    known = np.linalg.det(journal.P_end[journal.model.layout.slice("field"), journal.model.layout.slice("field")])
    assert ready.levels.field is not None
    assert 0.0 < known <= 1.001 * np.linalg.det(ready.levels.field)


@pytest.mark.parametrize("rows", [2, 3])
def test_a_flight_of_a_few_rows_is_traced_or_refused(flight: Recording, rows: int) -> None:
    try:
        (part,) = trace_recording(first_rows(flight, rows)).parts
    except InputError:
        return
    assert not part.trace.selection.findings


def test_a_lateness_longer_than_the_log_is_not_visible_in_it(flight: Recording) -> None:
    """A hover hardly tells when its compass was read."""
    brief = between(flight, 0.0, 1.0)
    traced = trace_recording(brief.replace(streams={n: brief.streams[n] for n in ("imu", "mag", "gps")}))
    (part,) = traced.parts
    plain = {s.name: s.detectable_from[0] for s in part.trace.selection.final_statistics}
    assert plain["mag.time_offset"] > 1.0
    told = {c["name"]: c for c in cast(Sequence[Mapping[str, Any]], report(traced)["candidates"])}
    assert told["mag.time_offset"]["detectable_from"] == [None]
    assert detectable_sentence(told["mag.time_offset"]) == "mag.time_offset: not visible in these data"
    assert told["gps.lever_arm"]["detectable_from"] != [None] * 3
