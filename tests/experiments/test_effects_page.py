"""The effects as a page and as a command: both come from the declarations and from nowhere else."""

from __future__ import annotations

import subprocess
import sys

import pytest
from typer.testing import CliRunner

from sinan.experiments import effects_page
from sinan.experiments.commands.cli import app
from sinan.experiments.commands.effects import run
from sinan.experiments.scenarios import scenario_names
from sinan.sensors.effects import CATALOGUE
from sinan.sensors.errors import InputError

HEAVY = ("numba", "scipy", "pandas", "matplotlib")


def test_the_page_is_what_its_script_makes() -> None:
    kept = effects_page.PAGE.read_text(encoding="utf-8")
    assert kept == effects_page.page(), "a declaration has changed: python -m sinan.experiments.effects_page"


@pytest.mark.parametrize("name", CATALOGUE)
def test_an_effect_is_described_in_full(name: str) -> None:
    found, effect = dict(effects_page.facts(CATALOGUE[name])), CATALOGUE[name]
    assert effect.enters in found["enters"]
    assert all(p.name in found["beta"] and p.unit in found["beta"] for p in effect.parameters)
    assert f"{effect.parameters[0].plausible:g}" in found["beta"]
    assert found["source"] == effect.source


@pytest.mark.parametrize("name", [n for n in CATALOGUE if not n.startswith(("pseudorange.", "camera."))])
def test_the_scenario_that_shows_it_exists(name: str) -> None:
    assert CATALOGUE[name].scenario in scenario_names()


def test_one_effect_by_name() -> None:
    text = run("mag.current")
    assert text.startswith("mag.current\nThe magnetometer reads the motor current.")
    assert "enters        B += b I" in text


def test_one_sensor_by_name() -> None:
    assert [line.split()[0] for line in run("sonar").splitlines()][:2] == ["sonar.sound_speed", "sonar.mount_offset"]


def test_all_effects_are_listed() -> None:
    listed = [line.split()[0] for line in run(None).splitlines() if line]
    assert sorted(listed) == sorted(CATALOGUE)


def test_unknown_name_is_told_the_nearest() -> None:
    with pytest.raises(InputError, match=r"no effect `baro.lagg`.*baro\.lag"):
        run("baro.lagg")


def test_the_command_prints_it() -> None:
    result = CliRunner().invoke(app, ["effects", "gps.latency"])
    assert result.exit_code == 0
    assert "The GPS reports late." in result.stdout


def test_the_command_is_light() -> None:
    code = f"import sys; from sinan.experiments.commands.effects import run; run(None); run('baro.lag'); \
assert not [m for m in {HEAVY} if m in sys.modules]"
    subprocess.run([sys.executable, "-c", code], check=True)
