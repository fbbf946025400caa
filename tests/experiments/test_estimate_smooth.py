"""`sinan estimate --smooth`: the states given all readings, and their errors."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import flight_model
from sinan.estimator.filter.run_filter import run_filter
from sinan.estimator.filter.smoother import smooth
from sinan.experiments.answers.estimates import estimate
from sinan.experiments.commands import estimate as estimate_command
from sinan.experiments.datasets import resolve
from sinan.experiments.estimate import bias_courses, report_of
from sinan.experiments.report.estimate_words import gaps_in_words
from sinan.experiments.report.estimate_words import summary as estimate_summary
from sinan.experiments.report.figures import biases_over_time
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.formats.plain import write_recording
from sinan.sensors.recording import Truth
from sinan.sensors.simulate import simulate


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hover whose file has the truth."""
    folder = tmp_path_factory.mktemp("smooth") / "hover"
    recording, truth = simulate(load_scenario("hover"), np.random.default_rng(12))
    write_recording(recording.replace(truth=Truth(truth, kind="simulation")), folder)
    return folder


def test_the_smoother_errs_less_than_the_filter(flight: Path, tmp_path: Path) -> None:
    out = tmp_path / "e.json"
    text = estimate_command.run(str(flight), "numba", None, None, out, None, smoothed=True)
    truth = json.loads(out.read_text())["truth"]
    for name in ("velocity_rms", "attitude_rms"):
        assert truth["smoothed"][name] < 0.9 * truth[name]
    assert text.count(", smoothed ") == sum(name.endswith("_rms") for name in truth)


def test_its_states_are_written_and_its_biases_where_it_begins(flight: Path, tmp_path: Path) -> None:
    out, states = tmp_path / "e.json", tmp_path / "states.csv"
    estimate_command.run(str(flight), "numba", states, None, out, None, smoothed=True)
    recording = resolve(str(flight))
    model = flight_model(recording)
    known = smooth(run_filter(Flight(recording, model), engine="numba"), sigmas=True)
    with states.open() as file:
        rows = list(csv.reader(file))
    values = np.array([[float(cell) for cell in row] for row in rows[1:]])
    step = round((values[1, 0] - values[0, 0]) / float(np.median(np.diff(known.t))))
    n = known.x.shape[1]
    assert np.allclose(values[:, 1 : n + 1], known.x[::step], rtol=1e-7, atol=1e-7)
    assert np.allclose(values[0, n + 1 :], known.sigma[0], rtol=1e-5)
    found = json.loads(out.read_text())["smoothed"]
    bias = model.layout.nominal("b_gyro")
    assert np.allclose(found["bias_at_start"]["gyro"], known.x[0, bias])
    assert np.all(np.array(found["bias_at_start_std"]["gyro"]) < 0.9 * model.gyro.bias.std)


def test_a_bias_is_not_drawn_where_the_imu_was_silent(flight: Path) -> None:
    """Ten seconds without a sample, through which a line would look estimated."""
    recording = resolve(str(flight))
    imu = recording.streams["imu"]
    silent = recording.replace(streams={**recording.streams, "imu": imu.rows((imu.t <= 10.0) | (imu.t >= 20.0))})
    journal = run_filter(Flight(silent, flight_model(silent)), engine="numba")
    courses = bias_courses(journal, None)
    for course in courses:
        inside = (course.t > 10.0) & (course.t < 20.0)
        assert course.t[inside] == pytest.approx([15.0], abs=0.1)
        assert np.all(np.isnan(course.value[inside]))
        assert np.all(np.isnan(course.sigma[inside]))
        assert np.all(np.isfinite(course.value[~inside]))
    for one in biases_over_time(courses).axes:
        assert not one.get_visible() or np.all(np.isfinite(one.get_ylim()))
    document = report_of(journal)
    assert document["gaps"]["count"] == 1
    assert document["gaps"]["longest"] == pytest.approx([10.0, 20.0], abs=0.02)
    assert gaps_in_words(document) == "without IMU from 10 s to 20 s"
    whole = report_of(run_filter(Flight(recording, flight_model(recording)), engine="numba"))
    assert gaps_in_words(whole) == ""
    several = {"gaps": {"count": 3, "total": 12.5, "longest": [10.0, 20.0]}}
    assert gaps_in_words(several) == "12.5 s of it in 3 gaps of the IMU, the longest from 10 s to 20 s"


def test_gaps_too_short_to_be_seen_leave_a_line_whole(flight: Path) -> None:
    """Five samples lost every second."""
    recording = resolve(str(flight))
    imu = recording.streams["imu"]
    broken = recording.replace(streams={**recording.streams, "imu": imu.rows(np.arange(len(imu)) % 100 >= 5)})
    journal = run_filter(Flight(broken, flight_model(broken)), engine="numba")
    assert report_of(journal)["gaps"]["count"] > 10
    assert all(np.all(np.isfinite(course.value)) for course in bias_courses(journal, None, most=100))


def test_the_first_line_says_that_the_imu_was_silent(flight: Path) -> None:
    answer = estimate(resolve(str(flight)))
    gaps = {"count": 1, "total": 10.0, "longest": [10.0, 20.0]}
    first, *_ = estimate_summary("hover", {**answer.document, "gaps": gaps}).splitlines()
    assert first.endswith(" s, without IMU from 10 s to 20 s")
