"""What is written of measured logs: both engines, withheld fixes of a traced flight, the gallery and the table."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sinan.calibration.levels.preparation import prepared
from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.evidence.term import Term
from sinan.estimator.filter.flight import Flight
from sinan.experiments.datasets import resolve
from sinan.experiments.measured import engines, flights, gallery, table
from sinan.experiments.measured.engines import AGREEMENT, Agreement, agreement, difference, shortened
from sinan.experiments.measured.flights import LOGS, predictions
from sinan.experiments.measured.gallery_page import block, blocks_of, page
from sinan.experiments.measured.published import PUBLISHED
from sinan.experiments.measured.scoring import withheld_errors
from sinan.experiments.residual_loop.open_flight import flight_source
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.simulate import simulate

#: Logs of every trio of sensors, short, and how much of them is run on both engines [s].
SHORT = {"course, quadrotor": 5.0, "robot, LSM9DS0": 5.0, "variometer": 3.0, "PX4, IMU at 10 Hz": 30.0}
PER_CENT = 0.01


@pytest.fixture
def data(measured_data: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    if "SINAN_DATA" not in os.environ:
        monkeypatch.setenv("SINAN_DATA", str(measured_data))
    return measured_data


@pytest.mark.measured
@pytest.mark.parametrize("name", SHORT)
def test_engines_agree_on_measured_logs(data: Path, name: str) -> None:
    """At every step, states and sigmas, with no gate deciding differently; `experiments.measured.table`: whole logs."""
    found = agreement(prepared(shortened(resolve(LOGS[name]), SHORT[name])))
    assert found.gates == 0
    assert found.difference < AGREEMENT


def test_a_difference_of_engines_is_seen() -> None:
    recording, _ = simulate(load_scenario("hover"), np.random.default_rng(1))
    ready = prepared(shortened(recording, 2.0))
    one, other = ready.run(), ready.run()
    other.imu_var[10] *= 1.0 + 1e-7
    assert difference(one, one) == 0.0
    assert difference(one, other) > AGREEMENT


def test_withheld_fixes_of_a_source_are_those_of_a_thinned_log() -> None:
    """A fix that is refused and one that is not there are the same to the filter."""
    recording, _ = simulate(load_scenario("figure_eight"), np.random.default_rng(9))
    source = flight_source(recording)
    plain = withheld_errors(source, source.fit(()))
    thinned = {p.age: p.rms for p in predictions(prepared(source.recording))}
    assert thinned.keys() == plain.keys()
    assert all(plain[age] == pytest.approx(thinned[age], rel=PER_CENT) for age in plain)


def test_the_right_effect_predicts_withheld_fixes() -> None:
    """A GPS that is 0.3 s late: with its delay in the model, what is left is the noise of the fixes, 0.9 m."""
    recording, _ = simulate(load_scenario("figure_eight"), np.random.default_rng(3), {"gps.latency": [0.3]})
    source = flight_source(recording, slow_gps=False)  # which would take a part of it for an error of its own
    plain, known = (withheld_errors(source, source.fit(terms)) for terms in ((), [Term("gps.latency")]))
    assert plain[10.0] > 3.0
    assert known[10.0] < 1.5


def test_withheld_fixes_are_in_no_pass_of_a_coarse_start() -> None:
    """A first pass that took them would follow them; readings linear about the smoothed motion predict as others do."""
    recording, _ = simulate(load_scenario("figure_eight"), np.random.default_rng(9))
    term = Term("accel.scale_nonlinearity")
    by_start = []
    for coarse in (False, True):
        source = FlightSource(Flight.of(recording, relinearise=coarse))
        fit = replace(source.fit(()), terms=(term,), beta={term: np.array([-0.0014, -0.0001, -0.0072])})
        by_start.append(withheld_errors(source, fit))
    assert by_start[1] == pytest.approx(by_start[0], rel=2.0 * PER_CENT)


@pytest.mark.measured
def test_gallery_finds_what_was_published(data: Path) -> None:
    found = gallery.find("MPU-9150 0, accelerometer")
    assert [effect["name"] for effect in found.document["effects"]] == ["accel.cross_axis"]
    apart = [float(word) for word in found.known_otherwise.split("found ")[1].split(" sigma")[0].split(", ")]
    assert max(abs(a) for a in apart) < 4.0
    text = page([block(found)])
    assert blocks_of(text) == {found.name: block(found)}
    assert page(blocks_of(text).values()) == text
    assert "`sinan trace mpu9150_imu_calib/imu0.log --sensor accel`" in text
    assert "| MPU-9150 0, accelerometer | effects | accel.cross_axis |" in text


@pytest.mark.measured
@pytest.mark.parametrize(("log", "sensor"), list(PUBLISHED))
def test_published_calibrations_make_the_norm_constant(data: Path, log: str, sensor: str) -> None:
    """To what they leave on these readings: a unit or a sign that is wrong spreads it over tens of per cent."""
    from sinan.experiments.residual_loop.open_source import triad_readings

    readings = triad_readings(resolve(log), sensor)
    raw = readings.reading * readings.normalised_by
    spread = np.linalg.norm(raw - raw.mean(axis=0), axis=1)
    for one in PUBLISHED[log, sensor]:
        assert one.spread(raw) < 0.5 * np.std(spread) / np.mean(spread)
        assert one.spread(raw) < 0.07


@pytest.mark.measured
def test_table_of_a_short_log(data: Path, tmp_path: Path) -> None:
    out = tmp_path / "table.md"
    assert table.main([str(out), "course, quadrotor"]) == 0
    assert "| course, quadrotor | 31 s | imu 250 | roll, pitch of the autopilot's own estimate |" in out.read_text()


def test_names_that_are_no_log_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert gallery.main([str(tmp_path / "x.md"), "nothing"]) == 2
    assert table.main([]) == 2
    assert flights.main(["nothing"]) == 2
    assert engines.main(["nothing"]) == 2
    assert capsys.readouterr().err.count("with names of ") == 4
    assert not (tmp_path / "x.md").exists()


def test_agreement_wants_both() -> None:
    assert Agreement(1, 1, 1e-12, 0, (1.0, 1.0)).holds
    assert not Agreement(1, 1, 1e-12, 1, (1.0, 1.0)).holds
    assert not Agreement(1, 1, 1e-6, 0, (1.0, 1.0)).holds


@pytest.mark.parametrize("given", [[], ["--help"], ["page.md", "no such log"]])
def test_a_command_that_names_no_page_or_log_says_what_it_takes(
    given: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert gallery.main(given) == 2
    assert capsys.readouterr().err.startswith("usage: OUT.md [NAME ...]")
    assert not list(tmp_path.iterdir())
