"""Every key that a command writes is on the page that documents them, and every key that a reader of TOML knows."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from sinan.calibration.cameras.views import write_corners
from sinan.experiments.autopilots.terms import Terms
from sinan.experiments.commands.cli import app
from sinan.sensors.formats.header import SENSOR_KEYS
from sinan.sensors.formats.plain import write_recording
from sinan.sensors.recording import ACCEL, GYRO, Recording, Stream
from tests.calibration.test_camera import SIZE, simulated
from tests.experiments.test_camera import BENT

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "json.md").read_text(encoding="utf-8")


def documented(command: str) -> list[re.Pattern[str]]:
    """The keys of one section, `*` standing for one name."""
    section = re.search(rf"^## `sinan {command}`\n(.*?)(?=^## |\Z)", PAGE, re.DOTALL | re.MULTILINE)
    assert section is not None, command
    cells = re.findall(r"^\| (`.*?) \|", section[1], re.MULTILINE)
    names = [name for cell in cells for name in re.findall(r"`([^`]+)`", cell)]
    return [re.compile(re.escape(name).replace(r"\*", r"[^.]+")) for name in names]


def written(value: Any, path: str = "") -> Iterator[str]:
    """The keys of a document; an empty record is one itself."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            name = key.replace(".", "_")
            yield from written(inner, f"{path}.{name}" if path else name)
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for inner in value:
            yield from written(inner, f"{path}[]")
    else:
        yield path


COMMANDS = {
    "trace": ["trace", "{poses}"],
    "estimate": ["estimate", "{flight}", "--smooth", "--to", "20"],
    "calibrate": ["calibrate", "mag", "{poses}"],
    "montecarlo": ["montecarlo", "hover", "--runs", "2"],
    "observability": ["observability", "{flight}"],
    "info": ["info", "{flight}"],
    "ranges": ["ranges", "{ranges}"],
    "allan": ["allan", "{rest}"],
    "heights": ["heights", "{low}"],
    "camera": ["camera", "{corners}"],
}


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("json_keys")
    made = {"flight": "hover", "poses": "mag_poses", "low": "low_pass"}
    for name, scenario in made.items():
        effect = ["--effect", "mag.cross_axis=0.03,0,-0.02"]
        result = CliRunner().invoke(app, ["simulate", scenario, str(folder / name), *effect, "--seed", "7"])
        assert result.exit_code == 0, result.output
    short = folder / "short.toml"
    short.write_text('like = "static_p"\nseconds = 90\n[[fault]]\nsatellite = "G01"\noffset = 3.0\n', encoding="utf-8")
    t = np.arange(0.0, 60.0, 0.02)
    still = np.random.default_rng(1).normal([0.0, 0.0, -9.81, 0.0, 0.0, 0.0], 1e-3, (len(t), 6))
    imu = Stream(t, dict(zip((*ACCEL, *GYRO), still.T, strict=True)))
    write_recording(Recording("rest", "flight", {"imu": imu}), folder / "rest")
    corners = folder / "corners.csv"
    write_corners(corners, simulated(BENT, 8, 2, 0.15), SIZE)
    places = {name: folder / name for name in (*made, "rest")} | {"ranges": short, "corners": corners}
    return {name: str(place) for name, place in places.items()}


@pytest.mark.parametrize("command", COMMANDS)
def test_every_key_that_is_written_is_documented(command: str, recordings: dict[str, str], tmp_path: Path) -> None:
    words = [word.format(**recordings) for word in COMMANDS[command]]
    result = CliRunner().invoke(app, [*words, "--json", str(tmp_path / "out.json")])
    assert result.exit_code == 0, result.output
    keys = documented(command)
    found = set(written(json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))))
    missing = sorted(path for path in found if not any(key.fullmatch(path) for key in keys))
    assert not missing


def test_every_key_of_a_fleet_is_documented(recordings: dict[str, str], tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.csv"
    damaged.write_text("nothing\n")
    words = ["batch", recordings["poses"], str(damaged), "--out", str(tmp_path / "out"), "--workers", "1"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    document = json.loads((tmp_path / "out" / "fleet.json").read_text(encoding="utf-8"))
    assert len(document["failed"]) == 1
    keys = documented("batch")
    assert not sorted(path for path in set(written(document)) if not any(key.fullmatch(path) for key in keys))


def test_every_key_of_a_sensor_in_a_recording_is_documented() -> None:
    text = (DOCS / "formats.md").read_text(encoding="utf-8")
    missing = {key for keys in SENSOR_KEYS.values() for key in keys if not re.search(rf"[`\s]{key}\b", text)}
    assert not missing


def test_every_key_of_an_autopilots_parameters_is_documented() -> None:
    terms = Terms("px4", {})
    terms.put("EKF2_MAG_DELAY", 100.7, "mag.time_offset")
    terms.refuse("gyro.scale", "none")
    found = set(written({"autopilot": terms.as_table() | {"call": None}}))
    assert len(found) == 10
    assert not sorted(path for path in found if not any(key.fullmatch(path) for key in documented("params")))
