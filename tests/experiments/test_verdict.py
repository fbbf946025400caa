"""The verdict and its figures: what is named predicts, both of two twins are shown, all words are the same."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from scipy.optimize import least_squares

from sinan.calibration.levels.assumptions import OF_BOUNDS
from sinan.calibration.poses.evidence.poses import NormPoses
from sinan.calibration.poses.evidence.source import LeastSquaresSource
from sinan.estimator.evidence.source import Fit
from sinan.estimator.evidence.term import Term
from sinan.experiments.answers.traces import slow_imu
from sinan.experiments.report.trace_page import _head, _what_remains, trace_page
from sinan.experiments.report.verdict_words import (
    Log,
    declared_lines,
    errors_against_a_truth,
    lead,
    next_with_parameters,
    says,
    title,
    trace_summary,
    what_next,
    worded,
)
from sinan.experiments.residual_loop.report import report
from sinan.experiments.residual_loop.run import trace_recording
from sinan.experiments.residual_loop.select import select
from sinan.experiments.residual_loop.trace import trace
from sinan.experiments.residual_loop.traced import Traced
from sinan.experiments.residual_loop.verdict import Scores, in_place, settle, twins_of
from sinan.experiments.scenarios import parse_effect
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import ACCEL, GYRO, Recording, Stream
from sinan.sensors.simulate import simulate
from sinan.sensors.window import between
from tests.experiments.test_report import a_document
from tests.experiments.test_residual_loop import poses
from tests.flights import scenario_at

#: What the weights of the residuals change.
WEIGHTS = 5e-3
CURRENT = "the magnetometer reads the motor current"

#: What a verdict says of the effects, whatever else is in a report.
RULES: dict[str, Any] = {
    "allOf": [
        {
            "if": {"properties": {"verdict": {"enum": ["effects", "ambiguous"]}}},
            "then": {"properties": {"effects": {"minItems": 1}}},
        },
        {
            "if": {"properties": {"verdict": {"const": "no_effect"}}},
            "then": {"properties": {"effects": {"maxItems": 0}}},
        },
        {
            "if": {"properties": {"verdict": {"const": "effects"}}},
            "then": {"properties": {"effects": {"items": {"properties": {"predicts": {"enum": [True, None]}}}}}},
        },
    ]
}


def traced(problem: NormPoses) -> Mapping[str, Any]:
    source = LeastSquaresSource(problem)
    document: dict[str, Any] = worded(report(Traced.alone(source, trace(source))))
    jsonschema.validate(json.loads(json.dumps(document, allow_nan=False)), RULES)
    return document


def held_out_rms(reading: FloatArray, norm: float, covariate: FloatArray) -> tuple[float, float]:
    """RMS of the norm's residual on every fifth of 25 blocks, of a scale and a bias a axis fitted to the rest, without
    and with a bias that follows a covariate: the definition, minimised by SciPy.

    reading = diag(1 + s) u + b + c covariate, |u| = norm. Neglects that scales of a few per cent weight the residuals.
    """
    n = len(reading)
    held = (np.arange(n) * 25 // n) % 5 == 4

    def residual(x: FloatArray, rows: FloatArray) -> FloatArray:
        added = np.outer(covariate, x[6:]) if len(x) > 6 else 0.0
        u = (reading - x[3:6] - added) / (1.0 + x[:3])
        return np.linalg.norm(u, axis=1)[rows] - norm

    start = np.concatenate([np.zeros(3), 0.5 * (reading.max(axis=0) + reading.min(axis=0))])
    fits = [least_squares(residual, np.pad(start, (0, k)), args=(~held,), xtol=1e-14, ftol=1e-14).x for k in (0, 3)]
    before, after = (float(np.sqrt(np.mean(residual(x, held) ** 2))) for x in fits)
    return before, after


def test_an_effect_is_in_the_head_line_only_if_the_held_out_error_falls_with_it() -> None:
    """A current loop at the edge of what 120 readings show: in some sets the effect passes its test on all data and
    predicts the held-out readings worse than the model without it.
    """
    failed = []
    for seed in range(24):
        problem = poses(np.random.default_rng([70, seed]), 120, 0.003, Term("mag.current"), (0.0008, 0.0, 0.0))
        document = traced(problem)
        if [effect["name"] for effect in document["effects"]] != ["mag.current"]:
            continue
        before, after = held_out_rms(problem.reading, 1.0, np.asarray(problem.covariates["current"])[:120])
        (effect,) = document["effects"]
        assert effect["predicts"] == (after < before)
        error = effect["held_out"]
        assert (error["before"], error["after"]) == pytest.approx((before, after), rel=WEIGHTS)
        if after < before:
            assert document["verdict"] == "effects"
            assert CURRENT in document["headline"].lower()
            assert document["error"]["after"]["rms"] == pytest.approx(after, rel=WEIGHTS)
            continue
        failed.append(document)
        assert document["verdict"] == "unexplained"
        assert CURRENT not in document["headline"].lower()
        assert "mag.current passes the test on all data" in lead(document)
        assert "but does not predict" in lead(document)
        assert document["error"]["after"]["rms"] == document["error"]["before"]["rms"]
    assert len(failed) >= 2


def test_what_does_not_predict_is_shown_as_that(tmp_path: Path) -> None:
    source = LeastSquaresSource(poses(np.random.default_rng([70, 2]), 120, 0.003, Term("mag.current"), (0.0008, 0, 0)))
    result = Traced.alone(source, trace(source))
    document = worded(report(result))
    assert document["effects"][0]["predicts"] is False
    assert "mag.current: x" in trace_summary(document)
    assert "does not predict the held-out data" in trace_summary(document)
    trace_page(tmp_path / "page.html", result, document)
    page = (tmp_path / "page.html").read_text()
    assert "mag.current passes the test on all data" in page
    assert "does not predict, the held-out error does not fall with it" in page


def test_a_verdict_whose_figures_contradict_it_cannot_be_made() -> None:
    source = LeastSquaresSource(poses(np.random.default_rng(18), term=Term("mag.current"), beta=(0.003, 0.0, 0.0)))
    verdict = trace(source).verdict
    proof = replace(verdict.proof, before=verdict.proof.after, after=verdict.proof.before)
    with pytest.raises(ValueError, match=r"mag\.current is reported, and its held-out error does not fall"):
        replace(verdict, proof=proof)


@pytest.fixture(scope="module")
def twins() -> NormPoses:
    """A current that nearly follows the temperature, so that a loop of it looks like a zero that drifts."""
    plain = poses(np.random.default_rng(7), 150)
    t = np.arange(150.0)
    current = 10.0 + 4.0 * np.sin(2.0 * np.pi * t / 150.0)
    covariates = {"current": current, "temperature": 25.0 + 2.0 * (current - 10.0) + 0.3 * np.sin(t)}
    reading = plain.reading + np.outer(current, [0.001, 0.0, 0.0005])
    return NormPoses("simulated", "mag", t, reading, 1.0, "1", np.full(150, 0.003), None, covariates)


def height(fit: Fit) -> Mapping[str, float]:
    """An error against a reference that one of the two spoils."""
    names = {term.name for term in fit.terms}
    return {"height_rms": 0.151 if "mag.current" in names else 0.04 if "mag.temperature" in names else 0.076}


def test_an_ambiguous_report_shows_the_figures_of_both(twins: NormPoses, tmp_path: Path) -> None:
    source = LeastSquaresSource(twins)
    result = Traced.alone(source, trace(source, scores=Scores(height, height, {"kind": "simulation"})))
    document = worded(report(result))
    assert document["verdict"] == "ambiguous"
    assert {twin["name"] for twin in document["twins"]} == {"mag.current", "mag.temperature"}
    for twin in document["twins"]:
        covariate = np.asarray(twins.covariates[twin["name"].removeprefix("mag.")])[:150]
        before, after = held_out_rms(twins.reading, 1.0, covariate)
        (error,) = twin["errors"]
        assert (error["before"], error["after"]) == pytest.approx((before, after), rel=WEIGHTS)
    trace_page(tmp_path / "page.html", result, document)
    page = (tmp_path / "page.html").read_text().replace("&nbsp;", " ")
    assert f"the model has {document['effects'][0]['name']}" in page
    for text in (trace_summary(document), page):
        assert "0.076 → 0.151 m" in text
        assert "0.076 → 0.040 m" in text
    assert document["headline"].endswith("of the field on the held-out fifth, depending on which it is")


def test_two_heights_that_disagree_are_told_with_the_errors_of_each() -> None:
    """A sonar that reads 0.3 m too far beside a laser that does not: a model without either errs by half of that, the
    model with the right one by nothing, the model with the other by all of it.
    """
    present = [parse_effect("sonar.mount_offset=0.3")]
    recording, _ = simulate(scenario_at(50.0, "hover"), np.random.default_rng(3), present)
    kept = {n: recording.streams[n] for n in ("imu", "gps", "mag", "sonar", "laser")}
    recording = between(recording.replace(streams=kept), 0.0, 40.0)
    document = worded(report(trace_recording(recording)))
    assert document["verdict"] == "ambiguous"
    height = {
        twin["name"]: (twin["truth_held_out"]["before"]["height_rms"], twin["truth_held_out"]["after"]["height_rms"])
        for twin in document["twins"]
    }
    assert height["sonar.mount_offset"] == pytest.approx((0.15, 0.0), abs=0.02)
    assert height["laser.mount_offset"] == pytest.approx((0.15, 0.3), abs=0.02)
    text = trace_summary(document)
    assert "with laser.mount_offset (-0.30 m), held out: sonar residual" in text
    assert "; against the simulation: position " in text
    assert "height 0.15 → 0.30 m" in text
    assert re.search(r" to 0\.(29|30)\d\d m on the last third, depending on which it is", document["headline"])


def test_a_twin_that_does_not_predict_gives_its_place_to_one_that_does() -> None:
    """The current follows the drift in the fitting part and runs against it in the held-out part."""
    plain, t = poses(np.random.default_rng(71), 150), np.arange(150.0)
    held, drift = (np.arange(150) * 25 // 150) % 5 == 4, 4.0 * np.sin(2.0 * np.pi * t / 150.0)
    covariates = {"current": np.where(held, -drift, drift), "temperature": 25.0 + drift}
    reading = plain.reading + np.outer(drift, [0.0012, 0.0, 0.0006])
    source = LeastSquaresSource(
        NormPoses("simulated", "mag", t, reading, 1.0, "1", np.full(150, 0.003), None, covariates)
    )
    selection = select(source)
    (true,) = selection.findings
    assert true.term.name == "mag.temperature"
    wrong = replace(true, term=Term("mag.current"), rivals=(true,))
    settled = settle(source, in_place(source, selection, true.term, wrong))
    (named,) = settled.effects
    assert named.finding.term == true.term
    assert named.predicts
    assert named.finding.confused_with == ("mag.current",)
    figures = {twin.named.finding.term.name: twin.named.predicts for twin in twins_of(source, settled, Scores())}
    assert figures == {"mag.temperature": True, "mag.current": False}


def test_terminal_json_and_page_say_the_same(tmp_path: Path) -> None:
    source = LeastSquaresSource(poses(np.random.default_rng(18), term=Term("mag.current"), beta=(0.003, 0.0, 0.0)))
    result = Traced.alone(source, trace(source))
    document = worded(report(result), "run1", Log("my log.csv", Path("log.toml")))
    trace_page(tmp_path / "page.html", result, document)
    page = (tmp_path / "page.html").read_text().replace("&nbsp;", " ").replace("&#x27;", "'")
    text = trace_summary(document)
    assert text.splitlines()[0] == "run1: effects"
    assert document["headline"] in text
    assert f"<h1>{document['headline']}</h1>" in page
    assert "Verdict <code>effects</code>: what is named passes the test on all data, and predicts the" in page
    assert document["says"][1:] in text
    assert document["next"] in text
    assert "What to do next: <code>sinan convert 'my log.csv' run --map log.toml</code>" in page
    low, high = document["error"]["after"]["interval"]
    assert f"95 % interval of the second value: {low:.3g} to {high:.3g}" in page


def test_a_page_says_version_command_and_date(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from sinan.experiments.report.page import Page

    monkeypatch.setattr("sys.argv", ["/usr/bin/sinan", "trace", "my log.csv", "--html", "page.html"])
    Page("A title").write(tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "<footer>sinan " in page
    assert "<code>sinan trace &#x27;my log.csv&#x27; --html page.html</code>" in page
    assert re.search(r"\d{4}-\d\d-\d\d \d\d:\d\d UTC</footer>", page)


def test_an_error_against_the_reference_that_grows_is_in_the_head_line() -> None:
    """8.3 to 12.4 deg of heading, while the residual falls."""
    document = a_document()
    error = document["error"]
    error["stream"], error["before"]["unit"] = "mag", "1"
    before, after = ({"heading_rms": np.deg2rad(angle)} for angle in (8.3, 12.4))
    error["truth_held_out"] = {"kind": "cameras", "before": before, "after": after}
    assert title(document).endswith(
        "residual 0.200 → 0.050 of the field, but heading error 8.3 → 12.4 deg on the last third"
    )
    assert "The heading error against the cameras grows: treat the named effects with caution." in lead(document)
    assert "the heading error against the cameras grows with it" in what_next(document, Log())
    error["truth_held_out"]["kind"] = "autopilot"
    assert title(document).endswith("residual 0.200 → 0.050 of the field on the last third")


def test_what_no_held_out_reading_can_tell_has_no_proof_in_the_head_line() -> None:
    document = a_document()
    document["effects"][0]["predicts"] = None
    assert title(document).endswith("0.20 m; not confirmed: the last third cannot show it")
    assert "only the evidence speaks for it. On all data the RMS of the sonar residual goes 0.210 → 0.060 m" in lead(
        document
    )


def test_the_sentence_says_of_which_effects_withheld_readings_cannot_tell() -> None:
    document = a_document()
    (one,) = document["effects"]
    assert says(document) == "what is named passes the test on all data, and predicts the last third of the data"
    scale = {**one, "name": "mag.scale"}
    brief = {**one, "name": "baro.transient", "predicts": None, "interval": [3.0, 5.0]}
    document["effects"] = [one, brief]
    assert says(document).endswith(
        "; sonar.mount_offset predicts the last third of the data, which cannot tell of baro.transient from 3 s to 5 s"
    )
    document["effects"] = [one, brief, scale, {**one, "name": "gps.outliers", "predicts": None}]
    assert says(document).endswith(
        "; sonar.mount_offset and mag.scale predict the last third of the data, which cannot tell of baro.transient "
        "from 3 s to 5 s and gps.outliers"
    )


UNSEEN = {"name": "gyro.scale", "unit": ["1"] * 3, "detectable_from": [None, 0.061, 5.0]}


@pytest.mark.parametrize(
    ("verdict", "changes", "said"),
    [
        ("no_effect", {"effects": [], "candidates": []}, "What would have been seen"),
        ("no_effect", {"effects": [], "candidates": [UNSEEN]}, "record a longer log, a minute or more"),
        ("ambiguous", {"separates": "fly several heights"}, "fly several heights; or measure one of them yourself"),
        ("unexplained", {"remaining": [{"stream": "mag"}]}, "read what remains"),
        ("unexplained", {"remaining": [], "assumptions": [{"source": OF_BOUNDS}]}, "log a position (GPS) too"),
    ],
)
def test_every_verdict_says_what_to_do_next(verdict: str, changes: Mapping[str, Any], said: str) -> None:
    assert said in what_next(a_document(verdict=verdict, **changes), Log())


def test_of_nothing_found_it_says_how_many_effects_would_have_been_seen() -> None:
    """At up to two plausible sizes, of one component at least; what was refused or acts for a time does not count."""
    scale = {"name": "gyro.scale", "unit": ["1"] * 3}  # plausible: 0.03
    candidates = [
        {**scale, "detectable_from": [None, 0.059, 0.9]},
        {**scale, "detectable_from": [0.061, None, None]},
        {**scale, "detectable_from": [None, None, None]},
        {**scale, "detectable_from": [0.01] * 3, "interval": [1.0, 2.0]},
        {**scale, "detectable_from": [], "refused": "no turns"},
        {"name": "mag.current", "unit": ["gauss/A"] * 3, "detectable_from": [None, 1.0, None]},
    ]
    told = what_next(a_document(verdict="no_effect", effects=[], candidates=candidates), Log())
    assert "2 of 4 effects would have been seen at sizes that occur" in told


def test_a_log_that_shows_nothing_is_not_told_to_be_without_fault(tmp_path: Path) -> None:
    """No effect would have been seen at two plausible sizes: not in the head line, nor in what to do next."""
    document = a_document(verdict="no_effect", effects=[], candidates=[UNSEEN])
    assert title(document).startswith("Nothing was found, and nothing could have been: no lasting effect of a size")
    assert says(document) == "no effect passes the test, nor would one of a size that occurs"
    told = what_next(document, Log())
    assert "nothing that this log shows needs correcting" not in told
    assert "record a longer log, a minute or more, that turns about all three axes" in told
    assert "of this log 0 of 1 effects would have been seen" in told
    assert "record more poses" in what_next(document, Log(poses=True))
    for excess, ending in ((0.5, "the residual is not pure noise"), (-0.9, "shows in this log")):
        left = [{"stream": "mag", "kind": "variance", "excess": excess}]
        assert title({**document, "remaining": left}).endswith(ending)
    seen = a_document(verdict="no_effect", effects=[], candidates=[{**UNSEEN, "detectable_from": [0.01] * 3}])
    assert title(seen) == "Nothing wrong was found: the residual looks like pure noise"
    assert says(seen) == "no effect passes the test"
    marks = []
    for one in (document, seen):
        asked = {"dof": 3, "p_value": 0.5}
        known = {**worded(one), "candidates": [{**c, **asked} for c in one["candidates"]], "p_value_needed": 1e-3}
        _head({**known, "alpha": 0.01}).write(tmp_path / "page.html")
        marks.append((tmp_path / "page.html").read_text())
    assert '<p class="verdict unseen">nothing could be seen</p>' in marks[0]
    assert '<p class="verdict no_effect">no effect found</p>' in marks[1]


def test_what_passed_its_test_is_no_part_of_a_residual_of_which_nothing_is_left() -> None:
    """The one must not contradict the other."""
    beside = {"rolled_back": ["accel.lever_arm"], "effects": []}
    first, second = _what_remains(a_document(**beside))
    assert first.startswith("accel.lever_arm passed the test on all data, but held-out data do not bear it out")
    assert second.startswith("apart from what accel.lever_arm would explain, the remaining residual is white")
    (alone,) = _what_remains(a_document(rolled_back=[], effects=[]))
    assert alone == "nothing: the remaining residual is white, and as large as the noise"
    failed = [{**a_document()["effects"][0], "predicts": False}]
    assert "sonar.mount_offset would explain" in _what_remains(a_document(rolled_back=[], effects=failed))[-1]


def test_next_names_the_parameters_of_the_flight_controller() -> None:
    """Where some correct what was found, and only then."""
    document = {**a_document(), "next": "write it down", "autopilot": {"parameters": [], "call": None}}
    assert next_with_parameters(document) == "write it down"
    document["autopilot"] = {"parameters": [{"name": f"P{k}"} for k in range(6)], "call": "sinan params LOG"}
    told = next_with_parameters(document)
    assert told.startswith("set P0, P1, P2, P3 and others as listed (`sinan params LOG` writes a file), fly again")
    assert next_with_parameters({**document, "verdict": "unexplained"}) == "write it down"


def test_a_page_leads_to_its_sections(tmp_path: Path) -> None:
    from sinan.experiments.report.page import Page

    page = Page("A title")
    page.contents()
    page.heading("What <was> found")
    page.heading("What remains")
    page.write(tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text()
    assert '<nav><a href="#section-1">What &lt;was&gt; found</a> <a href="#section-2">What remains</a></nav>' in text
    assert '<h2 id="section-1">What &lt;was&gt; found</h2>' in text
    assert '<h2 id="section-2">What remains</h2>' in text


def test_an_autopilots_own_estimate_is_no_error_in_large_figures() -> None:
    held = {"kind": "autopilot", "before": {"heading_rms": 0.1}, "after": {"heading_rms": 0.2}}
    assert errors_against_a_truth({"truth_held_out": held}) == {}
    assert list(errors_against_a_truth({"truth_held_out": {**held, "kind": "cameras"}}).values()) == ["5.7 → 11.5 deg"]


def test_a_page_of_a_log_whose_name_is_no_text(tmp_path: Path) -> None:
    """A name of a file is bytes: one that is not UTF-8 is shown escaped."""
    from sinan.experiments.report.page import Page

    page = Page("flight")
    page.rests_on([{"log": "flight\udcff.ulg", "sha256": "0"}])
    page.write(tmp_path / "page.html")
    assert "flight\\udcff.ulg" in (tmp_path / "page.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(("rate", "said"), [(10.0, True), (100.0, False)])
def test_an_imu_that_was_logged_too_slowly_is_warned_of(rate: float, said: bool) -> None:
    t = np.arange(0.0, 2.0, 1.0 / rate)
    still = np.tile([0.0, 0.0, -9.8, 0.0, 0.0, 0.0], (len(t), 1))
    imu = Stream(t, dict(zip((*ACCEL, *GYRO), still.T, strict=True)))
    warned = slow_imu(Recording("slow", "flight", {"imu": imu}))
    assert [text.startswith("the IMU was logged 10 times a second") for text in warned] == [True] * said


def test_what_was_found_is_written_into_a_recording_or_a_converted_log(tmp_path: Path) -> None:
    """A folder that is a bag has no recording.toml to write into."""
    document = a_document(verdict="effects")
    bag, recording = tmp_path / "bag", tmp_path / "run"
    for folder in (bag, recording):
        folder.mkdir()
    (recording / "recording.toml").touch()
    lines = declared_lines(document)
    assert what_next(document, Log(str(recording))).startswith(f"write {lines[0]} into `[effects]` of `{recording}/")
    declared = tomllib.loads("\n".join(["[effects]", *(line.strip("`") for line in lines)]))["effects"]
    lasting = {e["name"]: e["beta"] for e in document["effects"] if not e.get("interval")}
    assert declared == {name: pytest.approx(beta, rel=1e-3) for name, beta in lasting.items()}
    assert what_next(document, Log(str(bag))).startswith(f"`sinan convert {bag} run`")
    assert "recording.toml` and of each other log: " in what_next(document, Log(str(recording), others=1))


def test_what_is_a_part_of_the_field_is_said_to_be_one() -> None:
    document = a_document(verdict="effects")
    first = document["effects"][0]
    document["effects"] = [{**first, "name": "mag.current", "beta": [0.1, 0.2, 0.3], "unit": ["1/A"] * 3}]
    assert declared_lines(document) == ['`"mag.current" = [0.1, 0.2, 0.3]`']
    assert declared_lines(document, in_parts=True) == [
        '`"mag.current" = [0.1, 0.2, 0.3]` times the mean norm of the readings'
    ]
    document["effects"][0]["unit"] = ["gauss/A"] * 3
    assert declared_lines(document, in_parts=True) == declared_lines(document)
