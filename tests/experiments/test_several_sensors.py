"""Poses with several sensors: all of them in one report, whose candidates are one family."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from typer.testing import CliRunner

from sinan.estimator.evidence.source import log_p_needed
from sinan.experiments.commands import calibrate as calibrate_command
from sinan.experiments.commands import trace as trace_command
from sinan.experiments.commands.cli import app
from sinan.experiments.report.trace_page import evidence
from sinan.experiments.residual_loop.open_source import pose_source
from sinan.experiments.residual_loop.run import trace_recording
from sinan.experiments.residual_loop.traced import Traced
from sinan.experiments.scenarios import parse_effect
from sinan.experiments.scenarios.loader import load_scenario
from sinan.sensors.errors import InputError
from sinan.sensors.formats.plain import write_recording
from sinan.sensors.recording import Recording
from sinan.sensors.simulate import simulate
from tests.experiments.test_residual_loop import SCHEMA
from tests.experiments.test_verdict import RULES


def simulated(scenario: str, *effects: str, seed: int = 7) -> Recording:
    recording, _ = simulate(load_scenario(scenario), np.random.default_rng(seed), [parse_effect(e) for e in effects])
    return recording


@pytest.fixture(scope="module")
def board() -> Recording:
    """A board turned by hand from rest to rest, with crooked axes of two of its three sensors."""
    turned = simulated("gyro_poses", "gyro.cross_axis=0.02,0,0,0.01,0,-0.02")
    mag = simulated("mag_poses", "mag.cross_axis=0.03,0,-0.02")
    return turned.replace(
        name="board",
        streams={**turned.streams, "mag": mag.streams["mag"]},
        sensors={**turned.sensors, "mag": mag.sensors["mag"]},
        environment=mag.environment,
    )


@pytest.fixture(scope="module")
def folder(board: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "board"
    write_recording(board, path)
    return path


@pytest.fixture(scope="module")
def together(folder: Path) -> Traced:
    """One command, no sensor named; what it found."""
    found: list[Traced] = []

    def remember(*arguments: Any) -> Traced:
        found.append(trace_recording(*arguments))
        return found[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sinan.experiments.answers.traces.trace_recording", remember)
        files = folder.parent / "trace.json", folder.parent / "trace.html"
        trace_command.run([str(folder)], None, 0.01, None, None, *files)
    return found[0]


@pytest.fixture(scope="module")
def document(together: Traced, folder: Path) -> Mapping[str, Any]:
    """Its JSON."""
    assert len(together.parts) == 3
    found: dict[str, Any] = json.loads((folder.parent / "trace.json").read_text())
    return found


def test_one_report_has_what_every_sensor_lacks(document: Mapping[str, Any], folder: Path) -> None:
    jsonschema.validate(document, {"allOf": [SCHEMA, RULES]})
    assert {effect["name"] for effect in document["effects"]} == {"gyro.cross_axis", "mag.cross_axis"}
    assert document["verdict"] == "effects"
    assert [one["sensor"] for one in document["sensors"]] == ["accel", "gyro", "mag"]
    assert {c["name"].split(".")[0] for c in document["candidates"]} == {"accel", "gyro", "mag"}
    first = document["effects"][0]["name"].split(".")[0]
    assert document["error"]["stream"] == first
    page = (folder.parent / "trace.html").read_text()
    assert page.count("<h1>") == 1
    assert page.count("Evidence for every candidate</h2>") == 1
    for effect in ("gyro.cross_axis", "mag.cross_axis"):
        assert f"<h3>{effect}: " in page


def test_candidates_of_all_sensors_are_one_family(
    board: Recording, together: Traced, document: Mapping[str, Any]
) -> None:
    """Every candidate has to pass at alpha over the number of all, whichever sensor it is of."""
    alone = [pose_source(board, sensor).families for sensor in ("accel", "gyro", "mag")]
    assert together.families == sum(alone)
    for part in together.parts:
        assert log_p_needed(part.source, part.trace.alpha) == pytest.approx(np.log(0.01 / sum(alone)))
    needed = document["p_value_needed"]
    assert needed == pytest.approx(0.01 / sum(alone))
    assert all((bar.log10_p < np.log10(needed)) == (bar.kind == "found") for bar in evidence(together))


def test_the_sensor_named_is_traced_alone(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "mag.json"
    text = trace_command.run([str(folder)], "mag", 0.01, None, None, out, None)
    one = json.loads(out.read_text())
    assert [effect["name"] for effect in one["effects"]] == ["mag.cross_axis"]
    assert {c["name"].split(".")[0] for c in one["candidates"]} == {"mag"}
    assert one["sensors"] == []
    assert text.splitlines()[0] == "board: effects"


def test_a_sensor_that_cannot_be_traced_is_left_out_and_said_to_be(board: Recording, tmp_path: Path) -> None:
    """An IMU that logs for the first ten seconds rests too seldom: the magnetometer does not mind."""
    imu = board.streams["imu"]
    short = imu.rows(np.asarray(imu.t < imu.t[0] + 10.0))
    write_recording(board.replace(streams={**board.streams, "imu": short}), tmp_path / "run")
    text = trace_command.run([str(tmp_path / "run")], None, 0.01, None, None, tmp_path / "t.json", tmp_path / "t.html")
    found = json.loads((tmp_path / "t.json").read_text())
    assert [effect["name"] for effect in found["effects"]] == ["mag.cross_axis"]
    assert [one["sensor"] for one in found["left_out"]] == ["accel", "gyro"]
    assert "static pose" in found["left_out"][0]["why"]
    assert "static poses; expected at least 6" in text
    assert "The accelerometer was not traced: " in (tmp_path / "t.html").read_text()


def test_where_no_sensor_can_be_traced_one_line_says_why(board: Recording, tmp_path: Path) -> None:
    short = {name: stream.rows(slice(0, 5)) for name, stream in board.streams.items() if name != "power"}
    with pytest.raises(InputError, match=r"accel: .*; gyro: .*; mag: ") as error:
        trace_recording(board.replace(streams=short))
    assert "\n" not in str(error.value)


def test_calibrate_all_has_a_block_a_sensor(folder: Path, tmp_path: Path) -> None:
    out, page = tmp_path / "all.json", tmp_path / "all.html"
    text = calibrate_command.run("all", str(folder), None, None, None, out, page)
    blocks = json.loads(out.read_text())["sensors"]
    assert list(blocks) == ["accel", "gyro", "mag"]
    for sensor, block in blocks.items():
        calibrate_command.run(sensor, str(folder), None, None, None, tmp_path / "one.json", None)
        one = json.loads((tmp_path / "one.json").read_text())
        assert {key: block[key] for key in ("T", "K", "b", "std", "sse")} == {
            key: one[key] for key in ("T", "K", "b", "std", "sse")
        }
        assert f"{sensor}: calibrated = T K (reading + b)" in text
    html = page.read_text()
    assert "<h1>board: accelerometer, gyroscope and magnetometer calibrated</h1>" in html
    for name in ("Accelerometer", "Gyroscope", "Magnetometer"):
        assert f"<h2>{name}</h2>" in html


def test_calibrate_takes_all_for_a_sensor(folder: Path) -> None:
    result = CliRunner().invoke(app, ["calibrate", "all", str(folder)])
    assert result.exit_code == 0, result.output
    assert "mag: calibrated" in result.output


@pytest.mark.measured
@pytest.mark.usefixtures("measured_data")
def test_a_measured_board_needs_no_sensor_named(tmp_path: Path) -> None:
    """Its accelerometer and gyroscope, whose axes its makers' calibration found crooked too."""
    trace_command.run(["mpu9150_imu_calib/imu0.log"], None, 0.01, None, None, tmp_path / "t.json", None)
    document = json.loads((tmp_path / "t.json").read_text())
    assert {e["name"] for e in document["effects"]} == {"accel.cross_axis", "gyro.cross_axis", "gyro.scale"}
    for one in document["sensors"]:
        assert one["error"]["after"]["rms"] < one["error"]["before"]["rms"]


@pytest.mark.measured
@pytest.mark.usefixtures("measured_data")
def test_a_measured_sphere_whose_gyroscope_hardly_rests(tmp_path: Path) -> None:
    """Five rests: no accelerometer's calibration, and a gyroscope's that does not settle."""
    calibrate_command.run("all", "mpu6050_hmc5883l/set-2/full-sphere", None, None, None, tmp_path / "c.json", None)
    document = json.loads((tmp_path / "c.json").read_text())
    assert list(document["sensors"]) == ["mag"]
    accel, gyro = (next(one["why"] for one in document["left_out"] if one["sensor"] == n) for n in ("accel", "gyro"))
    assert "no accelerometer that rests" in accel
    assert "does not settle" in gyro
