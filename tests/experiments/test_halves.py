"""Half a log against the other: replication of names and betas, prediction of what is withheld."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sinan.calibration.levels.preparation import Prepared, prepared
from sinan.experiments.benchmarks import halves, prediction, replication
from sinan.experiments.benchmarks.halves import Halves, halved, parsed
from sinan.experiments.benchmarks.prediction import (
    Comparison,
    Errors,
    Interval,
    asked_streams,
    betas_of,
    compare,
    interval_of,
    tiled,
    withheld_in_turn,
)
from sinan.experiments.benchmarks.replication import Replicated, least_lambda, replicated
from sinan.experiments.blind.grade import effects_of
from sinan.experiments.measured.flights import LOGS
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.recording import Recording
from sinan.sensors.simulate import simulate
from sinan.sensors.window import between

LATE = 0.3


def named(name: str, beta: list[float], std: list[float], interval: list[float] | None = None) -> dict[str, Any]:
    return {"name": name, "beta": beta, "std": std, "interval": interval, "confused_with": []}


def report(*effects: dict[str, Any], **detectable: list[float | None]) -> dict[str, Any]:
    candidates = [{"name": n.replace("__", "."), "detectable_from": d} for n, d in detectable.items()]
    return {"verdict": "effects", "effects": list(effects), "candidates": candidates, "cpu_seconds": 1.0}


# ---- halves


@pytest.fixture(scope="module")
def late() -> Recording:
    """A flight whose GPS is late, which it does not declare."""
    return simulate(load_scenario("figure_eight"), np.random.default_rng(3), {"gps.latency": [LATE]})[0]


def test_halves_share_no_reading(late: Recording) -> None:
    first, second = halved(late)
    for name, stream in late.streams.items():
        assert len(first.streams[name]) + len(second.streams[name]) == len(stream)
        assert first.streams[name].t[-1] < second.streams[name].t[0]
    assert np.ptp(first.streams["imu"].t) == pytest.approx(np.ptp(second.streams["imu"].t), abs=0.1)


def test_the_part_of_a_log_is_as_long_as_asked(late: Recording) -> None:
    first, second = halved(late, 40.0)
    assert second.streams["imu"].t[-1] - first.streams["imu"].t[0] == pytest.approx(40.0, abs=0.1)
    whole = halved(late, 1e4)
    assert whole[0].streams["imu"].t[0] == late.streams["imu"].t[0]


def test_a_report_that_is_kept_is_not_made_again(
    late: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def traced(recording: Recording) -> dict[str, Any]:
        asked.append(recording.name)
        return report()

    monkeypatch.setattr(halves, "traced", traced)
    monkeypatch.setattr(halves, "resolve", lambda given: late)
    for longest, count in ((40.0, 2), (40.0, 2), (50.0, 4)):
        assert Halves("walk, RTK", longest, tmp_path).reports == (report(), report())
        assert len(asked) == count


def test_arguments_name_logs(capsys: pytest.CaptureFixture[str]) -> None:
    asked, table = parsed(["walk, RTK", LOGS["quad, slow"], "--longest", "60"], "what it does")
    assert [(one.log, one.longest) for one in asked] == [("walk, RTK", 60.0), ("quad, slow", 60.0)]
    assert table is None
    assert [one.log for one in parsed([], "")[0]] == list(LOGS)
    with pytest.raises(SystemExit):
        parsed(["no such log"], "")
    assert "no measured flight" in capsys.readouterr().err


# ---- replication


def test_lambda_is_at_least_that_of_the_component_seen_best() -> None:
    """Of Lambda = [[4, 1], [1, 2]] sqrt(30 (Lambda^-1)_ii) is detectable; beta' Lambda beta of (6, -2) is 128."""
    Lambda, beta = np.array([[4.0, 1.0], [1.0, 2.0]]), np.array([6.0, -2.0])
    detectable = np.sqrt(30.0 * np.diag(np.linalg.inv(Lambda))).tolist()
    one = effects_of(report(named("mag.scale", beta.tolist(), [1.0, 1.0])))[0]
    found = least_lambda(one, report(mag__scale=detectable))
    assert found == pytest.approx(36.0 * 3.5)
    assert found <= beta @ Lambda @ beta
    assert least_lambda(one, report(mag__scale=[None, 3.0])) == pytest.approx(30.0 * 4.0 / 9.0)
    assert least_lambda(one, report()) == 0.0


def test_names_are_sought_in_the_other_half() -> None:
    first = report(
        named("gps.latency", [0.2], [0.01]), named("mag.scale", [0.1, 0.0, 0.0], [0.01] * 3), baro__lag=[0.3]
    )
    step = named("gps.step", [9.0], [0.1], [3.0, 9.0])
    late, lag = named("gps.latency", [0.23], [0.0]), named("baro.lag", [0.4], [0.1])
    second = report(late, lag, step, mag__scale=[0.2, 0.2, 0.2])
    found = {(row.name, row.half): row for row in replicated("a log", (first, second))}
    assert set(found) == {("gps.latency", 0), ("mag.scale", 0), ("gps.latency", 1), ("baro.lag", 1)}
    assert [found["gps.latency", half].again for half in (0, 1)] == [True, True]
    assert found["gps.latency", 0].z == pytest.approx(3.0)
    assert not found["mag.scale", 0].visible
    assert found["baro.lag", 1].visible
    assert not found["baro.lag", 1].again


def test_replication_is_of_what_is_visible() -> None:
    beta = np.array([0.1])
    rows = [
        Replicated("a log", "gps.latency", 0, beta, np.nan, True, True, 1.0),
        Replicated("a log", "gps.latency", 1, beta, np.nan, True, True, 1.0),
        Replicated("a log", "baro.lag", 1, -beta, 50.0, True, False, None),
        Replicated("a log", "baro.scale", 1, beta, 5.0, False, False, None),
    ]
    text = replication.page(rows, "1 logs: a log.")
    assert "named there | 2 of 3, 66.7 %" in text
    assert "within 3 sigma | 1 of 1" in text  # one pair
    assert "does not occur | 1 of 4" in text
    assert "| a log | baro.scale | second | 0.1 | 5 | not visible | - |" in text
    assert "| a log | baro.lag | second | -0.1 (does not occur) | 50 | no | - |" in text


# ---- prediction


@pytest.fixture(scope="module")
def ready(late: Recording) -> Prepared:
    return prepared(halved(late)[1])


def test_every_reading_is_withheld_once(ready: Prepared) -> None:
    """From 20 s on, in three runs, each window of 5 s by itself."""
    runs = tiled(0.0, 41.0, 5.0)
    assert sorted(window for run in runs for window in run) == [(float(t), t + 5.0) for t in range(0, 36, 5)]
    found, window = withheld_in_turn(ready, "gps", 5.0, {})
    gps, begin = ready.recording.streams["gps"].t, ready.recording.streams["imu"].t[0] + prediction.FIRST
    whole = gps[(gps >= begin) & (gps < begin + 5.0 * (window.max() + 1))]
    assert np.array_equal(np.sort(found.t), whole)
    assert np.all((found.age > 0.0) & (found.age < 5.3))


def test_an_effect_that_is_there_predicts_better(ready: Prepared) -> None:
    found = compare("a log", ready, "gps", 5.0, {"gps.latency": np.array([LATE])}, np.random.default_rng(0))
    assert found is not None
    assert found.errors.ratio.high < 1.0
    assert found.errors.density.low > 0.0
    assert found.worse == ()
    assert found.errors.after < found.errors.before
    assert list(found.by_age) == [0, 1, 2]
    assert sum(part.readings for part in found.by_age.values()) == found.errors.readings
    assert all(part.density.low > 0.0 for part in found.by_age.values())


def test_an_effect_that_is_not_there_predicts_worse(ready: Prepared) -> None:
    found = compare("a log", ready, "gps", 5.0, {"gps.latency": np.array([-LATE])}, np.random.default_rng(0))
    assert found is not None
    assert found.worse == ("distance", "density")


def test_without_gps_every_stream_is_asked() -> None:
    recording, _ = simulate(load_scenario("no_aiding"), np.random.default_rng(6))
    ready = prepared(between(recording, 0.0, 34.0))
    assert asked_streams(ready) == tuple(n for n in ("mag", "baro", "sonar", "laser") if n in recording.streams)
    found = compare("a log", ready, "mag", 2.0, {"mag.scale": np.full(3, 0.2)}, np.random.default_rng(0))
    assert found is not None
    assert "distance" in found.worse


def test_interval_holds_the_ratio_of_equals_and_not_of_others() -> None:
    """Of 40 pairs of equals about 2 lie outside at 95 %; more than 8 has a probability of 1e-3."""
    rng, outside = np.random.default_rng(1), 0
    for _ in range(40):
        sums = np.stack([rng.chisquare(5.0, 40), rng.chisquare(5.0, 40)], axis=-1)
        found = interval_of(sums, lambda s: s[..., 1] / s[..., 0], rng)
        outside += not found.low < 1.0 < found.high
    assert outside <= 8
    worse = interval_of(
        np.stack([rng.chisquare(5.0, 40), 2.0 * rng.chisquare(5.0, 40)], axis=-1), lambda s: s[..., 1] / s[..., 0], rng
    )
    assert worse.low > 1.0


def test_lasting_effects_alone_are_held() -> None:
    found = betas_of(report(named("gps.latency", [0.2], [0.01]), named("gps.step", [9.0], [0.1], [3.0, 9.0]),
                            named("gps.outliers", [0.02], [0.01])))  # fmt: skip
    assert found.keys() == {"gps.latency"}


def row(log: str, length: float, ratio: Interval, density: Interval) -> Comparison:
    errors = Errors(50, 10, 1.5, 1.2, ratio, density)
    return Comparison(log, "gps", length, ("gps.latency",), errors, {1: replace(errors, readings=20)})


def test_page_counts_logs_that_are_worse() -> None:
    better, worse = Interval(0.8, 0.7, 0.9), Interval(1.3, 1.1, 1.5)
    gain, none = Interval(0.5, 0.2, 0.8), Interval(-0.1, -0.4, 0.2)
    rows = [row("one", 5.0, better, gain), row("two", 5.0, worse, none), row("one", 10.0, worse, none)]
    text = prediction.page(rows, [Halves(log, 90.0) for log in ("one", "two", "three", "four")], {"four": "lost"})
    assert "- could not be run: four: lost" in text
    assert "4 logs, of each at most its liveliest 90 s: one; two; three; four." in text
    assert "Without lasting effects in their first half: three." in text
    assert "worse by distance: 1 of 2 logs (two)" in text
    assert "worse by density: 0 of 2 logs\n" in text
    assert "| one: gps.latency | gps, 5 s | 50 in 10 windows | 1.5 | 1.2 | 0.8 [0.7, 0.9] | 0.5 [0.2, 0.8] |" in text
    assert "| one, 1 to 2 s | gps, 5 s | 20 in 10 windows |" in text


@pytest.mark.measured
def test_a_measured_log_in_halves(measured_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A variometer in the hand whose halves are said to lag by 0.1 s: both pages."""
    if "SINAN_DATA" not in os.environ:
        monkeypatch.setenv("SINAN_DATA", str(measured_data))
    monkeypatch.setattr(halves, "traced", lambda recording: report(named("baro.lag", [0.1], [0.01])))
    monkeypatch.setattr(prediction, "FIRST", 2.0)
    asked = ["variometer", "--keep", str(tmp_path), "--table", str(tmp_path / "page.md")]
    assert "named there | 2 of 2" in replication.main(asked)
    text = prediction.main(asked)
    assert (tmp_path / "page.md").read_text(encoding="utf-8") == text
    assert "| variometer: baro.lag | baro, 2 s |" in text
    assert "| variometer: baro.lag | mag, 2 s |" in text


@pytest.mark.measured
def test_the_tracer_before_both_halves(measured_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A flight of the course: what a report says is what is asked of it."""
    if "SINAN_DATA" not in os.environ:
        monkeypatch.setenv("SINAN_DATA", str(measured_data))
    asked = Halves("course, quadrotor", 60.0, tmp_path)
    assert all(report["candidates"] and report["verdict"] != "refused" for report in asked.reports)
    assert all(isinstance(row, Replicated) for row in replicated(asked.log, asked.reports))
    assert "1 logs, of each at most its liveliest 60 s" in prediction.main(
        ["course, quadrotor", "--longest", "60", "--keep", str(tmp_path)]
    )
