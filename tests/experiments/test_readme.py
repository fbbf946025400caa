"""The README's own examples: the map reads the log that it describes, and the commands are commands."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import typer.main

from experiments.cli import app
from experiments.datasets import resolve
from experiments.residual_loop.open_source import triad_readings
from experiments.scenarios.loader import load_scenario, scenario_names
from sensors.effects import CATALOGUE
from sensors.recording import ACCEL, GYRO, MAG
from sensors.simulate import simulate

README = (Path(__file__).resolve().parents[2] / "README.md").read_text(encoding="utf-8")
COMMANDS = [line.split("#")[0].split() for line in re.findall(r"^sinan .+$", README, re.MULTILINE)]


@pytest.fixture
def own_log(tmp_path: Path) -> Path:
    """A log as the README describes it: g, deg/s, uT; x to the right, y forward, z up."""
    recording, _ = simulate(load_scenario("gyro_poses"), np.random.default_rng(2))
    imu = recording.streams["imu"]
    field = np.tile([0.5, 0.1, 0.8], (len(imu), 1))  # gauss
    columns = [imu.array(ACCEL) / 9.80665, np.rad2deg(imu.array(GYRO)), 100.0 * field]
    turned = [value[:, [1, 0, 2]] * [1.0, 1.0, -1.0] for value in columns]
    rows = np.hstack([1000.0 * imu.t[:, None], *turned])
    file = tmp_path / "log.csv"
    np.savetxt(file, rows, delimiter=",", header="t_ms,ax,ay,az,gx,gy,gz,mx,my,mz", comments="", fmt="%.9g")
    return file


def test_the_map_reads_the_log_that_it_describes(own_log: Path) -> None:
    (text,) = re.findall(r"```toml\n(.+?)```", README, re.DOTALL)
    assert len(text.splitlines()) == 10
    map_file = own_log.with_suffix(".toml")
    map_file.write_text(text)
    recording = resolve(str(own_log), map_file)
    assert recording.kind == "poses"
    readings = triad_readings(recording, "accel")
    assert np.median(np.linalg.norm(readings.reading, axis=1)) == pytest.approx(9.8, abs=0.3)
    np.testing.assert_allclose(recording.streams["mag"].array(MAG)[0], [0.5, 0.1, 0.8], rtol=1e-6)


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_every_command_is_one(command: list[str]) -> None:
    group = typer.main.get_command(app)
    known = group.commands[command[1]]  # type: ignore[attr-defined]
    options = {option for parameter in known.params for option in parameter.opts}
    assert {word for word in command if word.startswith("--")} <= options
    effects = [command[k + 1].split("=")[0] for k, word in enumerate(command) if word == "--effect"]
    assert set(effects) <= set(CATALOGUE)
    if command[1] in ("simulate", "montecarlo", "observability"):
        assert command[2] in scenario_names()
