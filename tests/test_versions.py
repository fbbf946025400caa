"""What `pyproject.toml` says of versions: a floor for all that is imported, and the test of the floors takes them."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions, version
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("sinan", "sensors", "estimator", "calibration", "experiments")
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = SETTINGS["project"]
EXTRAS: dict[str, list[str]] = PROJECT["optional-dependencies"]
OURS = re.compile(r"sinan-nav\[[\w,]+\]")
FLOOR = re.compile(r"([\w-]+)>=(\d+(?:\.\d+)*)")
ALL = [*PROJECT["dependencies"], *(entry for extra in EXTRAS.values() for entry in extra if not OURS.fullmatch(entry))]


def numbers(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", text))


def named(requirements: list[str]) -> dict[str, str]:
    """The floor of each library."""
    return {match[1].lower(): match[2] for match in map(FLOOR.fullmatch, requirements) if match}


@pytest.mark.parametrize("requirement", ALL)
def test_every_requirement_is_a_floor(requirement: str) -> None:
    assert FLOOR.fullmatch(requirement)


def test_what_is_installed_lies_above_the_floors() -> None:
    for name, floor in named([*PROJECT["dependencies"], *EXTRAS["test"]]).items():
        assert numbers(version(name)) >= numbers(floor), name


def test_the_test_of_the_lowest_versions_takes_every_floor() -> None:
    printed = subprocess.run(
        [str(ROOT / ".ci" / "lowest"), "--list"], capture_output=True, text=True, check=True,
        env={"PYTHON": sys.executable, "PATH": "/usr/bin:/bin"},
    ).stdout.split()  # fmt: skip
    names = "camera", "dask", "docs", "gnss", "map", "mavlink", "parquet", "ros", "test"
    floors = named([*PROJECT["dependencies"], *(entry for name in names for entry in EXTRAS[name])])
    tools = {"ruff", "mypy", "import-linter", "nox", "pre-commit"}
    assert sorted(printed) == sorted(f"{name}=={floor}" for name, floor in floors.items() if name not in tools)


def test_every_library_that_is_imported_is_named() -> None:
    """Of whatever is imported at any depth, outside Python itself and these packages."""
    # those that need not be installed are not known by what they install
    elsewhere = {"cv2": ["opencv-python-headless"], "CSF": ["cloth-simulation-filter"]}
    distributions = {**elsewhere, **packages_distributions()}
    known = set(named(ALL))
    for path in (path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) and node.level == 0 else []
            for name in {name.split(".")[0] for name in names} - {*sys.stdlib_module_names, *PACKAGES, ""}:
                found = {distribution.lower().replace("_", "-") for distribution in distributions.get(name, [name])}
                assert found & known, f"{path} imports {name}"


def test_python_itself_has_a_floor() -> None:
    assert PROJECT["requires-python"] == ">=3.11"
    assert "python3.11" in (ROOT / ".ci" / "lowest").read_text()


def test_a_build_without_a_tag_sorts_before_the_release_that_comes_next() -> None:
    """Which is the first that the changelog has; a fallback of 0.1.0 alone made builds of 0.1.1.dev, after it."""
    heading = re.search(r"^## (\S+) \((.+)\)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert heading is not None
    release, date = heading.groups()
    assert SETTINGS["tool"]["setuptools_scm"]["fallback_version"] == f"{release}.dev0"
    cited = dict(re.findall(r"^([\w-]+): ([\w.-]+)", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE))
    said = (f"{release}.dev0", None) if date == "unreleased" else (release, date)
    assert (cited["version"], cited.get("date-released")) == said
