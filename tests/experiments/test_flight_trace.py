"""The loop on flights: the right effect alone, none where there is none, errors against the truth."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sinan.estimator.evidence.flights.passes import FlightPasses
from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.evidence.score import statistic_of
from sinan.estimator.evidence.term import Term
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import flight_model
from sinan.estimator.filter.layout import Q_NB
from sinan.experiments.blind.maker.make import make_one
from sinan.experiments.datasets import resolve
from sinan.experiments.refused import doubted_shares
from sinan.experiments.report.refused_words import refused
from sinan.experiments.report.trace_page import trace_page
from sinan.experiments.report.trace_words import effect_line
from sinan.experiments.report.verdict_words import trace_summary, worded
from sinan.experiments.residual_loop.open_flight import flight_source
from sinan.experiments.residual_loop.report import report
from sinan.experiments.residual_loop.run import trace_recording
from sinan.experiments.residual_loop.select import select
from sinan.experiments.residual_loop.trace import trace
from sinan.experiments.residual_loop.traced import Traced
from sinan.experiments.residual_loop.trials import ROLLED_BACK
from sinan.experiments.scenarios import load_scenario, parse_effect
from sinan.sensors.arrays import FloatArray, IntArray
from sinan.sensors.errors import InputError
from sinan.sensors.recording import Initial, Recording, SensorSpec, Stream
from sinan.sensors.rotation import cos_tilt, quaternion_interpolate
from sinan.sensors.simulate import simulate
from sinan.sensors.window import between
from tests.flights import scenario_at

#: Of an accelerometer, 3 sigma [m/s^2].
PLAUSIBLE_BIAS = 0.15
A_DEGREE = 1.0
IMU_RATE = 100.0  # Hz
#: Shares from which the recordings of the blind maker are drawn here.
KINDS = {"flight": 0.64, "hand": 0.06, "accel_poses": 0.1, "mag_poses": 0.1, "gyro_turns": 0.1}
#: Shares of what they hide.
CLASSES = {"one": 0.3, "several": 0.15, "outside": 0.15}


def flown(scenario: str, seed: int, *effects: str):
    return simulate(scenario_at(IMU_RATE, scenario), np.random.default_rng(seed), [parse_effect(e) for e in effects])


@pytest.mark.parametrize(
    ("scenario", "effect"),
    [
        ("figure_eight", "mag.current=0.003,0,0.001"),
        ("warm_up", "baro.temperature=0.15"),
        ("square", "gps.latency=0.15"),
        ("warm_up", "accel.temperature=0.004,0,-0.003"),
        ("figure_eight", "mag.transient=0.06,0.02,-0.05@30:40"),
        ("no_aiding", "mag.transient=0.7,-0.2,1.2@20:40"),  # a magnet as strong as it likes
    ],
)
def test_the_right_effect_alone(scenario: str, effect: str) -> None:
    recording, _ = flown(scenario, 21, effect)
    selection = select(FlightSource(Flight.of(recording)))
    present = parse_effect(effect)
    assert selection.names == (present.effect.name,)
    finding = selection.findings[0]
    assert np.all(np.abs(finding.beta - present.beta) < 4.0 * finding.std)
    if finding.term.interval is not None:
        np.testing.assert_allclose(finding.term.interval, (present.t0, present.t1), atol=0.5)


@pytest.mark.parametrize("scenario", ["figure_eight", "square"])
def test_nothing_is_named_where_nothing_is_missing(scenario: str) -> None:
    recording, _ = flown(scenario, 22)
    assert not select(FlightSource(Flight.of(recording))).findings


@pytest.mark.parametrize(("seed", "index"), [(5001, 124), (5001, 145), (9001, 461), (9001, 989), (10001, 209)])
def test_coloured_positions_pass_for_no_effect(seed: int, index: int, tmp_path: Path) -> None:
    """Rough flights, the GPS position a first-order Markov process of 5 to 15 s: every stream is judged against it.

    Wrong readings, which they have, are named though a candidate seemed to come before them. The filter follows the
    slowest so well that the GPS itself is white; the last starts in flight, its attitude unknown.
    """
    recording = resolve(str(make_one(tmp_path, seed, index, KINDS, "mixed", {"none": 1.0})), None)
    names = select(flight_source(recording)).names
    assert names
    assert [name for name in names if not name.endswith(".outliers")] == []


def test_a_start_in_flight_is_no_error_of_the_accelerometer(tmp_path: Path) -> None:
    """The first readings know the tilt to 0.3 rad, all to 0.001: a start as wide as the first is not linear."""
    recording = resolve(str(make_one(tmp_path, 9002, 79, KINDS, "mixed", CLASSES)), None)
    names = select(flight_source(recording)).names
    assert "mag.scale" in names
    assert not any(name.startswith("accel.") for name in names)


def test_a_log_that_declares_nothing_and_has_no_place() -> None:
    """Its compass alone has the dip 4 deg off and no declination, which counted as a walk that hid the effect."""
    recording = between(flown("figure_eight", 27, "mag.current=0.003,0,0.001")[0], 0.0, 40.0)
    field_n = recording.environment.magnetic_field
    assert field_n is not None
    angles = {name: SensorSpec(angles=spec.angles) for name, spec in recording.sensors.items()}
    kept = {name: recording.streams[name] for name in ("imu", "mag", "gps", "power")}
    environment = replace(recording.environment, magnetic_field=None)
    bare = recording.replace(streams=kept, sensors=angles, environment=environment, origin=None, initial=Initial())
    source = flight_source(bare)
    found = source.motion(source.fit([Term("mag.current")])).m_n[-1]
    off = np.degrees(np.arccos(np.clip(_unit(found) @ _unit(field_n), -1.0, 1.0)))
    assert off < A_DEGREE
    selection = select(source)
    assert selection.names == ("mag.current",)
    assert np.all(np.abs(selection.findings[0].beta - [0.003, 0.0, 0.001]) < 4.0 * selection.findings[0].std)


def test_a_motion_that_is_only_assumed_proves_no_effect() -> None:
    """A figure of eight of 20 m, of which nothing measures the place, was an accelerometer's step of 2 m/s^2."""
    recording = between(flown("figure_eight", 1)[0], 0.0, 30.0)
    kept = {name: recording.streams[name] for name in ("imu", "mag")}
    environment = replace(recording.environment, magnetic_field=None)
    bare = recording.replace(streams=kept, sensors={}, environment=environment, origin=None, initial=Initial())
    source = flight_source(bare)
    assert "place" in source.model.sensors
    selection = trace(source).selection
    assert ("accel.step", ROLLED_BACK) in [(finding.term.name, why) for finding, why in selection.dropped]
    assert not selection.names


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)


def test_an_anomaly_that_is_passed_is_unexplained(tmp_path: Path) -> None:
    """A candidate may pass its test with it in the residual, but the verdict does not rest on that."""
    recording = resolve(str(make_one(tmp_path, 6004, 18, KINDS, "mixed", CLASSES)), None)
    source = flight_source(recording)
    result = trace(source)
    assert result.verdict.word == "unexplained"
    assert "mag" in {item.stream for item in result.verdict.remaining if item.in_mean}


def test_a_magnet_that_turns_is_unexplained_and_no_interval() -> None:
    """A magnet of 0.1 of the field that turns about the body's z axis: 0.3 turns a second, noise 0.005."""
    recording, _ = simulate(scenario_at(50.0, "no_aiding"), np.random.default_rng(1))
    mag = recording.streams["mag"]
    angle = 2.0 * np.pi * 0.3 * mag.t
    off = {"mag_x": mag.columns["mag_x"] + 0.1 * np.cos(angle), "mag_y": mag.columns["mag_y"] + 0.1 * np.sin(angle)}
    turning = replace(mag, columns={**mag.columns, **off})
    disturbed = recording.replace(streams={**recording.streams, "mag": turning})
    result = trace(FlightSource(Flight.of(disturbed)))
    assert result.verdict.word == "unexplained"
    assert [finding.term.interval for finding in result.selection.findings if finding.term.interval] == []


def test_wrong_readings_that_a_strong_effect_hides_are_no_transients() -> None:
    """Over a steep slope single readings nine sigma off do not leave their neighbours in the plain model."""
    recording, _ = flown("yaw_turns", 25, "laser.terrain_slope=0.3,-0.2")
    laser = recording.streams["laser"]
    distance = next(iter(laser.columns))
    wrong = laser.columns[distance].copy()
    wrong[[100, 230, 231, 300, 410]] += 9.0 * recording.sensors["laser"].noise_std
    streams = {**recording.streams, "laser": replace(laser, columns={**laser.columns, distance: wrong})}
    recording = recording.replace(streams=streams)
    source = FlightSource(Flight.of(recording))
    selection = select(source)
    assert selection.names == ("laser.terrain_slope", "laser.outliers")
    for fit in (selection.plain, selection.final):
        left = next(r for r in source.residuals(fit) if r.stream == "laser")
        assert len(left.t) == len(wrong) - 5


@pytest.mark.parametrize("stream", ["baro", "mag"])
def test_a_wrong_first_reading_is_no_transient(stream: str) -> None:
    """It sets the bias, whose prior is wide: those after it seem to be off as well.

    A compass knows that before, and its reading is set aside; a barometer's is averaged with those of the first fifth
    of a second, which decide nothing.
    """
    recording, _ = flown("square", 26)
    readings = recording.streams[stream]
    name = next(iter(readings.columns))
    off = readings.columns[name].copy()
    off[0] += 12.0 * recording.sensors[stream].noise_std
    streams = {**recording.streams, stream: replace(readings, columns={**readings.columns, name: off})}
    recording = recording.replace(streams=streams)
    source = FlightSource(Flight.of(recording))
    assert select(source).names == ()
    assert (source.wrong[stream][0] > 0) == (stream == "mag")


def test_a_disturbance_of_a_few_readings_is_one() -> None:
    recording, _ = flown("square", 26)
    baro = recording.streams["baro"]
    name = next(iter(baro.columns))
    off = baro.columns[name].copy()
    off[100:106] += 12.0 * recording.sensors["baro"].noise_std
    recording = recording.replace(
        streams={**recording.streams, "baro": replace(baro, columns={**baro.columns, name: off})}
    )
    assert select(FlightSource(Flight.of(recording))).names == ("baro.transient",)


def test_a_slope_under_a_path_that_nothing_measures() -> None:
    """Without GPS the plain path is metres off, and the score of the slope runs along that path."""
    recording, _ = flown("figure_eight", 26, "laser.terrain_slope=0.02,0.07")
    streams = {name: stream for name, stream in recording.streams.items() if name != "gps"}
    sensors = {name: sensor for name, sensor in recording.sensors.items() if name != "gps"}
    recording = recording.replace(streams=streams, sensors=sensors)
    selection = select(flight_source(recording))
    assert selection.names == ("laser.terrain_slope",)
    finding = selection.findings[0]
    assert np.all(np.abs(finding.beta - [0.02, 0.07]) < 4.0 * finding.std)


@pytest.mark.parametrize("seed", [21, 23])
def test_a_cone_wider_than_any_tilt_is_a_bound(seed: int) -> None:
    """Every reading is then the height: no derivative sees the angle, the whole gain does."""
    recording, _ = flown("low_pass", seed, "sonar.beam_cone=0.7")
    source = FlightSource(Flight.of(recording))
    found = trace(source)
    (finding,) = [f for f in found.selection.findings if f.term.in_mean]
    t, x = source.states(found.selection.final)
    tilt = np.arccos(cos_tilt(quaternion_interpolate(recording.streams["sonar"].t, t, x[:, Q_NB])))
    assert finding.term.name == "sonar.beam_cone"
    assert 0.8 * np.max(tilt) < finding.beta[0] < 1.05 * np.max(tilt)
    assert np.isinf(finding.std[0])
    assert " or more rad" in effect_line(report(Traced.alone(source, found))["effects"][0])  # type: ignore[index]


@pytest.mark.parametrize(("cone", "start"), [(0.1, 0.9), (0.3, 0.9), (0.45, 0.9)])
def test_a_step_that_leaps_over_the_minimum_comes_back(cone: float, start: float) -> None:
    recording, _ = flown("low_pass", 21, f"sonar.beam_cone={cone}")
    source, term = FlightSource(Flight.of(recording)), Term("sonar.beam_cone")
    far, near = (source.fit((term,), {term: np.array([b])}) for b in (start, cone))
    assert far.deviance == pytest.approx(near.deviance, abs=1.0)
    assert abs(far.beta[term][0] - cone) < 4.0 * far.std[term][0] < 0.1


def test_what_no_reading_sees_goes_to_zero_from_wherever_it_starts() -> None:
    """A hover turns about no axis."""
    recording, _ = flown("hover", 30)
    source, term = FlightSource(Flight.of(recording)), Term("gyro.cross_axis")
    plausible = np.array([parameter.plausible for parameter in term.effect.parameters])
    fit = source.fit((term,), {term: 5.0 * plausible})
    assert np.all(np.abs(fit.beta[term]) < 0.1 * plausible)
    assert np.all(np.isinf(fit.std[term]))
    assert fit.deviance == pytest.approx(source.fit(()).deviance, abs=0.1)


def test_what_the_readings_know_does_not_feel_what_holds_it() -> None:
    """One plausible size, known to a hundredth of it: the estimate is that of the readings alone."""
    recording, _ = flown("figure_eight", 31, "mag.current=0.03,0,0.01")
    source, term = FlightSource(Flight.of(recording)), Term("mag.current")
    fit = source.fit((term,))
    left = statistic_of(source.evidence(fit, own_terms_only=True), "mag.current")
    assert np.all(np.abs(left.beta) < 0.1 * left.std)
    assert np.all(np.abs(fit.beta[term] - [0.03, 0.0, 0.01]) < 4.0 * fit.std[term])


def test_what_holds_an_estimate_is_taken_off_where_the_readings_bear_it_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Held to zero by a thousandth of a plausible size: without that it is the estimate of a fit that nothing holds,
    unless a pass with it is no likelier, as where the size of a derivative is not that of the likelihood.
    """
    recording, _ = flown("figure_eight", 31, "mag.current=0.03,0,0.01")
    source, held, term = FlightSource(Flight.of(recording)), FlightSource(Flight.of(recording)), Term("mag.current")
    free = source.fit((term,))
    held._passes.prior_sigma = 1e-3
    fit = held.fit((term,))
    assert np.linalg.norm(fit.beta[term]) < 0.9 * np.linalg.norm(free.beta[term])
    evidence = held.evidence(fit, own_terms_only=True)
    assert np.all(np.abs(held.alone(fit, term, evidence) - free.beta[term]) < free.std[term])
    monkeypatch.setattr(FlightPasses, "deviance_at", lambda *_: fit.deviance)
    assert np.array_equal(held.alone(fit, term, evidence), fit.beta[term])


def test_no_effect_is_a_statement() -> None:
    """A clean flight: the report says so, and from which size on each effect would have been seen."""
    recording, _ = flown("square", 24)
    source = FlightSource(Flight.of(recording))
    document = json.loads(json.dumps(report(Traced.alone(source, trace(source))), allow_nan=False))
    assert document["verdict"] == "no_effect"
    assert document["effects"] == []
    assert document["error"]["before"]["rms"] == document["error"]["after"]["rms"]
    assert document["consistency"]["nis_after"] == pytest.approx(1.0, abs=0.03)
    assert sum(bool(c["detectable_from"]) and c["detectable_from"][0] is not None for c in document["candidates"]) > 10


def test_report_has_the_errors_before_and_after(tmp_path: Path) -> None:
    recording, _ = flown("yaw_turns", 23, "mag.current=0.004,-0.002,0.001")
    found = trace_recording(recording)
    document = json.loads(json.dumps(worded(report(found), "run"), allow_nan=False))
    trace_page(tmp_path / "page.html", found, document)
    assert "heading error (RMS) against the simulation" in (tmp_path / "page.html").read_text()
    assert "heading error (RMS) against the simulation, all data: " in trace_summary(document)
    assert document["verdict"] == "effects"
    assert [e["name"] for e in document["effects"]] == ["mag.current"]
    assert document["error"]["stream"] == "mag"
    assert document["error"]["same_names_on_fitting_part"]
    assert document["error"]["after"]["rms"] < document["error"]["before"]["rms"]
    assert document["error"]["after"]["nis_per_dof"] == pytest.approx(1.0, abs=0.1)
    truth_errors = document["error"]["truth"]
    assert truth_errors["after"]["attitude_rms"] < truth_errors["before"]["attitude_rms"]
    assert truth_errors["kind"] == "simulation"
    assert truth_errors["known"] == ["position", "velocity", "attitude"]
    sizes = {c["name"]: c["detectable_from"] for c in document["candidates"]}
    assert any(s is not None for s in sizes["baro.temperature"]) if "baro.temperature" in sizes else True


def test_a_coarse_declared_attitude_is_no_error_of_the_accelerometer(tmp_path: Path) -> None:
    """Declared to 0.04 rad: until the tilt is found its square is a force of 0.02 m/s^2, nine sigma of a transient."""
    recording = resolve(str(make_one(tmp_path, 6001, 545, KINDS, "mixed", {"none": 1.0})), None)
    assert recording.initial.attitude_std is not None
    assert select(FlightSource(Flight.of(recording))).names == ()


def test_steps_are_those_about_the_fit_that_is_asked() -> None:
    """A slope of the ground in the model changes what an offset of the laser does."""
    recording, _ = flown("yaw_turns", 25, "laser.terrain_slope=0.3,-0.2")
    source = FlightSource(Flight.of(recording))
    steps = [("laser", 20.0), ("accel", 20.0)]
    plain, sloped = source.fit(()), source.fit((Term("laser.terrain_slope"),))
    source._step_rows(plain, steps)
    fresh = FlightSource(Flight.of(recording))
    again = fresh._step_rows(fresh.fit((Term("laser.terrain_slope"),)), steps)
    np.testing.assert_allclose(source._step_rows(sloped, steps).wanted, again.wanted, atol=1e-9)


def test_readings_of_an_interval_are_those_that_were_valid_then() -> None:
    """The stamps of a late sensor are not the instants of the interval; a fit from before still has its readings."""
    recording, _ = flown("square", 26)
    model = flight_model(recording)
    source = FlightSource(Flight(recording, model.replace(latency={**model.latency, "baro": 0.15})))
    plain = source.fit(())
    t = source.recording.streams["baro"].t
    term = Term("baro.transient", (float(t[200]) - 0.151, float(t[200]) - 0.149))
    assert source.set_aside_within(plain, term)
    np.testing.assert_array_equal(source.recording.streams["baro"].t, np.delete(t, 200))
    assert source.local_findings(plain)
    assert not source.local_findings(plain, intervals=False)


def test_a_fit_is_found_once() -> None:
    """Nor again from its own estimate on, or with wrong readings named; but of other readings it is."""
    recording, _ = flown("square", 27, "baro.scale=0.05")
    source = FlightSource(Flight.of(recording))
    term, wrong = Term("baro.scale"), Term("gps.outliers")
    found = source.fit((term,))
    for same in (source.fit((term,)), source.fit((term,), found.beta), source.fit((term, wrong), found.beta)):
        assert same.detail is found.detail
    t = source.recording.streams["baro"].t
    assert source.set_aside_within(found, Term("baro.transient", (float(t[200]) - 1e-3, float(t[200]) + 1e-3)))
    assert source.fit((term,), found.beta).detail is not found.detail


def test_declared_effects_are_taken_off_the_motion_that_is_followed() -> None:
    """A twentieth too much of the accelerometer is no force, whatever else is in the model."""
    scenario, effects = load_scenario("hover"), {"accel.scale": (0.05, 0.05, 0.05)}
    recording, _ = simulate(scenario, np.random.default_rng(28), effects, declare=True)
    passes = FlightSource(Flight.of(recording))._passes
    journal, _ = passes.run([], passes.plain)
    force = np.linalg.norm(np.mean(passes.follow(journal, passes.plain).f_b, axis=0))
    assert force == pytest.approx(np.linalg.norm(passes.plain_motion.g_n), abs=PLAUSIBLE_BIAS)


def test_a_trial_that_leads_to_no_number_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Information that is not finite makes a step that is none: no model, and no crash."""
    source = flight_source(shortened(flown("hover", 3)[0], 5.0))
    rows = FlightPasses.rows

    def no_numbers(*given: Any) -> tuple[FloatArray, FloatArray, IntArray]:
        W, white, event = rows(*given)
        return np.full_like(W, np.nan), white, event

    monkeypatch.setattr(FlightPasses, "rows", no_numbers)
    with pytest.raises(InputError, match="a fit that does not converge"):
        source.fit([Term("mag.current")])


@pytest.mark.parametrize("first", [np.nan, np.inf, -1e4])
def test_a_plain_model_without_a_likelihood_is_refused_and_one_that_loses_it_is_the_one_before(
    first: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the first pass has of it; the second has none."""
    flight = Flight.of(shortened(flown("hover", 3)[0], 5.0))
    values = [first, np.nan]
    monkeypatch.setattr(FlightPasses, "deviance", lambda *_: values.pop(0))
    if np.isfinite(first):
        assert np.all(np.isfinite(FlightPasses(flight).plain_motion.p_n))
        assert values == []
    else:
        with pytest.raises(InputError, match="a fit that does not converge"):
            FlightPasses(flight)


def shortened(recording: Recording, seconds: float) -> Recording:
    """The beginning of a flight."""
    return recording.replace(streams={n: s.rows(s.t < s.t[0] + seconds) for n, s in recording.streams.items()})


def test_readings_in_another_unit_are_refused_by_the_gate() -> None:
    recording = shortened(flown("hover", 3)[0], 10.0)
    baro = recording.streams["baro"]
    wrong = Stream(baro.t, {**baro.columns, "height": 1000.0 * baro["height"]})
    in_millimetres = recording.replace(streams={**recording.streams, "baro": wrong})
    for one, names in ((recording, set()), (in_millimetres, {"baro"})):
        assert set(refused(doubted_shares(FlightSource(Flight.of(one)).gated()))) == names
