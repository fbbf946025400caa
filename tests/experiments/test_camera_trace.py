"""`sinan trace` on flights with a camera: nothing where nothing is hidden, and the effect that is."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from sinan.experiments.commands.cli import app
from sinan.sensors.formats.plain import write_recording
from tests.estimator.test_camera_filter import SIZES, flown


@pytest.mark.parametrize("name", ["", "camera.distortion", "camera.time_offset"])
def test_the_effect_of_a_camera_is_traced(name: str, tmp_path: Path) -> None:
    recording, _ = flown(name, SIZES[name]) if name else flown()
    write_recording(recording, tmp_path / "run")
    result = CliRunner().invoke(app, ["trace", str(tmp_path / "run"), "--json", str(tmp_path / "run.json")])
    assert result.exit_code == 0, result.output
    told = json.loads((tmp_path / "run.json").read_text())
    assert [one["name"] for one in told["effects"]] == ([name] if name else [])
    assert told["verdict"] == ("effects" if name else "no_effect")
    for one in told["effects"]:
        assert np.all(np.abs(np.array(one["beta"]) - SIZES[name]) < 4.0 * np.array(one["std"]))
        assert told["error"]["stream"] == "camera"
        assert told["error"]["after"]["rms"] < 0.25 * told["error"]["before"]["rms"]


def test_a_camera_is_simulated_and_traced_by_commands(tmp_path: Path) -> None:
    """A square of any scenario, given a camera: its lever arm is found, and the answer lies beside the recording."""
    run, beta = tmp_path / "run", [0.15, -0.1, 0.1]
    wanted = "camera.lever_arm=" + ",".join(map(str, beta))
    names = "accel,gyro,mag,baro,gps,camera"
    made = CliRunner().invoke(app, ["simulate", "square", str(run), "--sensors", names, "--effect", wanted])
    assert made.exit_code == 0, made.output
    traced = CliRunner().invoke(app, ["trace", str(run), "--json", str(tmp_path / "run.json")])
    assert traced.exit_code == 0, traced.output
    (found,) = json.loads((tmp_path / "run.json").read_text())["effects"]
    assert found["name"] == json.loads((tmp_path / "run.answer.json").read_text())["effects"][0]["name"]
    assert np.all(np.abs(np.array(found["beta"]) - beta) < 4.0 * np.array(found["std"]))
