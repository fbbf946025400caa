"""`import sinan`: what it loads, that it is documented, and that every example runs as it stands."""

from __future__ import annotations

import ast
import doctest
import inspect
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import matplotlib as mpl
import pytest
from matplotlib import pyplot

import sinan
from sinan.experiments.answers.asked import Answer
from sinan.experiments.report import made
from sinan.sensors.effects import own
from sinan.sensors.errors import InputError
from sinan.sensors.formats.plain import write_recording
from sinan.sensors.window import window
from tests.estimator import gnss_simulation

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "face.md").read_text(encoding="utf-8")
#: Modules that `import sinan` may load beside those of Python itself, and how many in all.
FEW = 150
FUNCTIONS = [name for name in sinan.__all__ if inspect.isfunction(getattr(sinan, name))]
ANSWERS = [name for name in sinan.__all__ if inspect.isclass(cls := getattr(sinan, name)) and issubclass(cls, Answer)]


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder with what the examples read; figures that are not shown; effects of one's own forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    write_recording(sinan.simulate("hover", seed=1), tmp_path / "flight")
    observation, navigation = gnss_simulation.files(tmp_path, "G", epochs=5)
    observation.rename("rover.obs")
    navigation.rename("broadcast.nav")
    mpl.use("Agg")
    yield tmp_path
    pyplot.close("all")
    for name in list(own._OWN):
        own.remove(name)


def test_the_import_loads_little() -> None:
    code = "import sys; before = set(sys.modules); import sinan; print(*sorted(set(sys.modules) - before))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    loaded = run.stdout.split()
    assert not {"numpy", "scipy", "pandas", "numba", "matplotlib", "typer"} & set(loaded)
    assert len(loaded) < FEW


def test_types_and_names_of_the_face_are_those_that_are_loaded() -> None:
    """What a type checker sees of a name is what it is when it is loaded."""
    tree = ast.parse(Path(sinan.__file__).read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test))
    seen = {
        alias.asname: (str(node.module).removeprefix("sinan").lstrip("."), alias.name)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert seen.pop("testing") == ("", "testing")
    assert seen == {name: place for name, place in sinan._FACE.items() if name != "testing"}
    assert set(sinan.__all__) <= set(dir(sinan))


def test_the_version_is_that_installed_and_loads_as_little(monkeypatch: pytest.MonkeyPatch) -> None:
    code = "import sys, sinan; print(sinan.__version__, not {'numpy', 'matplotlib'} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert run.stdout.split() == [version("sinan-nav"), "True"]

    def nothing(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(made, "version", nothing)
    assert sinan.__version__ == "0+unknown"


def test_a_name_that_is_not_there_says_which_is() -> None:
    with pytest.raises(AttributeError, match="is it `estimate`"):
        sinan.estmate  # noqa: B018


def test_the_page_documents_the_face_and_nothing_else() -> None:
    named = set(re.findall(r"`sinan\.([A-Za-z]\w*)`", PAGE))
    assert named == set(sinan.__all__)
    headed = set(re.findall(r"^### `sinan\.(\w+)`", PAGE, re.MULTILINE))
    assert set(FUNCTIONS) | set(ANSWERS) <= headed


def test_the_examples_of_the_page_run(desk: Path) -> None:
    names: dict[str, object] = {}
    for number, code in enumerate(re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)):
        exec(compile(code, f"docs/face.md, example {number + 1}", "exec"), names)
    pages = {"estimate", "calibration", "trace", "observability", "montecarlo"}
    assert {path.stem for path in desk.glob("*.html")} == pages
    assert "baro.suction" in sinan.effects


@pytest.mark.usefixtures("desk")
@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_function_has_an_example_that_runs(name: str) -> None:
    function = getattr(sinan, name)
    tests = doctest.DocTestFinder(recurse=False).find(function, name, globs={})
    assert tests
    assert tests[0].examples
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    said: list[str] = []
    runner.run(tests[0], out=said.append)
    assert runner.failures == 0, "".join(said)


def test_the_packages_own_example_is_three_lines() -> None:
    examples = doctest.DocTestParser().get_examples(sinan.__doc__ or "")
    assert len(examples) == 3
    assert examples[0].source == "import sinan\n"


@pytest.mark.parametrize("name", ANSWERS)
def test_an_answer_documents_its_tables_and_figures(name: str) -> None:
    for key, value in vars(getattr(sinan, name)).items():
        if inspect.isfunction(value) and not key.startswith("_"):
            assert inspect.getdoc(value), f"{name}.{key}"


def test_steps_are_those_of_the_estimate() -> None:
    flight = window(sinan.simulate("hover", seed=1), (0.0, 5.0))
    result = sinan.estimate(flight)
    last = None
    updates = 0
    for last in sinan.steps(flight):
        updates += last.kind == "update"
    assert last is not None
    assert updates == len(result.journal)
    for name, value in last.state.items():
        at = result.model.layout.nominal(name)
        assert value == pytest.approx(result.journal.x_end[at], abs=1e-6, rel=1e-6)


def test_an_update_is_the_textbooks() -> None:
    """x+ = x- + K nu of the biases, and P+ = (1 - K H) P- of them, at the first reading of the barometer."""
    before = None
    for moment in sinan.steps(sinan.simulate("hover", seed=1)):
        if moment.sensor == "baro":
            break
        before = moment
    assert before is not None
    assert moment.K is not None
    assert moment.H is not None
    assert moment.innovation is not None
    at = moment.layout.slice("b_baro")
    assert moment.state["b_baro"] == pytest.approx(before.state["b_baro"] + moment.K[at] @ moment.innovation)
    P = (before.covariance - moment.K @ moment.H @ before.covariance)[at, at]
    assert moment.sigma["b_baro"] == pytest.approx(P[0] ** 0.5)


def test_the_face_and_the_command_line_give_the_same_numbers(desk: Path) -> None:
    from sinan.experiments.commands.estimate import run

    text = run("flight", "auto", None, None, desk / "estimate.json", None)
    result = sinan.estimate(sinan.read("flight"))
    assert str(result).splitlines()[1:] == text.splitlines()[1:]


@pytest.mark.parametrize("ask", [sinan.estimate, sinan.trace], ids=["estimate", "trace"])
def test_the_name_of_a_recording_is_none(ask: Callable[[object], object]) -> None:
    with pytest.raises(InputError, match=r"'flight'; expected a `Recording`, of `sinan\.read`"):
        ask("flight")


@pytest.mark.parametrize("seed", [-1, 1.5])
def test_a_seed_is_a_whole_number(seed: float) -> None:
    with pytest.raises(InputError, match=r"seed: .*; expected a whole number from 0 on"):
        sinan.simulate("hover", seed=seed)  # type: ignore[arg-type]


def test_what_no_file_has_is_traced_by_a_line_of_a_script() -> None:
    result = sinan.estimate(window(sinan.simulate("hover", seed=1), (0.0, 5.0)))
    assert "`sinan.trace(recording)`" in str(result)


def test_an_estimate_refuses_what_only_the_compiled_filter_does() -> None:
    flight = window(sinan.simulate("hover", seed=1), (0.0, 5.0))
    with pytest.raises(InputError, match="readable filter alone"):
        sinan.estimate(flight, sensors=[sinan.Barometer(0.3)], smooth=True)
    with pytest.raises(InputError, match="no sensor `base`"):
        sinan.estimate(flight, sensors=[sinan.BaseReceiver(0.3)])
