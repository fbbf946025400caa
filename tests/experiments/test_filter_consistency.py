"""The filter tells the truth about itself: short forms of the studies, and flaws that they see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from sinan.experiments.commands.estimate import run as estimate
from sinan.experiments.filter_consistency import errors, flights, heading
from sinan.experiments.filter_consistency.__main__ import main
from sinan.experiments.filter_consistency.scenarios import matched_scenarios, other_scenarios, why_not
from sinan.experiments.monte_carlo.one_flight import fly
from sinan.experiments.monte_carlo.study import run
from sinan.experiments.scenarios import load_scenario, scenario_names, simulate_to_folder
from sinan.sensors.errors import InputError
from sinan.sensors.manoeuvres import Manoeuvre
from sinan.sensors.recording import Recording, Stream
from sinan.sensors.scenario import Scenario
from sinan.sensors.simulate import simulate

LEVEL = 1e-3  # false alarm of each test, with fixed seeds


def short(name: str = "aerobatics", seconds: float = 24.0) -> Scenario:
    """A shaken flight at 100 Hz, with its sensors' noise."""
    scenario = load_scenario(name).with_imu_rate(100.0)
    manoeuvre = Manoeuvre("shake", seconds, {"north": 3.0, "east": 2.5, "up": 1.5, "yaw": 60.0})
    return scenario.replace(name="short", manoeuvres=(manoeuvre,))


@pytest.fixture(scope="module")
def clean() -> list[flights.Scored]:
    return flights.fly(32, seed=3, scenarios={"short": short()})


def test_p_values_of_every_effect_are_uniform(clean: list[flights.Scored]) -> None:
    table = flights.uniformity(clean)
    assert len(table) > 30
    worst = min(table, key=lambda name: table[name]["p_value"])
    assert table[worst]["p_value"] > LEVEL / len(table), worst


def chi_square_p(scored: list[flights.Scored]) -> float:
    """P-value that the statistics have their mean; effects share readings, so one average a flight is one draw."""
    averages = [sum(e[0] for e in f.effects.values()) / sum(e[1] for e in f.effects.values()) for f in scored]
    return float(stats.ttest_1samp(averages, 1.0).pvalue)


def test_statistics_are_chi_square_all_together(clean: list[flights.Scored]) -> None:
    assert chi_square_p(clean) > LEVEL


def test_nis_of_every_sensor_is_one(clean: list[flights.Scored]) -> None:
    for name, entry in flights.nis_table(clean).items():
        low, high = entry["family_interval"]
        assert low <= entry["mean_per_dof"] <= high, name


def test_no_flight_is_blamed_for_an_effect(clean: list[flights.Scored]) -> None:
    """At 1 % family-wise, four alarms in 32 flights would happen once in a thousand times."""
    assert flights.false_alarms(clean) < 4


def coarser_start(recording: Recording) -> Recording:
    """Declares the first attitude twenty times better than it is known."""
    assert recording.initial.attitude_std is not None
    return recording.replace(initial=replace(recording.initial, attitude_std=0.05 * recording.initial.attitude_std))


def noisier_magnetometer(recording: Recording) -> Recording:
    """Declares half of the magnetometer's noise."""
    spec = recording.spec("mag")
    assert spec.noise_std is not None
    return recording.replace(sensors={**recording.sensors, "mag": replace(spec, noise_std=0.5 * spec.noise_std)})


def flown_with(
    flaw: Callable[[Recording], Recording], monkeypatch: pytest.MonkeyPatch, count: int
) -> list[flights.Scored]:
    def flawed(scenario: Scenario, rng: np.random.Generator) -> tuple[Recording, Stream]:
        recording, truth = simulate(scenario, rng)
        return flaw(recording), truth

    monkeypatch.setattr("sinan.experiments.filter_consistency.flights.simulate", flawed)
    return flights.fly(count, seed=4, scenarios={"short": short()})


def test_a_start_that_is_boasted_of_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """NIS does not show it; two alarms in twelve flights would happen once in 160 times by chance."""
    assert flights.false_alarms(flown_with(coarser_start, monkeypatch, 12)) >= 2


def test_noise_that_is_boasted_of_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """The scatter takes it off the p-values; the NIS shows it."""
    assert not flights.nis_table(flown_with(noisier_magnetometer, monkeypatch, 2))["mag"]["within"]


def test_every_scenario_is_matched_or_says_why_not() -> None:
    assert set(matched_scenarios()) | set(other_scenarios()) == set(scenario_names())
    assert why_not(load_scenario("no_aiding")) is not None
    assert why_not(load_scenario("yaw_turns")) is None


def test_a_heading_off_by_half_a_circle_is_cured() -> None:
    rows = heading.study(3, seed=6, sigmas=(90.0,))["rows"]
    plain, cured = (row["overall"]["mean_per_dof"] for row in rows)
    low, high = rows[1]["overall"]["family_interval"]
    assert plain > high
    assert low <= cured <= high


def test_averages_beyond_their_interval_are_named() -> None:
    entry = {"scenario": "a", "relinearised": False, "outside": None, "overall": (2200.0, 2200), "blocks": {}}
    found = errors.judged({"rows": [{**entry, "blocks": {"b_gyro": (450.0, 300), "position": (300.0, 300)}}]})
    assert found["beyond"] == ["a, gyro bias: 1.500"]
    assert found["tests"] == 3


def test_the_command_prints_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    document = main(["flights", "--runs", "1"])
    assert "| mag | 1 |" in capsys.readouterr().out
    assert document["flights"] == 1


def test_estimate_offers_the_cure_and_takes_it(tmp_path: Path) -> None:
    simulate_to_folder("no_aiding", tmp_path / "log", seed=3)
    plain, cured = (
        estimate(str(tmp_path / "log"), "numba", None, None, None, None, option) for option in (False, True)
    )
    assert "compare --relinearise" in plain
    assert "--relinearise" not in cured


def test_monte_carlo_takes_the_cure_and_keeps_its_runs_apart(tmp_path: Path) -> None:
    result = run(short(seconds=6.0), 2, workers=1, resume=tmp_path, relinearise=True)
    assert result.flights[1] == fly(short(seconds=6.0), 0, 1, relinearise=True)
    with pytest.raises(InputError, match="another relinearise"):
        run(short(seconds=6.0), 2, workers=1, resume=tmp_path)
