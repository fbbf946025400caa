"""An effect on a compass is said in the unit of the log's own field."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sinan.estimator.evidence.flights.source import field_of
from sinan.estimator.evidence.source import FieldUnit
from sinan.experiments.commands import estimate as estimate_command
from sinan.experiments.commands import trace as trace_command
from sinan.experiments.report.words import per_unit, unit_words
from sinan.experiments.residual_loop.report import report
from sinan.experiments.residual_loop.run import trace_recording
from sinan.experiments.scenarios import load_scenario, parse_effect
from sinan.sensors.effects import CATALOGUE
from sinan.sensors.recording import MAG, Recording, Stream
from sinan.sensors.simulate import simulate

#: A compass beside a motor lead: reading = B + b I, with B of 48 uT turned to all sides and b in uT/A.
FIELD, PER_AMPERE = 48.0, np.array([0.9, -0.4, 0.6])
GAUSS = 0.01  # of a microtesla
THREE_SIGMA = 3.0


def poses() -> tuple[np.ndarray, np.ndarray]:
    """(n,) current [A] and (n, 3) readings [uT] of a body turned to all sides, noise 0.05 uT."""
    rng = np.random.default_rng(5)
    direction = rng.standard_normal((240, 3))
    field = FIELD * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    current = rng.uniform(0.0, 12.0, len(field))
    return current, field + current[:, None] * PER_AMPERE + 0.05 * rng.standard_normal(field.shape)


def traced(log: Path, tmp_path: Path, map_file: Path | None = None) -> tuple[dict[str, Any], str]:
    """JSON and text of `sinan trace`."""
    text = trace_command.run([str(log)], None, 0.01, None, map_file, tmp_path / "t.json", tmp_path / "t.html")
    return json.loads((tmp_path / "t.json").read_text()), text


def off(effect: dict[str, Any], expected: np.ndarray) -> float:
    """Largest distance of the parameters from what was put in [sigma]."""
    return float(np.max(np.abs(np.array(effect["beta"]) - expected) / np.array(effect["std"])))


def test_of_a_log_in_microtesla_that_a_map_turns_into_gauss(tmp_path: Path) -> None:
    current, reading = poses()
    np.savetxt(tmp_path / "log.csv", np.column_stack([np.arange(len(reading)), reading, current]), delimiter=",")
    (tmp_path / "map.toml").write_text(
        'kind = "poses"\n[streams.poses]\ntime = 1\nmag = { columns = [2, 3, 4], unit = "uT" }\n'
        "[streams.poses.covariates]\ncurrent = 5\n"
    )
    document, text = traced(tmp_path / "log.csv", tmp_path, tmp_path / "map.toml")
    (effect,) = document["effects"]
    assert (effect["name"], effect["unit"]) == ("mag.current", ["gauss/A"] * 3)
    assert off(effect, GAUSS * PER_AMPERE) < THREE_SIGMA
    assert re.search(r"mag\.current: x 0\.00(9|8)\d* ± .* gauss/A; p", text)
    assert "up to 0.0090 gauss per ampere" in text
    assert "gauss/A" in (tmp_path / "t.html").read_text()
    others = {c["name"]: c for c in document["candidates"]}
    assert others["mag.cross_axis"]["unit"] == ["1"] * 3


def plain(folder: Path, environment: str) -> Path:
    current, reading = poses()
    folder.mkdir()
    (folder / "recording.toml").write_text(f'format = 1\nkind = "poses"\n[environment]\n{environment}\n')
    rows = np.column_stack([np.arange(len(reading)), reading, current])
    np.savetxt(folder / "poses.csv", rows, delimiter=",", header="t,mag_x,mag_y,mag_z,current", comments="")
    return folder


def test_of_a_recording_that_says_its_unit(tmp_path: Path) -> None:
    (effect,) = traced(plain(tmp_path / "run", 'field_unit = "uT"'), tmp_path)[0]["effects"]
    assert effect["unit"] == ["uT/A"] * 3
    assert off(effect, PER_AMPERE) < THREE_SIGMA


def test_what_is_said_can_be_declared_as_it_is(tmp_path: Path) -> None:
    """`[effects]` is in the unit of the log: with what was found written there, nothing is left to find."""
    folder = plain(tmp_path / "run", 'field_unit = "uT"')
    (effect,) = traced(folder, tmp_path)[0]["effects"]
    header = folder / "recording.toml"
    header.write_text(f'{header.read_text()}[effects]\n"mag.current" = {effect["beta"]}\n')
    assert traced(folder, tmp_path)[0]["effects"] == []


def test_where_nobody_says_the_unit_it_is_a_share_of_the_field(tmp_path: Path) -> None:
    (effect,) = traced(plain(tmp_path / "run", "gravity = 9.8"), tmp_path)[0]["effects"]
    assert effect["unit"] == ["1/A"] * 3
    mean = np.mean(np.linalg.norm(poses()[1], axis=1))
    assert off(effect, PER_AMPERE / mean) < THREE_SIGMA


def in_gauss(recording: Recording, size: float) -> Recording:
    """The flight with a field that is `size` gauss where its own is one."""
    mag, environment = recording.streams["mag"], recording.environment
    assert environment.magnetic_field is not None
    columns = {name: values * (size if name in MAG else 1.0) for name, values in mag.columns.items()}
    spec = recording.spec("mag")
    sizes = {name: size * (getattr(spec, name) or 0.0) for name in ("noise_std", "bias_std", "bias_walk")}
    return recording.replace(
        streams={**recording.streams, "mag": Stream(mag.t, columns)},
        sensors={**recording.sensors, "mag": replace(spec, **sizes)},
        environment=replace(environment, magnetic_field=size * environment.magnetic_field, field_unit="gauss"),
    )


def test_of_a_flight(tmp_path: Path) -> None:
    beta = np.array([0.004, -0.002, 0.001])
    effect = parse_effect(f"mag.current={','.join(map(str, beta))}")
    recording, _ = simulate(load_scenario("yaw_turns"), np.random.default_rng(23), [effect])
    document: dict[str, Any] = report(trace_recording(in_gauss(recording, 0.5)))
    (found,) = document["effects"]
    assert (found["name"], found["unit"]) == ("mag.current", ["gauss/A"] * 3)
    assert off(found, 0.5 * beta) < THREE_SIGMA
    assert document["error"]["stream"] == "mag"
    assert document["error"]["before"]["unit"] == "gauss"


@pytest.mark.measured
def test_of_a_ulog(measured_data: Path) -> None:
    """PX4 logs its compass in gauss."""
    log = str(measured_data / "px4_esc_lidar_flight" / "esc_status_log.ulg")
    assert re.search(
        r"mag +-?0\.\d+ ± .* gauss\n", estimate_command.run(log, "auto", None, None, None, None, span=(30.0, 60.0))
    )


@pytest.mark.parametrize(("streams", "unit"), [(("power", "motors"), "gauss/A"), (("motors",), "gauss/full throttle")])
def test_a_throttle_that_stands_for_the_current_is_said_in_the_unit(streams: tuple[str, ...], unit: str) -> None:
    """The regressor is the mean throttle where no current is known, and then its size is not an ampere's."""
    recording, _ = simulate(load_scenario("aerobatics"), np.random.default_rng(1))
    kept = {name: one for name, one in recording.streams.items() if name not in ("power", "motors") or name in streams}
    field_unit = replace(recording.environment, field_unit="gauss")
    field = field_of(recording.replace(streams=kept, environment=field_unit))
    assert field.of(CATALOGUE["mag.current"]) == (1.0, (unit,) * 3)
    assert field.of(CATALOGUE["mag.temperature"]) == (1.0, ("gauss/K",) * 3)
    assert field.of(CATALOGUE["gps.latency"]) == (1.0, ("s",))


def test_words_of_units() -> None:
    assert unit_words("gauss/full throttle") == "gauss per full throttle"
    assert FieldUnit(by_throttle=True).of(CATALOGUE["mag.current"])[1] == ("1/full throttle",) * 3
    assert per_unit(0.098, "1/full throttle", "mag.current") == "0.098 per full throttle"
    assert CATALOGUE["mag.current"].units_in("gauss") == ("gauss/A",) * 3
    assert CATALOGUE["mag.temperature"].units_in("uT") == ("uT/K",) * 3
    assert CATALOGUE["mag.step"].units_in("gauss") == ("gauss",) * 3
    assert CATALOGUE["mag.cross_axis"].units_in("gauss") == ("1",) * 3
    assert per_unit(0.003, "gauss/A", "mag.current") == "0.0030 gauss per ampere"
    assert unit_words("uT/K") == "uT per kelvin"
    assert unit_words("m/K") == "m per kelvin"
