"""The pytest plugin: `journal_regression` keeps the journal of a run as text, and compares the next with it."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from sinan.testing.journals import Bounds

Check = Callable[..., None]


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--sinan-update`, and the ini key `sinan_journals`."""
    group = parser.getgroup("sinan", "regression tests of models")
    group.addoption("--sinan-update", action="store_true", help="keep the journals of this run: review them as a diff")
    parser.addini("sinan_journals", "folder of the kept journals, from the root of the tests", default="journals")


@pytest.fixture
def journal_regression(request: pytest.FixtureRequest) -> Check:
    """A function (result, name="", bounds=None, every=1.0) that compares the journal of an estimate with the kept one.

    It is kept in `sinan_journals`/NAME.txt (default: the name of the test) where `--sinan-update` is given; without a
    kept one the test fails.
    """
    config = request.config

    def check(result: Any, name: str = "", bounds: Bounds | None = None, every: float = 1.0) -> None:
        from sinan.testing.journals import Bounds, changes, journal_text

        file = _file(config, name or request.node.name)
        if config.getoption("--sinan-update"):
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(journal_text(result, every), encoding="utf-8")
            return
        if not file.exists():
            pytest.fail(f"no journal is kept in {file}: run once with --sinan-update, and look at what it kept")
        said = changes(file.read_text(encoding="utf-8"), journal_text(result, every), bounds or Bounds())
        if said:
            text = "\n".join([f"{file}: the journal has changed", *(f"  {line}" for line in said)])
            pytest.fail(f"{text}\n  if that is meant: --sinan-update, and review the diff", pytrace=False)

    return check


def _file(config: pytest.Config, name: str) -> Path:
    folder = config.rootpath / str(config.getini("sinan_journals"))
    return folder / (re.sub(r"[^\w.-]+", "_", name).strip("_") + ".txt")
