"""The README's own examples: the map reads the log that it describes, and the commands are commands."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import typer.main

from sinan.experiments.commands.cli import app
from sinan.experiments.datasets import resolve
from sinan.experiments.residual_loop.open_source import triad_readings
from sinan.experiments.scenarios.loader import load_scenario, scenario_names
from sinan.sensors.effects import CATALOGUE
from sinan.sensors.formats.plain import write_recording
from sinan.sensors.recording import ACCEL, GYRO, MAG
from sinan.sensors.simulate import simulate

README = (Path(__file__).resolve().parents[2] / "README.md").read_text(encoding="utf-8")
FORMATS, SCENARIOS = (
    (Path(__file__).resolve().parents[2] / "docs" / name).read_text(encoding="utf-8")
    for name in ("formats.md", "scenarios.md")
)
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


def test_the_plain_format_is_as_it_is_described(tmp_path: Path) -> None:
    text = re.findall(r"## The plain format.+?```toml\n(.+?)```", FORMATS, re.DOTALL)[0]
    flight, _ = simulate(load_scenario("square"), np.random.default_rng(2))
    write_recording(flight, tmp_path / "run")
    (tmp_path / "run" / "recording.toml").write_text(text)
    recording = resolve(str(tmp_path / "run"), None)
    assert recording.name == "hover-01"
    assert recording.spec("gyro").noise_density is None
    assert recording.effects == {"mag.current": (0.001, 0.0, 0.0)}
    for name, stream in flight.streams.items():
        line = next(line for line in FORMATS.splitlines() if line.startswith("|") and f"`{name}.csv`" in line)
        assert all(re.sub(r"\d+$", "1", column) in line for column in stream.columns)


def test_the_scenario_of_ones_own_flies(tmp_path: Path) -> None:
    text = re.findall(r"```toml\n(like.+?)```", SCENARIOS, re.DOTALL)[0]
    (tmp_path / "my.toml").write_text(text)
    recording, _ = simulate(load_scenario(str(tmp_path / "my.toml")), np.random.default_rng(1))
    assert recording.streams["imu"].t[-1] == pytest.approx(13.0, abs=0.1)


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


def test_the_lines_of_python_run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    import matplotlib as mpl
    from matplotlib import pyplot

    mpl.use("agg")
    shown: list[list[int]] = []
    monkeypatch.setattr(pyplot, "show", lambda: shown.append(pyplot.get_fignums()))
    (code,) = re.findall(r"```python\n(.+?)```", README, re.DOTALL)
    exec(compile(code, "README.md", "exec"), {})
    pyplot.close("all")
    assert len(shown) == 1
    assert shown[0], "no figure"
    assert "0.0 start [" in capsys.readouterr().out
