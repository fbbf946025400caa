"""The laboratory: sentences, sensors, manoeuvres, page; and its sigmas against what filter runs achieve."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from sinan.estimator.evidence.consistency import chi_square
from sinan.estimator.evidence.observability import first_state_information
from sinan.experiments.answers.observability import case_of
from sinan.experiments.bias_observability import segments
from sinan.experiments.bias_observability.case import case_of_recording, case_of_scenario
from sinan.experiments.bias_observability.catalogue import along
from sinan.experiments.bias_observability.directions import simple_structure
from sinan.experiments.bias_observability.document import advice, document, summary
from sinan.experiments.bias_observability.study import Study, smallest, study
from sinan.experiments.commands.observability import run
from sinan.experiments.monte_carlo.one_flight import cramer_rao, fly
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.errors import InputError
from sinan.sensors.manoeuvres import Manoeuvre
from sinan.sensors.recording import NO_HEIGHT, Stream
from sinan.sensors.scenario import Scenario
from sinan.sensors.simulate import simulate

RUNS = 30
FALSE_ALARM = 0.001
LINEAR = 0.01  # relative: the cells against the compiled filter linearised at the truth
SAME_MOTION = 0.05  # relative: sigmas along the smoothed motion against those along the true one


def short_flight() -> Scenario:
    """20 s that show every bias that a flight can show, with a base receiver."""
    scenario = load_scenario("base_receiver")
    moves = (Manoeuvre("shake", 20.0, {"north": 3.0, "east": 2.5, "up": 1.0, "yaw": 60.0}),)
    return scenario.replace(manoeuvres=moves, start=(0.0, 0.0, -6.0, 0.0, 1.0))


@cache
def studied(name: str) -> Study:
    return study(case_of_scenario(load_scenario(name)))


def titles(result: Study, sensors: Sequence[str] | None = None) -> set[str]:
    """Titles of the weak directions of the sensors aboard, or of some of them."""
    wanted = result.case.aboard if sensors is None else tuple(sensors)
    return {weakness.direction.title for weakness in result.weaknesses if weakness.sensors == wanted}


def test_a_hover_leaves_what_the_textbook_says() -> None:
    assert titles(studied("hover")) == {
        "accel x bias against pitch",
        "accel y bias against roll",
        "mag y bias against heading",
        "GPS north bias against north position",
        "GPS east bias against east position",
    }


def test_rank_counts_what_is_not_seen() -> None:
    result = studied("hover")
    assert result.rank == len(result.found.labels) - 5


def test_flying_leaves_the_gps_bias_alone() -> None:
    assert titles(studied("aerobatics")) == {
        "GPS north bias against north position",
        "GPS east bias against east position",
    }


def test_with_a_base_receiver_everything_is_seen() -> None:
    assert titles(studied("base_receiver")) == set()


def test_without_gps_the_place_is_lost() -> None:
    result = studied("square")
    lost = titles(result, [name for name in result.case.aboard if name != "gps"])
    assert {"north position by itself", "east position by itself"} <= lost


def test_a_gps_bias_needs_the_base() -> None:
    state = next(state for state in studied("aerobatics").states if state.label == "b_gps_north")
    assert state.needs == (("gps", "base"),)


def test_a_gps_height_bias_needs_another_height() -> None:
    state = next(state for state in studied("aerobatics").states if state.label == "b_gps_down")
    assert set(state.needs) == {("gps", "base"), ("gps", "laser"), ("gps", "sonar")}


def test_the_base_receiver_brings_the_gps_bias_down() -> None:
    sigma = document(studied("aerobatics"))["base_receiver"]["sigma"]["b_gps_north"]
    assert sigma["with"] < 0.25 * sigma["without"]


def test_a_hover_is_told_to_fly() -> None:
    lines = advice(studied("hover"))
    assert any(line.startswith("accel x bias against pitch: fly ") for line in lines)
    assert any("fly as in the scenario `" in line for line in lines)
    assert any(line.startswith("GPS north bias against north position: needs base receiver") for line in lines)


def test_summary_names_the_unit_of_the_field_and_what_a_hold_is() -> None:
    text = summary(studied("hover"))
    assert re.search(r"mag x bias +0\.05 → \S+ field,", text)
    assert "flown: 1 hold (the number is the manoeuvre's place in the flight; a hold stands still in the air)" in text


def test_every_flight_of_the_catalogue_shows_more_than_a_hover() -> None:
    catalogue = studied("hover").catalogue
    assert catalogue is not None
    column = catalogue.left[:, catalogue.labels.index("b_accel_x")]
    assert int(np.argmax(column)) == catalogue.names.index("hover")


def test_the_first_turn_brings_the_heading() -> None:
    state = next(state for state in studied("yaw_turns").states if state.label == "b_mag_y")
    assert state.brought_by is not None
    assert "turn" in state.brought_by


def test_gains_add_up_to_the_whole_flight() -> None:
    for state in studied("takeoff_landing").states:
        assert sum(state.bits.values()) == pytest.approx(np.log2(state.prior / state.posterior), abs=1e-6)


def test_simple_structure_undoes_a_rotation() -> None:
    rng = np.random.default_rng(1)
    simple = np.zeros((12, 3))
    simple[[0, 1, 4, 5, 8, 9], [0, 0, 1, 1, 2, 2]] = np.sqrt(0.5) * np.array([1, -1, 1, 1, -1, 1])
    Q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    turned = simple_structure(simple @ Q)
    assert np.sort(np.abs(simple.T @ turned).max(axis=1)) == pytest.approx(np.ones(3), abs=1e-6)


def test_smallest_sets_have_no_other_inside() -> None:
    assert smallest({("a", "b"), ("b",), ("a", "c"), ("a", "b", "c")}) == (("b",), ("a", "c"))


def test_motion_is_named_by_what_it_does() -> None:
    scenario = load_scenario("yaw_turns")
    motion = scenario.trajectory().motion(np.linspace(0.0, scenario.duration, 4000))
    names = [segment.name for segment in segments.of_motion(motion)]
    assert names[0] == "rest"
    assert "yaw turn" in names


def test_sigmas_are_those_of_the_filter_linearised_at_the_truth() -> None:
    """Against the compiled engine's own covariance recursion, which shares no code with the cells."""
    scenario = short_flight()
    sigma = study(case_of_scenario(scenario), with_catalogue=False).course.sigma[0, -1]
    np.testing.assert_allclose(sigma, cramer_rao(scenario, 0)[-1], rtol=LINEAR)


def test_monte_carlo_runs_of_the_filter_achieve_these_sigmas() -> None:
    """Errors at the end of independent runs: each state's mean square over sigma^2, and the joint one, chi-square."""
    scenario = short_flight()
    result = study(case_of_scenario(scenario), with_catalogue=False)
    error = np.array([fly(scenario, 11, number).error[-1] for number in range(RUNS)])
    n = error.shape[1]
    level = 1.0 - FALSE_ALARM / (n + 1)
    joint = float(np.einsum("ri,ij,rj->", error, np.linalg.inv(result.course.P_end[0]), error))
    squares = np.sum((error / result.course.sigma[0, -1]) ** 2, axis=0)
    assert chi_square(joint, RUNS * n, level).consistent
    wrong = [
        result.found.labels[i]
        for i, total in enumerate(squares)
        if not chi_square(float(total), RUNS, level).consistent
    ]
    assert wrong == []


def test_a_recording_gives_what_its_scenario_gives() -> None:
    scenario = short_flight()
    recording, _ = simulate(scenario, np.random.default_rng(4))
    along_truth = study(case_of_scenario(scenario), with_catalogue=False)
    along_estimate = study(case_of_recording(recording), with_catalogue=False)
    ratio = along_estimate.course.sigma[0, -1] / along_truth.course.sigma[0, -1]
    np.testing.assert_allclose(ratio, 1.0, atol=SAME_MOTION)


def test_fixes_in_two_dimensions_show_no_height() -> None:
    """In the flight, and in others that its receiver would fly."""
    recording, _ = simulate(short_flight(), np.random.default_rng(4))
    gps = recording.streams["gps"]
    fixes = Stream(gps.t, {**gps.columns, "down": np.full(len(gps), 50.0), "epv": np.full(len(gps), NO_HEIGHT)})
    for stream in (gps, fixes):
        case = case_of_recording(recording.replace(streams={**recording.streams, "gps": stream}))
        for found in (case.information(), along(case, load_scenario("hover"), 10.0, 0.4)):
            down = found.index("position_down")
            known = first_state_information(found, [("gps",)])[0][down, down]
            assert (known > 1e-3) == (stream is gps)


def test_noise_that_lasts_is_no_state_of_the_study() -> None:
    """A log that declares no noise has colour among its states, and a field that is known to some degrees."""
    recording, _ = simulate(short_flight(), np.random.default_rng(4))
    mag = replace(recording.spec("mag"), colour_std=0.01, colour_time=3.0)
    coloured = case_of_recording(recording.replace(sensors={**recording.sensors, "mag": mag}))
    assert coloured.model.layout.has("c_mag")
    found = study(coloured, with_catalogue=False)
    assert not any(label.startswith("c_") for label in found.found.labels)
    assert any("mag" in note and "least" in note for note in coloured.notes)
    assert "mag" in summary(found)


def test_an_attitude_estimator_is_studied_too(tmp_path: Path) -> None:
    text = run("no_aiding", None, tmp_path / "o.json", tmp_path / "o.html")
    found = json.loads((tmp_path / "o.json").read_text())
    assert "level assumption" in text
    assert "position_north" not in found["states"]
    assert found["catalogue"] is None


def test_the_command_writes_text_json_and_page(tmp_path: Path) -> None:
    text = run("hover", None, tmp_path / "o.json", tmp_path / "o.html")
    found, page = json.loads((tmp_path / "o.json").read_text()), (tmp_path / "o.html").read_text()
    assert "accel x bias against pitch" in text
    assert found["format"] == 1
    assert found["rank"] == 17
    assert set(found["biases"]["b_accel_x"]) >= {"prior", "posterior", "posterior_over_prior", "halved_after", "bits"}
    assert page.count("<img") == 6  # one manoeuvre: no figure of what each brought


@pytest.mark.parametrize(("text", "word"), [("hoover", "no such scenario"), ("accel_poses", 'kind = "poses"')])
def test_what_cannot_be_studied_is_said(text: str, word: str) -> None:
    with pytest.raises(InputError, match=word):
        case_of(text)


def test_a_height_bias_is_told_to_look_at_the_ground() -> None:
    """Barometer alone: its bias is a height, and only a second height sensor tells them apart."""
    lines = advice(studied("no_aiding_flight"))
    assert any(line.startswith("baro bias against down position: needs laser") for line in lines)


def test_a_recording_without_imu_is_refused() -> None:
    recording, _ = simulate(short_flight(), np.random.default_rng(4))
    streams = {name: stream for name, stream in recording.streams.items() if name != "imu"}
    with pytest.raises(InputError, match="no stream imu"):
        case_of_recording(recording.replace(streams=streams))
