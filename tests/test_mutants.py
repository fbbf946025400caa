"""The mutants of the sensor models: made as they should be, and a sample of them killed; `tests/mutants.py` has all."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests import mutants

SAMPLE, SEED = 12, 1
SOURCE = '''
def height(slant: FloatArray, roll: FloatArray, bias: float = 0.5) -> FloatArray:
    """No word of this is one of the model's: 1.0 + 2.0."""
    if not slant.size or roll > 1.5:
        raise ValueError(f"{roll + 1.0} is too much")
    slant[roll < 0.0] = bias
    return slant * np.cos(roll) - bias
'''


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """What is tried of `SOURCE`."""
    (tmp_path / "height.py").write_text(SOURCE)
    monkeypatch.setattr(mutants, "file_of", lambda model: tmp_path / f"{model}.py")
    return {mutant.what for mutant in mutants.mutants("height")}


def test_each_term_is_dropped_and_each_sign_turned(made: set[str]) -> None:
    whole = "slant * np.cos(roll) - bias"
    assert {f"{whole} -> {left}" for left in ("slant * np.cos(roll)", "-bias", "slant * np.cos(roll) + bias")} <= made
    assert {f"slant * np.cos(roll) -> {left}" for left in ("slant", "np.cos(roll)")} <= made
    assert f"return {whole} -> return -({whole})" in made
    assert any(what.startswith("0.5 -> -0.5 in ") for what in made)


def test_each_condition_is_taken_out_and_each_function_changed(made: set[str]) -> None:
    assert {"if not slant.size or roll > 1.5 -> if True", "if not slant.size or roll > 1.5 -> if False"} <= made
    assert {"not slant.size or roll > 1.5 -> roll > 1.5", "not slant.size or roll > 1.5 -> not slant.size"} <= made
    assert {"roll > 1.5 -> roll <= 1.5", "not slant.size -> slant.size", "roll < 0.0 -> roll >= 0.0"} <= made
    assert {"slant[roll < 0.0] = bias -> pass", "slant[roll < 0.0] = bias -> slant[roll < 0.0] = -bias"} <= made
    assert "np.cos(roll) -> np.sin(roll)" in made


def test_texts_annotations_and_errors_are_left_alone(made: set[str]) -> None:
    changed = {what.split(" in ")[0] for what in made}
    assert not any(word in what for what in changed for word in ("ValueError", "2.0", "FloatArray", "roll + 1.0"))


def test_a_mutant_has_its_one_mistake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "height.py").write_text("def height(a: float, b: float) -> float:\n    return a + b * a\n")
    monkeypatch.setattr(mutants, "file_of", lambda model: tmp_path / f"{model}.py")
    found = {}
    for mutant in mutants.mutants("height"):
        names: dict[str, object] = {}
        exec(compile(mutant.tree(), "height", "exec"), names)
        found[mutant.what] = names["height"](3.0, 5.0)  # type: ignore[operator]
    assert found == {
        "return a + b * a -> return -(a + b * a)": -18.0,
        "a + b * a -> a": 3.0,
        "a + b * a -> b * a": 15.0,
        "a + b * a -> a - b * a": -12.0,
        "b * a -> b": 8.0,
        "b * a -> a": 6.0,
    }


def test_what_is_named_the_same_model_is_among_the_mutants() -> None:
    """With a reason; one whose model has changed since is named no longer."""
    tried = {mutant.name for model in mutants.TARGETS for mutant in mutants.mutants(model)}
    same = mutants.equivalents()
    assert not set(same) - tried
    assert all(len(why) > 10 for why in same.values())


def test_every_sensor_has_its_mutants() -> None:
    folder = mutants.ROOT / "sensors"
    with_a_model = {path.stem for path in folder.glob("*.py") if "def predict(self, motion" in path.read_text()}
    assert with_a_model - {"model"} <= set(mutants.TARGETS)
    assert all(mutants.mutants(model) for model in mutants.TARGETS)
    assert all((mutants.ROOT / test).is_file() for tests in mutants.TARGETS.values() for test in tests)


def test_a_sample_of_the_mutants_is_killed() -> None:
    """The pseudoranges' tests take seconds each, so few of theirs are among them."""
    models = [model for model in mutants.TARGETS if model not in ("pseudorange", "dgps")]
    command = [sys.executable, "-m", "tests.mutants", *models, "--sample", str(SAMPLE), "--seed", str(SEED)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=600, cwd=mutants.ROOT, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    assert f"| all | {SAMPLE} |" in result.stdout


def test_a_mutant_that_lives_is_said() -> None:
    """The laser's tests do not look at the barometer: on it alone every mutant lives."""
    code = (
        "from tests import mutants\n"
        "mutants.TARGETS['barometer'] = ('tests/sensors/test_laser.py',)\n"
        "raise SystemExit(mutants.main(['barometer', '--sample', '2']))"
    )
    command = [sys.executable, "-c", code]
    result = subprocess.run(command, capture_output=True, text=True, timeout=600, cwd=mutants.ROOT, check=False)
    assert result.returncode == 1, result.stderr
    assert result.stdout.count("alive: sensors/barometer.py:") == 2
