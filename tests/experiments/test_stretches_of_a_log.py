"""A log that is silent for a while: what the commands say of it, and what they find."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from sinan.experiments.commands import estimate as estimate_command
from sinan.experiments.commands import trace as trace_command
from sinan.experiments.scenarios import load_scenario, parse_effect
from sinan.sensors.formats.plain import write_recording
from sinan.sensors.recording import Recording, Truth
from sinan.sensors.simulate import simulate

#: The autopilot logs nothing between them [s].
SILENT = (22.0, 34.0)


def silent(recording: Recording) -> Recording:
    """The recording with no reading at all for twelve seconds of its flight."""
    kept = {name: s.rows((s.t < SILENT[0]) | (s.t >= SILENT[1])) for name, s in recording.streams.items()}
    return recording.replace(streams=kept)


def test_both_sides_of_a_gap_are_told_and_show_one_effect(tmp_path: Path) -> None:
    hidden = [parse_effect("mag.current=0.003,0,0.001")]
    recording, truth = simulate(load_scenario("figure_eight"), np.random.default_rng(5), hidden)
    log = silent(recording.replace(truth=Truth(truth, kind="simulation")))
    write_recording(log, tmp_path / "log")
    text = estimate_command.run(str(tmp_path / "log"), "numba", None, None, tmp_path / "e.json", None)
    assert "a new stretch begins" in text
    found = json.loads((tmp_path / "e.json").read_text())["truth"]
    assert found["attitude_rms"] < 8.0
    text = trace_command.run([str(tmp_path / "log")], None, 0.01, None, None, tmp_path / "t.json", None)
    report = json.loads((tmp_path / "t.json").read_text())
    assert [effect["name"] for effect in report["effects"]] == ["mag.current"]
    beta, std = (np.array(report["effects"][0][key]) for key in ("beta", "std"))
    assert np.all(np.abs(beta - [0.003, 0.0, 0.001]) < 4.0 * std)
    assert "2 stretches" in text
    assert any("22 s" in note and "34 to" in note for note in report["notes"])
