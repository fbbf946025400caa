"""Pages and sentences: what a reader is told agrees with what was found, in units and words that can be read."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.calibrate import calibrate_triad
from experiments.calibrate import warnings_of as calibration_warnings
from experiments.demo import HIDDEN, hidden_and_found
from experiments.estimate_command import warnings_of as innovation_warnings
from experiments.monte_carlo_command import remark
from experiments.report.console import progress, working
from experiments.report.trace_page import evidence, trace_page
from experiments.report.trace_words import (
    effect_line,
    interval_words,
    lead,
    remaining_sentence,
    title,
    trace_summary,
)
from experiments.report.words import change, per_unit, with_sigma
from experiments.residual_loop.open_source import pose_source, triad_readings
from experiments.residual_loop.report import report
from experiments.residual_loop.source import Source
from experiments.residual_loop.trace import Trace, trace
from experiments.scenarios import parse_effect
from experiments.scenarios.loader import load_scenario
from sensors.simulate import simulate

Traced = tuple[Source, Trace, dict[str, Any]]


def traced(*effects: str, seed: int = 7) -> Traced:
    present = [parse_effect(text) for text in effects]
    recording, _ = simulate(load_scenario("mag_poses"), np.random.default_rng(seed), present)
    source = pose_source(recording, "mag")
    result = trace(source)
    return source, result, report(source, result)


@pytest.fixture(scope="module")
def two_effects() -> Traced:
    return traced("mag.cross_axis=0.04,-0.015,0.02", "mag.current=0.0015,0,-0.001")


@pytest.fixture(scope="module")
def disturbed() -> Traced:
    return traced("mag.transient=0.2,0,0.1@40:60")


@pytest.fixture(scope="module")
def nothing() -> Traced:
    return traced(seed=5)


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [
        (0.0398123, 0.000294, "0.03981 ± 0.00029"),
        (5.882, 0.094, "5.882 ± 0.094"),
        (1234.5, 230.0, "1230 ± 230"),
        (1.3e-9, 6.1e-9, "(0.2 ± 1.0)e-9"),
        (0.5, None, "0.5 (± not determined)"),
    ],
)
def test_values_have_the_digits_of_their_sigma(value: float, sigma: float | None, text: str) -> None:
    if "e-9" in text:
        assert with_sigma(value, sigma).endswith("e-9")
    else:
        assert with_sigma(value, sigma) == text


def test_sizes_are_in_the_units_of_people() -> None:
    assert per_unit(0.003, "1/A", "mag.current") == "0.0030 per ampere"
    assert per_unit(0.0927, "1", "mag.cross_axis") == "9.3 %"
    assert per_unit(0.1, "1", "mag.step") == "0.10"
    assert per_unit(np.deg2rad(2.0), "rad") == "2.0 deg"
    assert change(0.06, 0.0157) == "0.060 → 0.016"


def test_what_was_found_passes_the_line_of_the_chart_and_nothing_else_does(two_effects: Traced) -> None:
    _, result, document = two_effects
    needed = np.log10(document["p_value_needed"])
    bars = evidence(result)
    assert [bar.label for bar in bars if bar.kind == "found"] == ["mag.cross_axis (step 1)", "mag.current (step 2)"]
    assert all((bar.log10_p < needed) == (bar.kind == "found") for bar in bars)


def test_page_shows_every_effect_with_its_parameters(two_effects: Traced, tmp_path: Path) -> None:
    source, result, document = two_effects
    trace_page(tmp_path / "page.html", source, result, document, HIDDEN)
    page = (tmp_path / "page.html").read_text()
    assert page.count("<img") == 5  # two effects, residuals, errors, candidates
    assert "hidden in the data" in page
    assert re.search(r"<td>xy</td><td[^>]*>0\.0\d+ ± 0\.0\d+</td><td>ratio</td>", page)
    assert "<td>1/A</td>" in page


def test_title_says_what_how_much_and_what_it_brings(two_effects: Traced) -> None:
    text = title(two_effects[2])
    assert text.startswith("Soft iron near the magnetometer bends the field (up to 4.0 %), and the magnetometer reads")
    assert "on the held-out fifth" in text
    assert trace_summary(two_effects[2]).splitlines()[0] == "mag_poses: effects"


def test_localised_effect_is_drawn_where_it_acts(disturbed: Traced, tmp_path: Path) -> None:
    source, result, document = disturbed
    assert [e["name"] for e in document["effects"]] == ["mag.transient"]
    assert re.fullmatch(r"from \d\d(\.\d+)? s to \d\d(\.\d+)? s", interval_words(document["effects"][0]))
    trace_page(tmp_path / "page.html", source, result, document)
    assert "The residual around the interval" in (tmp_path / "page.html").read_text()


def test_interval_of_a_log_without_time_stamps_is_in_readings() -> None:
    effect = {"name": "mag.transient", "interval": [0.0, 4.0], "interval_unit": "reading"}
    assert interval_words(effect) == "in readings 0 to 3"


def test_page_of_nothing_shows_how_far_the_strongest_candidate_is_from_the_line(
    nothing: Traced, tmp_path: Path
) -> None:
    source, result, document = nothing
    assert document["verdict"] == "no_effect"
    trace_page(tmp_path / "page.html", source, result, document)
    page = (tmp_path / "page.html").read_text()
    assert page.count("<img") == 2
    assert "would be needed" in page
    assert "From these sizes on" in page


def test_demonstration_sets_what_was_hidden_beside_what_was_found(two_effects: Traced) -> None:
    lines = hidden_and_found(HIDDEN, two_effects[2]).splitlines()
    assert len(lines) == 1 + sum(map(len, HIDDEN.values()))
    assert re.match(r"\s+mag\.current x\s+0\.0015\s+0\.001\d+ ± 0\.0000\d+\s+1/A", lines[4])
    assert "not found" in hidden_and_found({"mag.temperature": (1.0, 0.0, 0.0)}, two_effects[2])


def test_line_of_an_effect_names_its_parameters(two_effects: Traced) -> None:
    assert re.match(r"mag\.current: x 0\.0015\d* ± .*, y .*, z .* 1/A; p", effect_line(two_effects[2]["effects"][1]))


def test_calibration_remarks_upon_a_residual_above_the_declared_noise() -> None:
    for effects, remarks in ((("mag.cross_axis=0.03,0,-0.02",), 1), ((), 0)):
        recording, _ = simulate(
            load_scenario("mag_poses"), np.random.default_rng(7), [parse_effect(e) for e in effects]
        )
        readings = triad_readings(recording, "mag")
        warnings = calibration_warnings(calibrate_triad(recording, readings, "none"), readings, "run1")
        assert len(warnings) == remarks
        assert all("`sinan trace run1`" in warning for warning in warnings)


@pytest.mark.parametrize(("nis", "remarks"), [(1.8, 1), (1.1, 0), (0.5, 1), (None, 0)])
def test_estimate_remarks_upon_innovations_of_another_size(nis: float | None, remarks: int) -> None:
    warnings = innovation_warnings({"nis": {"mag": nis}, "nis_interval": {"mag": [0.97, 1.03]}}, "run1")
    assert len(warnings) == remarks
    if nis is not None and nis > 1.5:
        assert "`sinan trace run1`" in warnings[0]


def test_a_refused_stream_comes_first_and_as_another_unit() -> None:
    shares = {"baro": 0.99, "gps": 0.1, "level": 1.0}
    document = {"nis": {"gps": 3.0, "baro": 1e10}, "nis_interval": {"gps": [0.9, 1.1], "baro": [0.9, 1.1]}}
    warnings = innovation_warnings({**document, "doubted": shares}, "run1")
    assert warnings[0].startswith("the filter believes 1 % of the barometer readings: their unit, axis or frame")
    assert len(warnings) == 2
    assert "GPS" in warnings[1]


def test_a_large_excess_is_said_as_a_factor() -> None:
    item = {"stream": "baro", "kind": "variance", "follows": "time", "p_value": 0.0}
    assert "is 9.3e5 times what was expected" in remaining_sentence({**item, "excess": 933562.47})
    assert "is 15 times what" in remaining_sentence({**item, "excess": 14.2})
    assert "60 % larger" in remaining_sentence({**item, "excess": 0.6})


@pytest.mark.parametrize(
    ("mean", "said"), [(1.0, ""), (1.15, "one in twenty"), (1.5, "not by chance"), (0.5, "not by chance")]
)
def test_an_average_outside_its_interval_is_weighed_against_chance(mean: float, said: str) -> None:
    text = remark({"mean_per_dof": mean, "interval": [0.9, 1.1], "family_interval": [0.8, 1.2]})
    assert said in text
    assert bool(text) == bool(said)


def test_progress_is_for_a_terminal_only(capsys: pytest.CaptureFixture[str]) -> None:
    with working("tracing"), progress("flying") as step:
        step("", 1, 2)
    captured = capsys.readouterr()
    assert captured.out + captured.err == ""


def a_document(**changes: Any) -> dict[str, Any]:
    effect = {
        "name": "sonar.mount_offset", "summary": "The sonar counts its range from another point.", "beta": [0.2],
        "std": [0.01], "unit": ["m"], "parameters": ["b"], "confused_with": [], "interval": None,
        "log10_p_value": -20.0,
    }  # fmt: skip
    error = {
        "stream": "sonar", "held_out_part": "last third", "same_names_on_fitting_part": True,
        "before": {"rms": 0.2, "unit": "m"}, "after": {"rms": 0.05, "unit": "m", "interval": [0.04, 0.06]},
    }  # fmt: skip
    document = {"recording": "x", "verdict": "effects", "effects": [effect], "error": error, "remaining": []}
    return {**document, **changes}


def test_title_of_one_effect() -> None:
    text = title(a_document())
    assert text == "The sonar counts its range from another point: 0.20 m; residual 0.200 → 0.050 m on the last third"


def test_title_prefers_the_error_of_the_states_where_it_is_known_and_telling() -> None:
    document = a_document()
    document["error"]["truth_held_out"] = {"before": {"height_rms": 0.4}, "after": {"height_rms": 0.1}}
    assert title(document).endswith("height error 0.40 → 0.10 m on the last third")
    document["error"]["truth_held_out"]["after"]["height_rms"] = 0.39
    assert title(document).endswith("residual 0.200 → 0.050 m on the last third")


def test_title_of_what_cannot_be_told_apart_names_every_candidate() -> None:
    document = a_document(verdict="ambiguous", separates="several heights")
    document["effects"][0]["confused_with"] = ["laser.mount_offset"]
    assert "or the laser counts its range from another point: these data cannot tell" in title(document)
    assert "several heights" in lead(document)


def test_lead_warns_where_a_part_of_the_data_chooses_other_names() -> None:
    document = a_document()
    assert "with care" not in lead(document)
    document["error"]["same_names_on_fitting_part"] = False
    assert "with care" in lead(document)


@pytest.mark.parametrize(
    ("kind", "follows", "said"),
    [
        ("variance", "time", "variance of the barometer residual is 50 % larger"),
        ("colour", "time", "correlated (0.5"),
        ("local", "time", "offset of 0.5 sigma in a stretch"),
        ("local", "supply_current", "follows the supply current in a way that no effect"),
    ],
)
def test_what_remains_is_said_in_words(kind: str, follows: str, said: str) -> None:
    assert said in remaining_sentence({"stream": "baro", "kind": kind, "excess": 0.5, "follows": follows})
