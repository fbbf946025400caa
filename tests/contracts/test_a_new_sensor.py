"""One file and one line: the example of docs/how_to_add_a_sensor.md, run as it stands there."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sinan.sensors as sensors
from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import flight_model
from sinan.estimator.filter.layout import CAPACITY, StateLayout, blocks
from sinan.estimator.filter.run_filter import run_filter
from sinan.experiments.residual_loop.select import select
from sinan.experiments.scenarios import load_scenario, parse_effect
from sinan.sensors import registry
from sinan.sensors.effects import CATALOGUE
from sinan.sensors.errors import InputError
from sinan.sensors.formats.plain import read_recording, write_recording
from sinan.sensors.motion import Motion
from sinan.sensors.recording import Recording
from sinan.sensors.sensor_type import Given
from sinan.sensors.simulate import simulate
from sinan.sensors.window import window

GUIDE = Path(__file__).parents[2] / "docs" / "how_to_add_a_sensor.md"
LATE = 0.08  # s, as the guide's command has it
THREE_SIGMA = 3.0
AGREEMENT = 1e-9  # of sigma
HIGH, MILLIMETRE = 10.0, 1e-3  # m


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The guide's file in a folder of the package, the guide's line in the registry; the guide's scenario."""
    text, folder = GUIDE.read_text(encoding="utf-8"), tmp_path_factory.mktemp("fan")
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    (module,) = re.findall(r'```\n    "(\w+)",\n```', text)
    (toml,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    file = re.search(r"`sensors/(\w+\.py)`:", text)
    assert file is not None
    (folder / file[1]).write_text(code, encoding="utf-8")
    (folder / "fan.toml").write_text(toml, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sensors, "__path__", [*sensors.__path__, str(folder)])
        patch.setattr(registry, "_LINES", (module,))
        registry._read()
        yield folder / "fan.toml"
    registry.remove("fan")
    sys.modules.pop(f"sinan.sensors.{module}", None)


@pytest.fixture(scope="module")
def recording(scenario: Path, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Flown with late stamps, written, and read back."""
    late = parse_effect(f"fan.time_offset={LATE}")
    flown, _ = simulate(load_scenario(scenario), np.random.default_rng(1), [late])
    folder = tmp_path_factory.mktemp("flown") / "flight"
    write_recording(flown, folder)
    read = read_recording(folder)
    np.testing.assert_allclose(read.streams["fan"]["range_2"], flown.streams["fan"]["range_2"], rtol=1e-9)
    assert read.spec("fan").noise_std == 0.03
    return read


@pytest.fixture(scope="module")
def beginning(scenario: Path) -> Recording:
    """Four seconds without the effect."""
    return window(simulate(load_scenario(scenario), np.random.default_rng(2))[0], (0.0, 4.0))


def test_its_height_is_that_of_the_rotation_matrix(scenario: Path) -> None:
    roll, pitch = np.deg2rad([20.0, -35.0, 12.0]), np.deg2rad([20.0, 15.0, -30.0])
    C_nb = Rotation.from_euler("ZYX", np.column_stack([np.full(3, 0.7), pitch, roll])).as_matrix()
    fan = registry.sensor("fan")
    model = fan.make(Given(0.03))
    ranges = HIGH / (C_nb @ model.beams_b.T)[:, 2]  # to flat ground: beam by beam the height over its way down
    assert np.all(ranges > 0.0)
    np.testing.assert_allclose(fan.height(model, ranges, roll, pitch), HIGH, rtol=0, atol=MILLIMETRE)


@pytest.mark.parametrize(("slant", "softness", "heard"), [(11.9, 0.0, True), (5.9, 0.75, True), (6.1, 0.75, False)])
def test_soft_ground_is_heard_to_half_the_range(scenario: Path, slant: float, softness: float, heard: bool) -> None:
    """The outer beams have the longest way: `slant` m, level, at 25 deg; of 12 m a share sqrt(1 - 0.75) is left."""
    fan = registry.sensor("fan")
    above = np.array([[0.0, 0.0, -slant * np.cos(np.deg2rad(25.0))]])
    level = Motion(np.zeros(1), above, q_nb=np.array([[1.0, 0.0, 0.0, 0.0]]))
    assert fan.heard(fan.make(Given(0.03, maximum=12.0)), level, softness).tolist() == [heard]


def test_both_engines_filter_it(beginning: Recording) -> None:
    alone = beginning.replace(streams={name: beginning.streams[name] for name in ("imu", "mag", "fan")})
    model = flight_model(alone, specs={"fan": replace(alone.spec("fan"), bias_std=0.1, bias_walk=1e-3)})
    assert model.layout.has("b_fan")
    fast, slow = (run_filter(Flight(alone, model), engine=engine) for engine in ("numba", "filterpy"))
    sigma = np.sqrt(fast.P_end.diagonal())
    assert np.max(np.abs(model.layout.difference(fast.x_end, slow.x_end)) / sigma) < AGREEMENT
    assert np.mean(fast.stream("fan").nis) < 2.0 * 3  # of a chi-square of 3, over 80 readings


def test_as_a_form_it_gives_what_the_branch_gives(beginning: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    branch = run_filter(Flight.of(beginning), engine="numba")
    monkeypatch.setitem(registry._SENSORS, "fan", replace(registry.sensor("fan"), kernel="form"))
    form = run_filter(Flight.of(beginning), engine="numba")
    assert form.iterations > branch.iterations
    change = form.model.layout.difference(form.x_end, branch.x_end) / np.sqrt(branch.P_end.diagonal())
    assert np.max(np.abs(change[:6])) < 0.1  # of a sigma of place and speed: linear about the smoothed motion


def test_the_trace_names_what_it_lacks(recording: Recording) -> None:
    part = window(recording, (0.0, 35.0))
    found = select(FlightSource(Flight.of(part)))
    assert found.names == ("fan.time_offset",)
    (finding,) = found.findings
    assert abs(finding.beta[0] - LATE) < THREE_SIGMA * finding.std[0]


def test_too_many_states_are_refused_by_name(scenario: Path) -> None:
    assert "b_fan" in blocks()
    assert "fan.outliers" in CATALOGUE
    for copy in ("second", "third"):
        registry.register(replace(registry.sensor("fan"), name=copy))
    try:
        with pytest.raises(ValueError, match=f"b_third.*room for {CAPACITY}"):
            StateLayout(tuple(blocks()))
    finally:
        for copy in ("second", "third"):
            registry.remove(copy)


def test_a_recording_with_too_many_states_is_refused(beginning: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    states = flight_model(beginning).layout.n
    monkeypatch.setattr("sinan.estimator.filter.flight_model.CAPACITY", states)
    flight_model(beginning)
    monkeypatch.setattr("sinan.estimator.filter.flight_model.CAPACITY", states - 1)
    with pytest.raises(InputError, match=f"{states} states of .*b_mag.*at most {states - 1}"):
        flight_model(beginning)
