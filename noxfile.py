"""`nox` runs what this machine can: tests on every Python that it has, lowest and newest versions, lint, site, wheel.

`nox -l` lists the sessions, `nox -s fast` runs one. A Python that is not installed is skipped, and nox says so.
"""

from __future__ import annotations

import nox

PYTHONS = ("3.11", "3.12", "3.13", "3.14")
nox.options.default_venv_backend = "venv"
nox.options.sessions = ["fast", "lint", "tests", "docs", "wheel"]


@nox.session
def fast(session: nox.Session) -> None:
    """What a contributor runs: the tests that are marked `fast`, about two minutes."""
    session.install("-e", ".[test]")
    session.run("pytest", "-m", "fast", *session.posargs)


@nox.session(python=PYTHONS)
def tests(session: nox.Session) -> None:
    """All tests with the newest versions that the index has, on every Python of this machine."""
    session.install("-e", ".[test]")
    session.run("pytest", "-n", "2", *session.posargs)


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
