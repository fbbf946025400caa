"""Pages and sentences: what a reader is told agrees with what was found, in units and words that can be read."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sinan.estimator.evidence.source import StreamResidual
from sinan.estimator.evidence.term import Term
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.inputs import prepare
from sinan.experiments.calibrate import as_json, calibrate_triad
from sinan.experiments.commands.calibrate import run as calibrate
from sinan.experiments.commands.demo import HIDDEN, hidden_and_found
from sinan.experiments.estimate import BiasCourse, report_of
from sinan.experiments.labs.magnetometer import sign_errors
from sinan.experiments.report.calibration_words import summary as calibration_summary
from sinan.experiments.report.calibration_words import warnings_of as calibration_warnings
from sinan.experiments.report.console import progress, working
from sinan.experiments.report.estimate_page import estimate_page
from sinan.experiments.report.estimate_words import innovations, size_of_innovations
from sinan.experiments.report.estimate_words import summary as estimate_summary
from sinan.experiments.report.estimate_words import warnings_of as innovation_warnings
from sinan.experiments.report.figures import biases_over_time
from sinan.experiments.report.monte_carlo_words import remark
from sinan.experiments.report.page import Page
from sinan.experiments.report.trace_page import _local_caption, evidence, trace_figures, trace_page
from sinan.experiments.report.trace_words import (
    REFUSED,
    effect_line,
    interval_words,
    known_together,
    remaining_sentence,
    size_and_sigma,
    size_words,
)
from sinan.experiments.report.verdict_words import Log, lead, title, trace_summary, what_next, worded
from sinan.experiments.report.words import (
    bias_rows,
    change,
    counted,
    off_by,
    p_value_words,
    per_unit,
    stream_unit,
    trace_call,
    with_sigma,
)
from sinan.experiments.residual_loop.open_source import pose_source, triad_readings
from sinan.experiments.residual_loop.report import report
from sinan.experiments.residual_loop.trace import trace
from sinan.experiments.residual_loop.traced import Traced
from sinan.experiments.residual_loop.trials import (
    GIVEN_ERROR,
    IMPOSSIBLE,
    NO_EVIDENCE,
    ROLLED_BACK,
    SCATTERED,
    UNLIKELY,
    UNTRIED,
    Finding,
)
from sinan.experiments.scenarios import parse_effect
from sinan.experiments.scenarios.loader import load_scenario
from sinan.sensors.covariates import covariates_for
from sinan.sensors.effects import CATALOGUE
from sinan.sensors.formats.plain import write_recording
from sinan.sensors.recording import MAG, Stream
from sinan.sensors.simulate import simulate
from tests.estimator.analytic_flight import fly

Report = tuple[Traced, dict[str, Any]]
#: A time since 1970 [s].
EPOCH = 1_629_000_000.0


def traced(*effects: str, seed: int = 7) -> Report:
    present = [parse_effect(text) for text in effects]
    recording, _ = simulate(load_scenario("mag_poses"), np.random.default_rng(seed), present)
    source = pose_source(recording, "mag")
    return worded_report(Traced.alone(source, trace(source)))


def worded_report(result: Report) -> Report:
    return result, worded(report(result))


@pytest.fixture(scope="module")
def two_effects() -> Report:
    return traced("mag.cross_axis=0.04,-0.015,0.02", "mag.current=0.0015,0,-0.001")


@pytest.fixture(scope="module")
def disturbed() -> Report:
    return traced("mag.transient=0.2,0,0.1@40:60")


@pytest.fixture(scope="module")
def nothing() -> Report:
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


def test_what_was_found_passes_the_line_of_the_chart_and_nothing_else_does(two_effects: Report) -> None:
    result, document = two_effects
    needed = np.log10(document["p_value_needed"])
    bars = evidence(result)
    assert [bar.label for bar in bars if bar.kind == "found"] == ["mag.cross_axis (step 1)", "mag.current (step 2)"]
    assert all((bar.log10_p < needed) == (bar.kind == "found") for bar in bars)


def test_page_shows_every_effect_with_its_parameters(two_effects: Report, tmp_path: Path) -> None:
    result, document = two_effects
    trace_page(tmp_path / "page.html", result, document, HIDDEN)
    page = (tmp_path / "page.html").read_text()
    assert page.count("<img") == 5  # two effects, residuals, errors, candidates
    assert "hidden in the data" in page
    assert re.search(r"<td>xy</td><td[^>]*>0\.0\d+ ± 0\.0\d+</td><td>ratio</td>", page)
    assert "<td>1/A</td>" in page


def test_title_says_what_how_much_and_what_it_brings(two_effects: Report) -> None:
    text = title(two_effects[1])
    assert text.startswith("Soft iron near the magnetometer bends the field (up to 4.0 %), and the magnetometer reads")
    assert "on the held-out fifth" in text
    assert trace_summary(two_effects[1]).splitlines()[0] == "mag_poses: effects"


def test_localised_effect_is_drawn_where_it_acts(disturbed: Report, tmp_path: Path) -> None:
    result, document = disturbed
    assert [e["name"] for e in document["effects"]] == ["mag.transient"]
    assert re.fullmatch(r"from \d\d(\.\d+)? s to \d\d(\.\d+)? s", interval_words(document["effects"][0]))
    trace_page(tmp_path / "page.html", result, document)
    assert "The residual around the interval" in (tmp_path / "page.html").read_text()


def test_times_are_told_as_from_and_to_take_them(tmp_path: Path) -> None:
    """Of a log whose clock shows the time since 1970; the JSON has that clock."""
    present = [parse_effect("mag.transient=0.2,0,0.1@40:60")]
    recording, _ = simulate(load_scenario("mag_poses"), np.random.default_rng(7), present)
    later = recording.replace(
        streams={name: Stream(one.t + EPOCH, one.columns) for name, one in recording.streams.items()}
    )
    source = pose_source(later, "mag")
    result, document = worded_report(Traced.alone(source, trace(source)))
    (effect,) = document["effects"]
    start, end = effect["interval"]
    assert 35.0 < start - EPOCH < end - EPOCH < 65.0
    assert effect["interval_after_first"] == [start - EPOCH, end - EPOCH]
    assert interval_words(effect) in document["headline"]
    assert interval_words(effect) == f"from {start - EPOCH:.4g} s to {end - EPOCH:.4g} s"
    (residual,) = source.residuals(result.parts[0].trace.final)
    assert residual.when(start, end) == interval_words(effect)
    assert residual.rows(residual.held_out).zero == residual.zero
    for figure, _ in (drawn for name, drawn in trace_figures(result, document).items() if name != "candidates"):
        assert not any(axes.get_xlim()[1] > 1000.0 for axes in figure.axes)


@pytest.mark.parametrize(
    ("size", "summary"), [(0.134, "The GPS reports late."), (-0.056, "The GPS's time stamps are early.")]
)
def test_a_negative_lateness_is_early(size: float, summary: str) -> None:
    entry = CATALOGUE["gps.latency"]
    told = entry.opposite if entry.is_opposite([size]) else entry.summary
    assert told == summary
    effect = {"name": "gps.latency", "beta": [size], "unit": ["s"], "interval": None}
    assert size_words(effect) == per_unit(abs(size), "s")  # the sentence has the sign


def test_interval_of_a_log_without_time_stamps_is_in_readings() -> None:
    effect = {"name": "mag.transient", "interval": [0.0, 4.0], "interval_unit": "reading"}
    assert interval_words(effect) == "in readings 0 to 3"


def chosen_and_dropped(nothing: Report, why: str) -> Report:
    """The same trace, had its strongest candidate passed with p = 10^-11 and then been dropped or refused."""
    (part,) = nothing[0].parts
    selection = part.trace.selection
    option = min(selection.last_options, key=lambda o: o.log_p)
    rest = tuple(o for o in selection.last_options if o is not option)
    log_p = -11.0 * np.log(10.0)
    if why in (GIVEN_ERROR, ROLLED_BACK):
        dropped = Finding(option.term, option.beta, option.beta, log_p, log_p, 0.0, 0.0, 0.0, ())
        selection = replace(selection, last_options=rest, dropped=((dropped, why),))
    else:
        passing = replace(option, log_p=log_p)
        selection = replace(selection, last_options=(*rest, passing), refused={option.term.key: why})
    return worded_report(Traced.alone(part.source, replace(part.trace, selection=selection)))


@pytest.mark.parametrize("why", [NO_EVIDENCE, SCATTERED, UNLIKELY, IMPOSSIBLE, UNTRIED, GIVEN_ERROR, ROLLED_BACK])
def test_a_candidate_that_passes_and_is_not_accepted_has_its_reason(nothing: Report, tmp_path: Path, why: str) -> None:
    result, document = chosen_and_dropped(nothing, why)
    mark, reason = REFUSED[why]
    name = min(document["candidates"], key=lambda c: c["judged_log10_p_value"] or 0.0)["name"]
    assert f"{name}, has p = 10^-11, where p <" in lead(document)
    assert f"but it was not accepted: {reason}" in lead(document)
    assert next((bar.label, bar.kind) for bar in evidence(result)) == (f"{name} ({mark})", "left")
    trace_page(tmp_path / "page.html", result, document)
    page = (tmp_path / "page.html").read_text()
    assert f"not accepted: {reason}" in page
    assert "none reaches the dashed line" not in page


def test_an_effect_that_does_not_stand_out_beside_an_error_without_a_name_is_said_to_be_there() -> None:
    """Soft iron of 0.2 % beside a reading that goes with the square of the current: 2 % at one sigma of it."""
    recording, _ = simulate(
        load_scenario("mag_poses"), np.random.default_rng(1), [parse_effect("mag.cross_axis=0.002,0.001,0")]
    )
    stream = recording.streams["mag"]
    current = covariates_for(recording, "mag", stream.t)["current"]
    z = (current - current.mean()) / current.std()
    columns = {name: np.asarray(stream[name]) for name in stream.columns}
    columns["mag_x"] = columns["mag_x"] + 0.02 * z**2 + 0.004 * np.sin(3.0 * z)
    source = pose_source(recording.replace(streams={**recording.streams, "mag": Stream(stream.t, columns)}), "mag")
    result, document = worded_report(Traced.alone(source, trace(source)))
    assert document["verdict"] == "unexplained"
    assert [(f.term.name, why) for f, why in result.parts[0].trace.selection.dropped] == [
        ("mag.cross_axis", GIVEN_ERROR)
    ]
    assert "it does not stand out from the error" in lead(document)
    assert "mag.cross_axis (other error)" in [bar.label for bar in evidence(result)]
    assert "mag.cross_axis: from" not in trace_summary(document)


def test_the_strongest_is_named_with_the_p_value_by_which_it_was_judged() -> None:
    """Beside what no effect explains it has less evidence than about the plain model."""
    one = {"name": "mag.current", "dof": 3, "p_value": 1e-11, "detectable_from": [], "refused": ""}
    other = {**one, "name": "mag.scale", "p_value": 0.2}
    candidates = [{**one, "judged_log10_p_value": -0.1}, {**other, "judged_log10_p_value": -0.7}]
    document = a_document(effects=[], candidates=candidates, p_value_needed=3e-4, verdict="unexplained")
    assert "The strongest of 2 candidates, mag.scale, has p = 0.2; p < 0.0003 would be needed" in lead(document)


def test_page_of_nothing_shows_how_far_the_strongest_candidate_is_from_the_line(
    nothing: Report, tmp_path: Path
) -> None:
    result, document = nothing
    assert document["verdict"] == "no_effect"
    trace_page(tmp_path / "page.html", result, document)
    page = (tmp_path / "page.html").read_text()
    assert page.count("<img") == 2
    assert "would be needed" in page
    assert "What would have been seen" in page


def test_demonstration_sets_what_was_hidden_beside_what_was_found(two_effects: Report) -> None:
    lines = hidden_and_found(HIDDEN, two_effects[1]).splitlines()
    assert len(lines) == 1 + sum(map(len, HIDDEN.values()))
    assert re.match(r"\s+mag\.current x\s+0\.0015\s+0\.001\d+ ± 0\.0000\d+\s+1/A", lines[4])
    assert "not found" in hidden_and_found({"mag.temperature": (1.0, 0.0, 0.0)}, two_effects[1])


def test_line_of_an_effect_names_its_parameters(two_effects: Report) -> None:
    assert re.match(r"mag\.current: x 0\.0015\d* ± .*, y .*, z .* 1/A; p", effect_line(two_effects[1]["effects"][1]))


def test_calibration_remarks_upon_a_residual_above_the_declared_noise() -> None:
    for effects, remarks in ((("mag.cross_axis=0.03,0,-0.02",), 1), ((), 0)):
        recording, _ = simulate(
            load_scenario("mag_poses"), np.random.default_rng(7), [parse_effect(e) for e in effects]
        )
        readings = triad_readings(recording, "mag")
        warnings = calibration_warnings(calibrate_triad(recording, readings, "none"), readings, "sinan trace run1")
        assert len(warnings) == remarks
        assert all("`sinan trace run1`" in warning for warning in warnings)


def test_calibration_says_how_large_a_residual_is_that_nothing_judges(tmp_path: Path) -> None:
    recording, _ = simulate(load_scenario("mag_poses"), np.random.default_rng(7))
    write_recording(recording.replace(sensors={}), tmp_path / "my run")
    text = calibrate("mag", str(tmp_path / "my run"), None, None, None, None, None)
    assert "no noise is declared to judge it by: `sinan trace '" in text
    assert "my run'` tests it" in text


def test_a_command_is_shown_as_it_is_typed() -> None:
    assert trace_call("my log.csv", Path("log.toml"), "mag") == "sinan trace 'my log.csv' --map log.toml --sensor mag"


@pytest.mark.parametrize(("nis", "remarks"), [(1.8, 1), (1.1, 0), (0.5, 1), (None, 0)])
def test_estimate_remarks_upon_innovations_of_another_size(nis: float | None, remarks: int) -> None:
    warnings = innovation_warnings({"nis": {"mag": nis}, "nis_interval": {"mag": [0.97, 1.03]}}, "sinan trace run1")
    assert len(warnings) == remarks
    if nis is not None and nis > 1.5:
        assert "`sinan trace run1`" in warnings[0]


@pytest.mark.parametrize("nis", [1.8, 0.5])
def test_a_noise_is_smaller_than_declared_only_where_it_is(nis: float) -> None:
    document = {"nis": {"mag": nis}, "nis_interval": {"mag": [0.97, 1.03]}}
    assert "than declared" in innovation_warnings(document)[0]
    undeclared = innovation_warnings(document, undeclared=["mag"])
    assert len(undeclared) == (nis > 1.0)  # of what nobody declared there may be less
    assert all("than the model expects" in warning and "declared" not in warning for warning in undeclared)


@pytest.mark.parametrize(("nis", "said"), [({"mag": 0.5}, False), ({"mag": 1.8}, True), ({"mag": 1.0}, True)])
def test_the_page_sends_nobody_to_a_trace_for_too_little_noise(
    nis: dict[str, float], said: bool, tmp_path: Path
) -> None:
    document = an_estimate(nis=nis, nis_interval={"mag": [0.9, 1.1]})
    estimate_page(tmp_path / "page.html", "run", document, [])
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert ("sinan trace" in page) == said


def test_a_refused_stream_comes_first_and_as_another_unit() -> None:
    shares = {"baro": 0.99, "gps": 0.1, "level": 1.0}
    document = {"nis": {"gps": 3.0, "baro": 1e10}, "nis_interval": {"gps": [0.9, 1.1], "baro": [0.9, 1.1]}}
    warnings = innovation_warnings({**document, "doubted": shares}, "sinan trace run1")
    assert warnings[0].startswith("the filter believes 1 % of the barometer readings: their unit, axis or frame")
    assert "or the first attitude is wrong" in warnings[0]
    assert len(warnings) == 2
    assert "GPS" in warnings[1]


def test_a_large_excess_is_said_as_a_factor() -> None:
    item = {"stream": "baro", "kind": "variance", "follows": "time", "p_value": 0.0}
    assert "is 9.3e5 times what was expected" in remaining_sentence({**item, "excess": 933562.47})
    assert "is 15 times what" in remaining_sentence({**item, "excess": 14.2})
    assert "60 % larger" in remaining_sentence({**item, "excess": 0.6})


def an_estimate(**changes: Any) -> dict[str, Any]:
    document = {
        "duration": 83.0, "bias": {"gyro": [0.01, 0.02, 0.0], "baro": [0.5]},
        "bias_std": {"gyro": [0.001, 0.001, 0.001], "baro": [0.1]},
        "nis": {"mag": 1.8, "baro": 0.99, "laser": 1.10, "sonar": 0.8},
        "nis_interval": {"mag": [0.97, 1.03], "baro": [0.9, 1.1], "laser": [0.91, 1.09], "sonar": [0.9, 1.1]},
        "rejected": {}, "noise": [], "warnings": [], "undeclared": [],
    }  # fmt: skip
    return {**document, **changes}


def test_the_lead_counts_innovations_as_the_table_marks_them() -> None:
    document = an_estimate()
    assert [innovations(document, s) for s in document["nis"]] == ["larger", "as expected", "larger", "smaller"]
    said = "Of 4 sensors, the innovations are larger than the filter expects in 2 (magnetometer, laser) and "
    assert size_of_innovations(document) == f"{said}smaller than the filter expects in 1 (sonar)."


def test_nobody_is_warned_of_what_the_filter_assumes() -> None:
    document = an_estimate(
        nis={"level": 0.001, "mag": 1.0}, nis_interval={"level": [0.9, 1.1], "mag": [0.9, 1.1]}, assumed=["level"]
    )
    assert innovation_warnings(document) == []
    assert innovations(document, "level") == "assumed, no sensor"
    assert "nothing speaks against" in size_of_innovations(document)


def test_where_no_interval_is_known_innovations_say_nothing() -> None:
    """Of noise that was found from them, with heavy tails, `report_of` gives none."""
    document = an_estimate(nis={"mag": 1.8}, nis_interval={"mag": [None, None]})
    assert innovations(document, "mag") == ""
    assert innovation_warnings(document) == []
    assert "says nothing" in size_of_innovations(document)
    assert "says nothing" not in size_of_innovations(an_estimate(nis={}, nis_interval={}))  # nothing was found from any


def test_an_interval_is_of_innovations_whose_law_is_normal() -> None:
    recording, _ = fly(1, duration=5.0)
    for tail, known in ((None, True), (4.0, False)):
        journal = run(prepare(Flight.of(recording, tail=tail, gate_level=None)), "numba", 0)
        intervals = report_of(journal)["nis_interval"]
        assert all((low is not None) == (high is not None) == known for low, high in intervals.values())


def test_biases_stand_beside_the_truth_where_there_is_one() -> None:
    document = an_estimate(truth={"bias_error": {"gyro": [0.002, 0.0, -0.0005], "baro": [-0.1]}})
    rows = bias_rows(document)
    assert [row.truth for row in rows] == pytest.approx([0.012, 0.02, -0.0005, 0.4])
    assert [off_by(row) for row in rows] == ["-2.0 sigma", "+0.0 sigma", "+0.5 sigma", "+1.0 sigma"]
    lines = estimate_summary("flight", document).splitlines()
    assert re.fullmatch(r" +gyro x +0\.0100 ± 0\.0010 +0\.0120 +-2\.0 sigma +rad/s", lines[2])
    assert "truth" not in estimate_summary("flight", an_estimate())


def test_figure_of_a_bias_holds_truth_and_band() -> None:
    t = np.linspace(0.0, 60.0, 100)
    course = BiasCourse("baro", t, np.full((100, 1), 0.5), np.full((100, 1), 0.01), np.full((100, 1), -0.4))
    low, high = biases_over_time([course]).axes[0].get_ylim()
    assert low < -0.4 - 0.02
    assert high > 0.53 + 0.02


def test_components_that_are_known_only_together_are_said_to_be() -> None:
    effect = {"beta": [-0.35, -0.37, -0.0003], "std": [0.70, 0.17, 0.059]}
    assert "p tests all 3 at once" in known_together(effect)
    assert known_together({**effect, "std": [0.70, 0.05, 0.059]}) == ""
    assert known_together({"beta": [0.1], "std": [0.2]}) == ""


def test_units_of_a_magnetometer() -> None:
    assert stream_unit("mag", "1") == "of the field"
    assert stream_unit("mag", "field") == "in the unit of the field"
    assert stream_unit("baro", "m") == "m"
    assert stream_unit("accel", "m/s^2") == "m/s²"


@pytest.mark.parametrize(("field", "unit"), [((0.6, 0.0, 0.8), "1"), ((0.3, 0.0, 0.4), "field")])
def test_readings_are_parts_of_the_field_only_where_its_norm_is_1(field: tuple[float, ...], unit: str) -> None:
    recording, _ = simulate(load_scenario("mag_poses"), np.random.default_rng(7))
    declared = np.asarray(recording.environment.magnetic_field, dtype=np.float64)
    scaled = recording.streams["mag"].array(MAG) * np.linalg.norm(field) / np.linalg.norm(declared)
    stream = Stream(recording.streams["mag"].t, dict(zip(MAG, scaled.T, strict=True)))
    environment = replace(recording.environment, magnetic_field=field)
    readings = triad_readings(recording.replace(streams={"mag": stream}, environment=environment), "mag")
    assert readings.unit == unit


def test_calibration_has_the_unit_of_its_offset() -> None:
    recording, _ = simulate(load_scenario("mag_poses"), np.random.default_rng(7))
    result = calibrate_triad(recording, triad_readings(recording, "mag"), "none")
    lines = calibration_summary("mag", as_json("mag", result)).splitlines()
    assert lines[5].startswith("  b ")
    assert lines[5].endswith(" of the field")


def test_printed_value_with_another_sign_is_a_sign_error() -> None:
    assert sign_errors([-0.14481, -0.03341, 0.08983], [-0.1448, -0.0334, -0.0898]) == [2]
    assert sign_errors([0.1, -0.2], [-0.3, -0.2]) == []


def test_numbers_and_nouns() -> None:
    assert [counted(n, "reading") for n in (0, 1, 2)] == ["0 readings", "1 reading", "2 readings"]
    assert [p_value_words(p) for p in (-0.7, -11.2, -200.0)] == ["p = 0.2", "p = 10^-11", "p < 10^-100"]


def test_page_raises_exponents_and_sets_code(tmp_path: Path) -> None:
    page = Page("A `title`", "p < 10^-100 & 5 m/s^2")
    page.text("`sinan trace run1` says it")
    page.table(["a"], [["one"], ["two"]], marked=[1])
    page.write(tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text()
    assert "10<sup>−100</sup> &amp; 5 m/s<sup>2</sup>" in text
    assert "<code>sinan trace run1</code>" in text
    assert "<title>A title</title>" in text
    assert '<tr class="marked"><td>two</td></tr>' in text
    assert "`" not in text


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
        "log10_p_value": -20.0, "predicts": True,
    }  # fmt: skip
    error = {
        "stream": "sonar", "held_out_part": "last third", "same_names_on_fitting_part": True,
        "before": {"rms": 0.2, "unit": "m"}, "after": {"rms": 0.05, "unit": "m", "interval": [0.04, 0.06]},
        "in_sample": {"before": {"rms": 0.21}, "after": {"rms": 0.06}},
    }  # fmt: skip
    document = {"recording": "x", "verdict": "effects", "effects": [effect], "error": error, "remaining": []}
    return {**document, "twins": [], "sensors": [], "left_out": [], "separates": "", **changes}


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
    assert "several heights" in what_next(document, Log())


def test_title_counts_what_is_there_apart_from_what_may_be_another() -> None:
    """Each with its name."""
    (one,) = a_document()["effects"]
    unsure = {**one, "confused_with": ["laser.mount_offset"]}
    brief = {**one, "name": "baro.transient"}
    text = title(a_document(verdict="ambiguous", effects=[one, one, brief, one, brief, unsure]))
    assert (
        ", 3 more effects (baro.transient, sonar.mount_offset), and 1 more effect that these data cannot tell from "
        "others (sonar.mount_offset): residual" in text
    )


def test_lead_warns_where_a_part_of_the_data_chooses_other_names() -> None:
    document = a_document()
    assert "with caution" not in lead(document)
    document["error"]["same_names_on_fitting_part"] = False
    assert "with caution" in lead(document)


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


def test_the_text_of_an_interval_gives_a_first_innovation_its_weight() -> None:
    """Its error of 186 m is predicted, and no part of the RMS of 0.1 m beside the interval."""
    t, tells = np.arange(60.0), np.ones((60, 1), dtype=np.bool_)
    error = np.where(np.arange(60) % 2, 0.1, -0.1)[:, None]
    variance = np.full((60, 1), 0.01)
    error[0], variance[0] = 186.0, 1e4
    after = StreamResidual("baro", t, error, error, tells, ~tells[:, 0], "m", {}, np.arange(60), 0.0, variance)
    before = replace(after, residual=error + np.where((t >= 40.0) & (t < 45.0), 2.0, 0.0)[:, None])
    text = _local_caption(before, after, Term("baro.transient", (40.0, 45.0)), is_last=False)
    assert "RMS 1.98 → 0.10 m in the yellow part and 0.10 → 0.10 m in all the rest" in text


def test_the_size_of_what_acts_for_a_while_is_told_with_when_it_acts() -> None:
    one = {**a_document()["effects"][0], "name": "baro.transient", "interval": [45.0, 57.0], "std": [0.01]}
    assert size_words(one) == "from 45 s to 57 s"
    assert size_and_sigma(one).replace("\N{NO-BREAK SPACE}", " ") == "0.200 ± 0.010 m, from 45 s to 57 s"
    three = {**one, "name": "accel.step", "beta": [0.1, -0.3, 0.0], "std": [0.01] * 3, "unit": ["m/s^2"] * 3}
    assert size_and_sigma(three) == "up to 0.30 m/s², from 45 s on"
