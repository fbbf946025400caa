"""An effect of one's own: in a script, in a file of the command line and its workers, in a package."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

import sinan
from sinan.experiments.workers.processes import in_processes
from sinan.sensors.effects import own
from sinan.sensors.effects.declaration import Effect
from sinan.sensors.errors import InputError
from sinan.sensors.motion import Motion
from tests.estimator.analytic_flight import analytic_motion

ROOT = Path(__file__).resolve().parents[2]
FILE = '''
import sinan

@sinan.effect("mag.supply", parameters={"b": ("1/A", 0.01)}, needs=["current"], kinds=["poses"])
def supply(motion):
    """A lead beside the magnetometer's x axis."""
    import numpy as np
    return np.stack([motion.covariates["current"], 0 * motion.t, 0 * motion.t], axis=1)[:, :, None]
'''


def one(motion: Motion) -> np.ndarray:
    """The barometer reads a metre too much for each of beta."""
    return np.ones((len(motion), 1, 1))


@pytest.fixture(autouse=True)
def _forgotten(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv(own.VARIABLE, "")
    yield
    for name in list(own._OWN):
        own.remove(name)
    own._READ.clear()


def declared(name: str, **options: object) -> Effect:
    return sinan.effect(name, one, parameters={"b": ("m", 1.0)}, **options)  # type: ignore[arg-type, return-value]


def test_a_declared_effect_is_simulated_and_gone_when_it_is_removed() -> None:
    declared("baro.offset")
    plain = sinan.simulate("hover", seed=2).streams["baro"]["height"]
    shifted = sinan.simulate("hover", seed=2, effects={"baro.offset": 1.5}).streams["baro"]["height"]
    assert shifted - plain == pytest.approx(1.5)
    own.remove("baro.offset")
    assert "baro.offset" not in sinan.effects


def test_its_words_are_those_of_its_function() -> None:
    assert declared("baro.offset").summary == one.__doc__


WRONG: dict[str, tuple[str, dict[str, object], str]] = {
    "taken": ("baro.scale", {}, "taken"),
    "no sensor": ("barometer.offset", {}, "baro"),
    "no word": ("baro", {}, "SENSOR.WORD"),
    "unknown need": ("baro.offset", {"needs": ["moon"]}, "moon"),
    "unknown kind": ("baro.offset", {"kinds": ["dives"]}, "dives"),
}


@pytest.mark.parametrize(("name", "options", "said"), WRONG.values(), ids=WRONG.keys())
def test_what_cannot_be_declared_is_said(name: str, options: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        declared(name, **options)


def test_a_regressor_of_another_shape_is_said() -> None:
    flat = replace(declared("baro.offset"), regressor=lambda motion: np.ones(len(motion)))
    motion = analytic_motion(np.array([1.0, 2.0]))
    with pytest.raises(InputError, match=r"shape \(2,\); expected \(2, 1 or 1, 1\)"):
        flat.rows(motion, 1)


def test_parameters_have_a_unit_and_a_size() -> None:
    with pytest.raises(InputError, match="unit and a plausible"):
        sinan.effect("baro.offset", one, parameters={"b": "m"})  # type: ignore[dict-item]
    with pytest.raises(InputError, match="plausible size"):
        sinan.effect("baro.offset", one, parameters={"b": ("m", 0.0)})


def test_the_command_line_takes_a_file(tmp_path: Path) -> None:
    (tmp_path / "lead.py").write_text(FILE)
    run = [sys.executable, "-m", "sinan"]
    options = ["--effect", "mag.supply=0.02", "--effects", "lead.py", "--seed", "3"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [*run, "simulate", "mag_poses", "poses", *options],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    listed = subprocess.run(
        [*run, "effects", "mag.supply", "--effects", "lead.py"], cwd=tmp_path, env=environment, capture_output=True,
        text=True, check=True,
    )  # fmt: skip
    assert "A lead beside the magnetometer's x axis." in listed.stdout
    assert "lead.py" in listed.stdout


def size_of(name: str) -> int:
    """Parameters of an effect, as a worker knows it."""
    return sinan.effects[name].size


def test_workers_know_the_effects_of_a_file(tmp_path: Path) -> None:
    found: list[int] = []
    in_processes(size_of, ["mag.current"], 1, lambda _, size: found.clear())  # one was at work before
    (tmp_path / "lead.py").write_text(FILE)
    assert own.read_file(tmp_path / "lead.py") == ("mag.supply",)
    in_processes(size_of, ["mag.supply", "mag.supply"], 2, lambda _, size: found.append(size))
    assert found == [1, 1]


def test_a_file_has_the_same_names_when_it_is_read_again(tmp_path: Path) -> None:
    file = tmp_path / "lead.py"
    file.write_text(FILE)
    found = [own.read_file(file), own.read_file(file)]
    file.write_text(FILE + "\n")
    assert [*found, own.read_file(file)] == 3 * [("mag.supply",)]


@pytest.mark.parametrize(
    ("text", "said"), [("x = 1", "no effect"), ("1 / 0", "ZeroDivisionError"), (None, "No such file")]
)
def test_a_file_that_declares_nothing_says_so(tmp_path: Path, text: str | None, said: str) -> None:
    file = tmp_path / "mine.py"
    if text is not None:
        file.write_text(text)
    with pytest.raises(InputError, match=said):
        own.read_file(file)


def test_a_package_brings_effects_by_an_entry_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "canopy_of_a_package.py").write_text(FILE)
    monkeypatch.syspath_prepend(tmp_path)
    point = EntryPoint("canopy", "canopy_of_a_package:supply", own.GROUP)
    monkeypatch.setattr(own, "entry_points", lambda group: [point] if group == own.GROUP else [])
    monkeypatch.setattr(own, "_packages_read", False)
    assert "mag.supply" in sinan.effects


def test_a_package_without_effects_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(own, "entry_points", lambda group: [EntryPoint("broken", "os:sep", group)])
    monkeypatch.setattr(own, "_packages_read", False)
    with pytest.raises(InputError, match=r"broken.*Effect"):
        list(sinan.effects)
    monkeypatch.setattr(own, "_packages_read", True)
