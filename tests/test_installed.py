"""The wheel: one name at the top, beside packages and folders that take the names of its parts; its types."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PARTS = ("sensors", "estimator", "calibration", "experiments")
RAISES = "raise ImportError('another package of this name')\n"
CANOPY = """
[build-system]
requires = ["setuptools>=77"]
build-backend = "setuptools.build_meta"

[project]
name = "canopy"
version = "1.0"

[project.entry-points."sinan.effects"]
canopy = "canopy:suction"

[tool.setuptools]
py-modules = ["canopy"]
"""
SUCTION = """
import sinan


@sinan.effect("baro.suction", parameters={"b": ("m", 3.0)}, needs=["throttle"], enters="h += b x throttle")
def suction(motion):
    '''The rotors draw air out of the canopy.'''
    return motion.covariates["throttle"][:, None, None]
"""


def run(*command: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "VIRTUAL_ENV"))}
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of a clean copy of what is here."""
    folder = tmp_path_factory.mktemp("wheel")
    needed = ("sinan", *PARTS, "pyproject.toml", "setup.py", "README.md", "LICENSE")
    listed = run("git", "ls-files", "--cached", "--others", "--exclude-standard", "--", *needed, cwd=ROOT).stdout
    for name in filter(lambda name: (ROOT / name).is_file(), listed.splitlines()):
        (folder / "source" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "source" / name).write_bytes((ROOT / name).read_bytes())
    built = run(sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(folder), "./source", cwd=folder)
    assert built.returncode == 0, built.stderr
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def python(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """A Python that has the wheel, what it needs, and four packages that are called as its parts are."""
    folder = tmp_path_factory.mktemp("environment")
    run(sys.executable, "-m", "venv", "--without-pip", "env", cwd=folder)
    site = next((folder / "env" / "lib").glob("python*/site-packages"))
    with zipfile.ZipFile(wheel) as file:
        file.extractall(site)
    for part in PARTS:
        (site / part).mkdir()
        (site / part / "__init__.py").write_text(RAISES)
    (site / "needed.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")
    return str(folder / "env" / "bin" / "python")


@pytest.fixture
def desk(tmp_path: Path) -> Path:
    """A student's folder, with a `sensors` of its own."""
    (tmp_path / "sensors").mkdir()
    (tmp_path / "sensors" / "__init__.py").write_text(RAISES)
    return tmp_path


def test_the_wheel_puts_one_name_at_the_top(wheel: Path) -> None:
    names = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert {name for name in names if not name.endswith(".dist-info")} == {"sinan"}


def test_the_labs_for_students_are_in_the_wheel_without_their_solutions(python: str, wheel: Path, desk: Path) -> None:
    names = [name for name in zipfile.ZipFile(wheel).namelist() if "student_labs" in name]
    assert any(name.endswith("student_labs/texts/camera.notebook") for name in names)
    assert not [name for name in names if "solutions" in name]
    begun = run(python, "-m", "sinan", "lab", "begin", "gps", "--student", "7", "--out", "gps", cwd=desk)
    assert begun.returncode == 0, begun.stderr
    (desk / "gps" / "answer.json").write_text('{"clock": 0.0}')
    checked = run(python, "-m", "sinan", "lab", "check", "gps", "gps/answer.json", cwd=desk)
    assert checked.returncode == 1
    assert "0 of 4 are right" in checked.stdout


def test_the_command_runs_beside_other_packages_of_those_names(python: str, desk: Path) -> None:
    made = run(
        python, "-m", "sinan", "simulate", "mag_poses", "poses", "--effect", "mag.cross_axis=0.03,0,-0.02", cwd=desk
    )
    assert made.returncode == 0, made.stderr
    traced = run(python, "-m", "sinan", "calibrate", "mag", "poses", "--html", "mag.html", cwd=desk)
    assert traced.returncode == 0, traced.stderr
    assert (desk / "mag.html").is_file()


def test_the_demonstration_runs_beside_other_packages_of_those_names(python: str, desk: Path) -> None:
    done = run(python, "-m", "sinan", "demo", "out", cwd=desk)
    assert done.returncode == 0, done.stderr
    assert "mag.cross_axis" in done.stdout
    assert (desk / "out" / "simulated.html").is_file()


def test_an_installed_package_brings_an_effect(python: str, desk: Path) -> None:
    """By the entry point that its `pyproject.toml` declares."""
    package = desk / "canopy"
    package.mkdir()
    (package / "pyproject.toml").write_text(CANOPY)
    (package / "canopy.py").write_text(SUCTION)
    site = next(Path(python).parents[1].glob("lib/python*/site-packages"))
    install = ("install", "-q", "--no-deps", "--target", str(site), str(package))
    installed = run(sys.executable, "-m", "pip", *install, cwd=desk)
    assert installed.returncode == 0, installed.stderr
    shutil.rmtree(package)
    said = run(python, "-m", "sinan", "effects", "baro.suction", cwd=desk)
    assert said.returncode == 0, said.stderr
    assert "The rotors draw air out of the canopy." in said.stdout
    simulated = ("simulate", "hover", "flight", "--effect", "baro.suction=2.5")
    assert run(python, "-m", "sinan", *simulated, cwd=desk).returncode == 0


def test_schemas_are_in_the_wheel_and_need_no_library_for_them(python: str, desk: Path) -> None:
    (desk / "jsonschema.py").write_text(RAISES)
    for name in ("trace", "map.toml"):
        printed = run(python, "-m", "sinan", "schema", name, cwd=desk)
        assert printed.returncode == 0, printed.stderr
        assert json.loads(printed.stdout)["additionalProperties"] is False


def test_a_script_beside_a_folder_of_that_name_runs(python: str, desk: Path) -> None:
    script = "import sinan; print(sinan.__file__); print(sinan.calibrate(sinan.simulate('mag_poses'), 'mag')['mag'].K)"
    (desk / "script.py").write_text(script)
    done = run(python, "script.py", cwd=desk)
    assert done.returncode == 0, done.stderr
    assert Path(done.stdout.splitlines()[0]).is_relative_to(Path(python).parents[1])


def test_the_plugin_of_pytest_is_found(python: str, desk: Path) -> None:
    (desk / "test_it.py").write_text("def test_it(journal_regression):\n    assert callable(journal_regression)\n")
    done = run(python, "-m", "pytest", "-q", "-p", "no:cacheprovider", cwd=desk)
    assert done.returncode == 0, done.stdout


def test_a_type_checker_sees_the_types(python: str, desk: Path) -> None:
    (desk / "script.py").write_text(
        "import sinan\nreveal_type(sinan.estimate(sinan.simulate('hover')).summary())\nsinan.simulate(3)\n"
    )
    checked = run(sys.executable, "-m", "mypy", "--python-executable", python, "script.py", cwd=desk).stdout
    assert re.search(r'Revealed type is "(builtins\.)?str"', checked), checked
    assert 'Argument 1 to "simulate" has incompatible type "int"' in checked
