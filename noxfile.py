"""`nox` runs what this machine can: tests on every Python that it has, lowest and newest versions, lint, site, wheel.

`nox -l` lists the sessions, `nox -s fast-3.13` runs one. A Python that is not installed is skipped, and nox says so.
Pythons of pyenv are found as well, whichever of them is the global one.
"""

from __future__ import annotations

import os
from pathlib import Path

import nox

PYTHONS = ("3.11", "3.12", "3.13", "3.14")


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split(".") if part.isdigit())


def of_pyenv() -> list[str]:
    """Versions installed by pyenv that are tested here, newest first."""
    root = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    there = [path.name for path in root.glob("versions/3.*") if path.name.rpartition(".")[0] in PYTHONS]
    return sorted(there, key=_numbers, reverse=True)


# pyenv's `python3.12` on the path refuses to run unless 3.12 is among the versions that are chosen: choose all of them.
if versions := of_pyenv():
    os.environ["PYENV_VERSION"] = ":".join(versions)

nox.options.default_venv_backend = "venv"
nox.options.sessions = ["fast-3.11", "lint", "tests", "docs", "wheel"]


@nox.session(python=PYTHONS)
def fast(session: nox.Session) -> None:
    """What a contributor runs: the tests that are marked `fast`, about two minutes."""
    session.install("-e", ".[test]")
    session.run("pytest", "-m", "fast", *session.posargs)


@nox.session(python=PYTHONS)
def tests(session: nox.Session) -> None:
    """All tests with the newest versions that the index has, on every Python of this machine."""
    session.install("-e", ".[test]")
    session.run("pytest", "-n", "2", "--dist", "worksteal", *session.posargs)


@nox.session
def lowest(session: nox.Session) -> None:
    """All tests with the lowest Python and the lowest versions that pyproject.toml allows."""
    session.run(".ci/lowest", *session.posargs, external=True)


@nox.session
def lint(session: nox.Session) -> None:
    """Lint, format, types, import contracts."""
    session.install("-e", ".[test]")
    session.run(".ci/check", session.bin, external=True)


@nox.session
def docs(session: nox.Session) -> None:
    """The site: warnings are errors, links are checked."""
    session.install("-e", ".[docs]")
    session.run(".ci/docs", session.bin, external=True)


@nox.session
def wheel(session: nox.Session) -> None:
    """The wheel, beside packages that are called as its parts are."""
    session.install("-e", ".[test]")
    session.run("pytest", "tests/test_installed.py")
