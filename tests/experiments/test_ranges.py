"""`sinan ranges`: errors over age as theory says, files that `sinan gnss` reads, scenarios that say what is wrong."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sinan.experiments.commands.ranges import run, summary
from sinan.experiments.gnss import link_study, simulated
from sinan.experiments.gnss.base import differential
from sinan.experiments.gnss.codes import classes, measured
from sinan.experiments.gnss.study import usable_ranges
from sinan.sensors.data_link import DataLink
from sinan.sensors.errors import InputError
from sinan.sensors.formats.rinex import read_navigation

TEN_PER_CENT = 0.1
MASK = float(np.deg2rad(10.0))


def test_the_error_of_every_age_is_what_the_autocovariances_say() -> None:
    """Nothing is fitted: 30 minutes of degraded clocks, five satellites and more, with and without the rate."""
    told = link_study.study(simulated.load("degraded_clocks"), 1, (0.0, 5.0, 20.0, 60.0))
    for entry in told["ages"]:
        for kind in ("with_rate", "without_rate"):
            assert entry[kind]["range"] == pytest.approx(entry[kind]["range_expected"], rel=TEN_PER_CENT)
            assert entry[kind]["position"] == pytest.approx(entry[kind]["position_expected"], rel=0.2)
    assert told["ages"][-1]["with_rate"]["range"] > 5.0 * told["ages"][0]["with_rate"]["range"]
    assert told["link"]["position_error"]["rms"] < 0.1 * told["alone"]["rms"]
    assert told["link"]["age"]["mean"] == pytest.approx(told["link"]["expected_age"], rel=TEN_PER_CENT)


def test_the_p_code_is_nearer_than_the_c_a_code_and_the_course_ten_times() -> None:
    short = {name: replace(simulated.load(name), seconds=200.0) for name in ("course_ca", "course_p")}
    found = {name: link_study.study(one, 2, (0.0,)) for name, one in short.items()}
    ratio = [one["ages"][0]["with_rate"]["range"] for one in found.values()]
    assert ratio[0] / ratio[1] == pytest.approx(10.0, rel=TEN_PER_CENT)


@pytest.mark.parametrize("name", simulated.scenario_names())
def test_every_scenario_is_written_and_read_again(tmp_path: Path, name: str) -> None:
    scenario = replace(simulated.load(name), seconds=20.0)
    found = simulated.simulate(scenario, 3)
    simulated.write(found, tmp_path)
    code = simulated.code_of(scenario.rover)
    ranges = usable_ranges(tmp_path / "rover.obs", read_navigation(tmp_path / "broadcast.nav"), "G", code)
    ours = found.ranges()[0]
    np.testing.assert_array_equal(ranges.satellite, ours.satellite)
    np.testing.assert_allclose(ranges.value, ours.value, atol=1e-3)
    np.testing.assert_allclose(ranges.position, ours.position, atol=1e-2)  # 13 digits of a message
    moved = np.linalg.norm(np.diff(found.position, axis=0), axis=1)
    np.testing.assert_allclose(moved, scenario.speed, rtol=1e-3, atol=1e-9)


def test_the_command_writes_page_and_numbers(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text('like = "moving_ca"\nseconds = 90\n[link]\nwindow = 5.0\n[rover]\nrate = 2.0\n')
    text = run(str(own), tmp_path / "files", 0, tmp_path / "r.json", tmp_path / "r.html")
    told = json.loads((tmp_path / "r.json").read_text())
    assert told["epochs"] == 181
    assert summary(told) in text
    assert "sinan gnss" in text
    assert "held without it" in (tmp_path / "r.html").read_text()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('like = "static_ca"\nseconds = 9000\n', "seconds"),
        ('like = "static_ca"\n[rover]\nreceiver = "y"\n', "course_ca"),
        ('like = "static_ca"\n[rover]\nspeeed = 3\n', "speeed"),
        ('like = "nothing"\n', "another scenario"),
        ("seconds = 9\n", "origin"),
    ],
)
def test_a_scenario_says_what_is_wrong_with_it(tmp_path: Path, text: str, expected: str) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=expected):
        simulated.load(str(path))


@pytest.mark.measured
def test_both_codes_of_measured_receivers_are_solved(measured_data: Path) -> None:
    """Metres from known places; the two codes of one receiver agree better than either with the truth's frame."""
    rows = {(row.what, row.code): row for row in measured(measured_data / "gnss")}
    assert {code for what, code in rows if what.startswith(("esbjerg", "kamakura"))} == {"C1C", "C1W", "C1W+C2W"}
    assert {code for what, code in rows if what.startswith("ohio")} == {"C1C", "C2W"}
    assert rows["esbjerg_static_2020", "C1W"].position_rms < rows["esbjerg_static_2020", "C1C"].position_rms < 1.5
    assert max(row.position_rms for row in rows.values()) < 8.0


def test_every_class_of_receivers_has_the_error_that_it_declares() -> None:
    """300 s: five independent slow errors of each satellite, and seven satellites; a third of it either way."""
    for row in classes(1, 300.0):
        assert row.range_error == pytest.approx(row.expected, rel=0.33)


def test_old_corrections_weigh_as_little_as_the_base_has_found_them_wrong() -> None:
    """Degraded clocks, 20 s late: what is left of the ranges is as large as is told, and hardly a satellite at fault.

    With the variance of a fresh correction the squares are 2.3 times that, and a fifth of the rows is taken out.
    """
    found = simulated.simulate(replace(simulated.load("degraded_clocks"), seconds=900.0), 3)
    fixes = differential(*found.ranges(), found.base_position, found.navigation, MASK, DataLink(delay=20.0)).location
    rows = int(fixes.fixes.used.sum())
    spare = rows - 4 * int(fixes.fixes.solved.sum())
    assert float(np.nansum(fixes.fixes.sse)) / spare == pytest.approx(1.0, abs=0.2)
    assert int(fixes.excluded.sum()) < 0.01 * rows
