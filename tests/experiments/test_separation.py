"""What looks alike and what tells it apart: the textbook's pairs, the shipped table, the advice made of it."""

from __future__ import annotations

import pytest

from sinan.estimator.evidence.score import squared_correlation
from sinan.experiments.residual_loop.manoeuvre import (
    CLASS_BOUND,
    SEEN_FROM,
    alike,
    apart,
    deciding,
    looks,
    scenes,
    separating_manoeuvre,
)
from sinan.experiments.scenarios import load_scenario, scenario_names
from sinan.experiments.separation import page as separation_page
from sinan.experiments.separation import study as separation
from sinan.experiments.separation.study import Run, evidence_of, pairs_in, runs
from sinan.sensors.effects import effect

ANOTHER_DRAW = 0.05  # of r^2: linear algebra of another machine and what the estimated motion adds
NO_HEIGHT = ("accel", "gyro", "mag", "gps")


def r2(first: str, other: str, scenario: str) -> float:
    """Of a pair in a scenario, from the shipped table."""
    return next(look.r2 for look in looks(first, other) if look.scene.key == scenario)


@pytest.mark.parametrize(
    ("first", "other", "scenario"),
    [
        ("sonar.mount_offset", "laser.mount_offset", "climb_descent"),  # only their difference is seen
        ("accel.scale", "accel.scale_nonlinearity", "figure_eight"),  # needs poses
        ("sonar.mount_offset", "sonar.sound_speed", "hover"),
        ("laser.scale", "sonar.sound_speed", "hover"),
    ],
)
def test_pairs_that_nothing_there_tells_apart(first: str, other: str, scenario: str) -> None:
    assert r2(first, other, scenario) > 0.98


@pytest.mark.parametrize(
    ("first", "other", "scenario", "least", "most"),
    [
        ("sonar.terrain_slope", "laser.terrain_slope", "low_pass", 0.90, 0.99),  # one ground
        ("gps.lever_arm", "accel.lever_arm", "figure_eight", 0.50, 0.70),
        ("mag.cross_axis", "gyro.cross_axis", "climb_descent", 0.80, 0.95),  # one direction of them
        ("laser.scale", "sonar.sound_speed", "aerobatics", 0.60, 0.85),
    ],
)
def test_pairs_that_share_a_part(first: str, other: str, scenario: str, least: float, most: float) -> None:
    assert least < r2(first, other, scenario) < most


def test_lever_arms_need_a_height_sensor() -> None:
    full = load_scenario("figure_eight")
    scenario = full.replace(sensors={name: full.sensors[name] for name in NO_HEIGHT})
    (without,) = evidence_of(Run("no height sensor", scenario, {}))
    (with_it,) = evidence_of(Run("all", full, {}))
    pair = ("gps.lever_arm", "accel.lever_arm")
    assert squared_correlation(without, *pair) > CLASS_BOUND > squared_correlation(with_it, *pair)


def test_the_table_has_every_scenario_as_it_is() -> None:
    made = {run.key: (run.scenario.summary, tuple(run.scenario.sensors)) for run in runs()}
    assert {key: (scene.summary, scene.sensors) for key, scene in scenes().items()} == made
    assert set(scenario_names()) <= set(scenes())


@pytest.mark.parametrize("scenario", ["square", "accel_poses"])
def test_the_table_is_what_its_script_makes(scenario: str) -> None:
    run = next(run for run in runs() if run.key == scenario)
    (evidence,) = evidence_of(run)
    made = pairs_in(evidence, tuple(scenes()[scenario].sees))
    kept = {pair: look.r2 for pair, found in alike().items() for look in found if look.scene.key == scenario}
    assert kept
    assert {pair: made[pair][0] for pair in kept} == pytest.approx(kept, abs=ANOTHER_DRAW)


def test_the_page_is_what_its_script_makes() -> None:
    kept = separation_page.PAGE.read_text(encoding="utf-8")
    assert kept == separation_page.page(), "the table has changed: python -m sinan.experiments.separation.page"


def test_what_decides_sees_both_and_correlates_less() -> None:
    for first, other in alike():
        for look in deciding(first, other):
            assert look.r2 <= CLASS_BOUND
            assert look.sees_both_from <= SEEN_FROM
            assert look.scene.advised


def test_the_order_of_a_pair_does_not_matter() -> None:
    first, other = "gps.lever_arm", "accel.lever_arm"
    there, back = deciding(first, other)[0], deciding(other, first)[0]
    assert (there.scene, there.first_from) == (back.scene, back.second_from)


def test_advice_names_a_flight_and_both_figures() -> None:
    text = separating_manoeuvre("gps.lever_arm", ["accel.lever_arm"])
    assert text.startswith("fly figure_eight (figures of eight")
    assert "0.59 with accel.lever_arm instead of up to 0.98" in text


def test_advice_for_several_names_one_flight_where_there_is_one() -> None:
    text = separating_manoeuvre("mag.current", ["mag.declination", "mag.misalignment"])
    assert text.count("fly ") == 1
    assert "mag.declination" in text
    assert "mag.misalignment" in text


def test_advice_sends_to_the_calibration_that_shows_one_alone() -> None:
    text = separating_manoeuvre("accel.scale", ["accel.scale_nonlinearity"])
    assert text.startswith("record accel_poses (")
    found = apart("gyro.cross_axis", "mag.misalignment")
    assert found is not None
    assert (found[0].key, found[1]) == ("gyro_poses", "gyro.cross_axis")


@pytest.mark.parametrize(
    ("first", "other"), [("baro.lag", "baro.time_offset"), ("mag.step", "mag.temperature"), ("baro.lag", "no.such")]
)
def test_where_no_scenario_decides_the_declaration_speaks(first: str, other: str) -> None:
    assert separating_manoeuvre(first, [other]) == effect(first).separates


def test_pairs_that_are_nowhere_alike_get_a_flight_that_shows_both() -> None:
    assert not looks("mag.current", "mag.temperature")
    assert separating_manoeuvre("mag.current", ["mag.temperature"]).startswith("fly ")


def test_nothing_confused_needs_no_advice() -> None:
    assert separating_manoeuvre("mag.current", []) == ""
    assert separating_manoeuvre("mag.current", ["mag.current"]) == ""


def test_script_writes_what_it_is_asked_for(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(separation, "scenario_names", lambda: ("hover",))
    separation.main([str(tmp_path / "table.json")])
    assert "pairs above 0.8 in 1 runs" in capsys.readouterr().out
    assert '"laser.scale", "sonar.sound_speed"' in (tmp_path / "table.json").read_text(encoding="utf-8")
