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
from sinan.experiments.commands import estimate as estimate_command
from sinan.experiments.datasets import resolve
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
