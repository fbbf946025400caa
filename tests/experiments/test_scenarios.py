"""Scenario files, effects on the command line, and what `sinan simulate` leaves on disk."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from sinan.experiments.scenarios import (
    interval_note,
    load_scenario,
    parse_effect,
    scenario_names,
    simulate_to_folder,
    size_note,
)
from sinan.sensors.errors import InputError
from sinan.sensors.formats.plain import read_recording


def test_every_scenario_says_what_it_is() -> None:
    assert all(load_scenario(name).summary for name in scenario_names())


def test_flights_last_one_to_two_minutes() -> None:
    flights = [load_scenario(name) for name in scenario_names() if load_scenario(name).kind == "flight"]
    assert all(60.0 <= flight.duration <= 120.0 for flight in flights)


def test_the_field_and_gravity_are_those_of_the_place() -> None:
    scenario = load_scenario("hover")
    assert np.linalg.norm(scenario.magnetic_field) == pytest.approx(1.0)
    assert scenario.gravity == pytest.approx(9.8015, abs=1e-4)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('like = "nowhere"', "another scenario"),
        ('like = "hover"\nwithot = ["gps"]', "without"),
        ('like = "hover"\n[sensors.mag]\nnoise_sdt = 1.0', "noise_std"),
        ('like = "hover"\n[sensors.mag]\nrate = -5.0', "above 0"),
        ('like = "hover"\n[sensors.laser]\nangles = [-20.0, 0.0, 20.0]', "angles: -20; expected angles in rad"),
        ('like = "hover"\n[sensors.laser]\nangles = [0.0, 1.58]', "beyond -1.5708 and below 1.5708 (90 deg)"),
        ('like = "hover"\n[sensors.sonar]\nsoftness = 1.5', "at most 1"),
        ('like = "hover"\n[sensors.gps]\ndropouts = [[5, 3]]', "start, end"),
        ('like = "hover"\n[[manoeuvre]]\nkind = "loop"\nduration = 3.0', "figure_eight"),
        ('like = "hover"\n[[manoeuvre]]\nkind = "hold"', "duration"),
        ('like = "hover"\nwithout = ["accel"]', "gyro without accel"),
        ('like = "hover"\n[origin]\ndate = "yesterday"', "2026-06-01"),
        ("kind = 3", "key"),
        ("= 3", "TOML"),
    ],
)
def test_a_wrong_file_is_named_with_what_would_do(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=r"mine\.toml") as caught:
        load_scenario(file)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_unknown_scenario_is_told_the_names() -> None:
    with pytest.raises(InputError, match="figure_eight"):
        load_scenario("figure_nine")


def test_a_file_of_ones_own_is_laid_over_a_shipped_one(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('like = "square"\nwithout = ["sonar"]\n[sensors.gps]\nnoise_std = 1.5\n[air]\nwind = [2.0, 1.0]\n')
    scenario = load_scenario(file)
    assert "sonar" not in scenario.sensors
    assert scenario.sensors["gps"].spec.noise_std == 1.5
    assert scenario.sensors["gps"].rate == 10.0
    assert scenario.air.wind == (2.0, 1.0)
    assert scenario.duration == load_scenario("square").duration


def test_an_effect_with_an_interval() -> None:
    present = parse_effect("gps.transient=3,0,-1@20:30")
    assert present.effect.name == "gps.transient"
    np.testing.assert_array_equal(present.beta, [3.0, 0.0, -1.0])
    assert (present.t0, present.t1) == (20.0, 30.0)


def test_a_step_has_no_end() -> None:
    assert parse_effect("baro.step=2@15").t1 == np.inf


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("mag.curent=1,0,0", "mag.current"),
        ("mag.current=1", "3: x"),
        ("mag.current=1,zero,0", "numbers"),
        ("mag.current=1,nan,0", "finite"),
        ("mag.current", "NAME=B0"),
        ("mag.current:0.1", "`:` after the name; expected `=`, as in mag.current=0.03,0,0"),
        ("mag.current 0.1", "a blank after the name; expected `=`, as in mag.current"),
        ("mag.step:0.1,0,0", "mag.step=0.1,0,0@20"),
        ("gps.delay=0.1", "expected gps.latency"),
        ("mag.wobble=0.1", "expected mag.outliers, or mag.scale"),
        ("nothing=0.1", "`sinan effects` lists all"),
        ("mag.current=0.1", "1 value; expected 3: x [1/A], y [1/A], z [1/A], such as mag.current=0.03,0,0"),
        ("mag.current=1,0,0@", "nothing after `@`"),
        ("mag.step=1,0,0", "@T0"),
        ("mag.transient=1,0,0@5", "@T0:T1"),
        ("mag.transient=1,0,0@9:5", "T0 < T1"),
    ],
)
def test_a_wrong_effect_is_told_what_would_do(text: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_effect(text)
    assert said in str(caught.value)


def test_an_interval_of_an_effect_that_acts_all_the_time_is_remarked_upon() -> None:
    assert "mag.transient" in interval_note(parse_effect("mag.current=0.1,0,0@20:30"))
    assert not interval_note(parse_effect("mag.current=0.1,0,0"))
    assert not interval_note(parse_effect("mag.transient=0.1,0,0@20:30"))


def test_an_effect_far_beyond_what_is_sold_is_remarked_upon() -> None:
    assert "xy = 30 is 600 times the plausible 0.05" in size_note(parse_effect("mag.cross_axis=30,0,0"))
    assert not size_note(parse_effect("mag.cross_axis=0.3,0,0"))
    assert not size_note(parse_effect("mag.current=3,0,0"), field=1e4)


def test_the_remark_on_the_size_is_told(tmp_path: Path) -> None:
    told: list[str] = []
    simulate_to_folder("mag_poses", tmp_path / "run", ["mag.cross_axis=30,0,0"], tell=told.append)
    assert len(told) == 1


def test_a_sensor_without_a_reading_is_told(tmp_path: Path) -> None:
    (tmp_path / "high.toml").write_text('like = "hover"\nstart = [0.0, 0.0, -9.0, 0.0]\n')
    told: list[str] = []
    simulate_to_folder(tmp_path / "high.toml", tmp_path / "run", tell=told.append)
    assert not (tmp_path / "run" / "sonar.csv").exists()
    assert [note for note in told if note.startswith("sonar: ")]
    told.clear()
    simulate_to_folder("hover", tmp_path / "low", tell=told.append)
    assert not told


def test_only_a_recording_written_before_is_replaced_and_only_on_demand(tmp_path: Path) -> None:
    folder = tmp_path / "flight"
    folder.mkdir()
    simulate_to_folder("hover", folder, seed=4)  # an empty folder will do
    with pytest.raises(InputError, match="--force"):
        simulate_to_folder("hover", folder, seed=5)
    before = (folder / "imu.csv").read_bytes()
    simulate_to_folder("hover", folder, seed=5, force=True)
    assert (folder / "imu.csv").read_bytes() != before
    (folder / "recording.toml").write_text("format = 1\n")
    with pytest.raises(InputError, match="not written by sinan"):
        simulate_to_folder("hover", folder, seed=5, force=True)


def test_the_answer_lies_beside_the_folder_and_nothing_in_it_speaks_of_the_effect(tmp_path: Path) -> None:
    answer = simulate_to_folder("hover", tmp_path / "flight", ["mag.current=0.01,0,0"], seed=4)
    assert answer == tmp_path / "flight.answer.json"
    said = json.loads(answer.read_text())
    assert said["effects"][0]["name"] == "mag.current"
    assert said["effects"][0]["beta"] == [0.01, 0.0, 0.0]
    assert not list((tmp_path / "flight").glob("*answer*"))
    assert "mag.current" not in (tmp_path / "flight" / "recording.toml").read_text()


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    simulate_to_folder("base_receiver", tmp_path / "flight", ["gps.latency=0.1"], declare=True, seed=4)
    recording = read_recording(tmp_path / "flight")
    assert recording.effects == {"gps.latency": (0.1,)}
    assert set(recording.streams) >= {"imu", "mag", "baro", "gps", "base", "power", "motors", "air"}
    truth = read_recording(tmp_path / "flight").truth
    assert truth is not None
    assert "bias_gps_down" in truth.stream


@pytest.mark.parametrize("name", scenario_names())
def test_every_scenario_can_be_written_and_read(name: str, tmp_path: Path) -> None:
    simulate_to_folder(name, tmp_path / "recording", seed=1)
    assert read_recording(tmp_path / "recording").kind == load_scenario(name).kind


def test_an_effect_twice_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="twice"):
        simulate_to_folder("hover", tmp_path / "flight", ["baro.lag=0.1", "baro.lag=0.2"])
