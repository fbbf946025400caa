"""`sinan.testing`: each assertion passes where all is well and says what is wrong where it is not."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import sinan
from sinan.sensors.arrays import FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.recording import NO_HEIGHT, Stream
from sinan.testing import Bounds, assert_consistent, assert_jacobian, assert_journal_equal, journal_text
from sinan.testing.journals import changes

ROOT = Path(__file__).resolve().parents[2]
GUIDE = ROOT / "docs" / "testing_a_model.md"


class WrongSign:
    """A barometer whose Jacobian points down."""

    plain = sinan.Barometer(0.3, 2.0)
    name, size, R, bias = "baro", 1, plain.R, plain.bias

    def predict(self, motion: Motion) -> FloatArray:
        return self.plain.predict(motion)

    def jacobian(self, motion: Motion) -> dict[str, FloatArray]:
        return {name: -H for name, H in self.plain.jacobian(motion).items()}


@pytest.fixture(scope="module")
def estimates() -> list[sinan.Estimate]:
    return [sinan.estimate(sinan.simulate("square", seed=seed)) for seed in range(3)]


def test_a_wrong_sign_is_named_with_its_axis() -> None:
    with pytest.raises(AssertionError, match=r"d reading\[0\] / d position down .* says 1, .* say -1"):
        assert_jacobian(WrongSign())


def test_a_block_that_is_left_out_has_to_be_zero() -> None:
    wrong = WrongSign()
    wrong.jacobian = lambda motion: {}  # type: ignore[method-assign]
    with pytest.raises(AssertionError, match="says nothing, which is 0"):
        assert_jacobian(wrong)


def test_a_filter_that_is_right_is_consistent(estimates: list[sinan.Estimate]) -> None:
    assert_consistent(estimates)


def test_a_filter_that_believes_too_much_is_not() -> None:
    """It takes half the noise of the barometer for all of it."""
    flight = sinan.simulate("square", seed=1)
    spec = flight.sensors["baro"]
    assert spec.noise_std is not None
    doubtful = flight.replace(sensors={**flight.sensors, "baro": replace(spec, noise_std=0.5 * spec.noise_std)})
    with pytest.raises(AssertionError, match=r"NIS of baro: .* larger than the filter expects") as raised:
        assert_consistent(sinan.estimate(doubtful))
    assert "NIS of gps" not in str(raised.value)


def test_a_height_that_a_fix_does_not_tell_is_no_degree_of_freedom() -> None:
    """Every second fix is two-dimensional."""
    found = []
    for seed in range(2):
        flight = sinan.simulate("square", seed=seed)
        gps = flight.streams["gps"]
        epv = np.where(np.arange(len(gps)) % 2 == 0, NO_HEIGHT, 0.5)
        fixes = Stream(gps.t, {**gps.columns, "epv": epv})
        found.append(sinan.estimate(flight.replace(streams={**flight.streams, "gps": fixes})))
    assert_consistent(found)


def test_a_truth_that_does_not_know_a_state_is_named() -> None:
    flight = sinan.simulate("square", seed=1)
    coloured = replace(flight.sensors["gps"], colour_std=0.5, colour_time=20.0)
    estimate = sinan.estimate(flight.replace(sensors={**flight.sensors, "gps": coloured}))
    with pytest.raises(ValueError, match="the truth does not know c_gps"):
        assert_consistent(estimate)


def test_consistency_needs_a_truth() -> None:
    flight = sinan.simulate("square", seed=1).replace(truth=None)
    with pytest.raises(ValueError, match="states=False"):
        assert_consistent(sinan.estimate(flight))
    with pytest.raises(ValueError, match="empty"):
        assert_consistent([])


def test_a_journal_equals_its_own_text(estimates: list[sinan.Estimate], tmp_path: Path) -> None:
    file = tmp_path / "kept.txt"
    file.write_text(journal_text(estimates[0]))
    assert_journal_equal(estimates[0], file)


def test_another_flight_is_another_journal(estimates: list[sinan.Estimate]) -> None:
    with pytest.raises(AssertionError, match=r"baro: from 0 s on"):
        assert_journal_equal(estimates[0], journal_text(estimates[1]))


KEPT = "0 sensor baro used 5 refused 0 nis 1.0000 nu +0.1000\n0 state b_baro +1.5 sigma 0.1\n"
CHANGED = {
    "innovation": ("nu +0.1000", "nu +0.1020", "baro: at 0 s; most at 0 s: nu 0.1 -> 0.102, 2 times"),
    "refused": ("refused 0", "refused 1", "baro: at 0 s; most at 0 s: refused 0 -> 1"),
    "state": ("+1.5", "+1.5003", "b_baro: at 0 s; most at 0 s: value 1.5 -> 1.5003, 3 times"),
    "sigma": ("sigma 0.1", "sigma 0.11", "b_baro: at 0 s; most at 0 s: sigma 0.1 -> 0.11, 100 times"),
    "gone": ("sensor baro", "sensor sonar", "baro (sensor): gone from 0 s on"),
    "not a number": ("nis 1.0000", "nis nan", "baro: at 0 s; most at 0 s: nis 1 -> nan"),
}


@pytest.mark.parametrize(("old", "new", "said"), CHANGED.values(), ids=CHANGED.keys())
def test_what_changed_is_said_by_sensor_and_second(old: str, new: str, said: str) -> None:
    assert changes(KEPT, KEPT, Bounds()) == []
    assert changes(KEPT, KEPT.replace(old, new), Bounds())[0].startswith(said)


def test_what_is_within_the_bounds_is_no_change() -> None:
    assert changes(KEPT, KEPT.replace("+1.5", "+1.50009"), Bounds()) == []
    assert changes(KEPT, KEPT.replace("+1.5", "+1.5003"), Bounds(state=0.01)) == []


def run_pytest(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "sinan.testing.plugin", "-p", "no:cacheprovider", *options]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_the_worked_example_runs_to_the_letter(tmp_path: Path) -> None:
    text = GUIDE.read_text(encoding="utf-8")
    files = dict(re.findall(r"^`(\w+\.py)`:\n\n```python\n(.*?)```", text, re.DOTALL | re.MULTILINE))
    assert list(files) == ["boom.py", "test_boom.py"]
    for name, code in files.items():
        (tmp_path / name).write_text(code)
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    without = run_pytest(tmp_path, "-k", "journal")
    assert "run once with --sinan-update" in without.stdout
    kept = run_pytest(tmp_path, "--sinan-update")
    assert kept.returncode == 0, kept.stdout
    journal = (tmp_path / "journals" / "test_the_journal_is_as_it_was.txt").read_text()
    shown = re.findall(r"^0 (?:sensor|state) .*$", text, re.MULTILINE)
    beside = [line for line in journal.splitlines() if line.split()[:3] in [row.split()[:3] for row in shown]]
    assert len(shown) == len(beside) == 2
    assert changes("\n".join(shown), "\n".join(beside), Bounds()) == []
    wrong = files["test_boom.py"].replace("estimated(1))", "estimated(1, sigma=0.15))")
    (tmp_path / "test_boom.py").write_text(wrong)
    changed = run_pytest(tmp_path, "-k", "journal")
    assert changed.returncode == 1
    for since in re.findall(r"^  (b?_?baro: from .*?;)", text, re.MULTILINE):
        assert since in changed.stdout
    assert "if that is meant: --sinan-update" in changed.stdout
