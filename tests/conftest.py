"""Shared fixtures: where the measured data are, how many tests went without them, and a library that is not there."""

from __future__ import annotations

import builtins
import os
import signal
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")  # two workers share two cores
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # begun in the background, a shell has taken Ctrl-C away from the tests and from all that they start
    signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).resolve().parents[1]
NO_DATA = "no measured data: set SINAN_DATA to a folder that holds the data sets, as `sinan fetch` leaves them"


def _measured_root() -> Path | None:
    named = os.environ.get("SINAN_DATA")
    for candidate in [Path(named)] if named else [ROOT.parent / "shared" / "data"]:
        if (candidate / "rfly_course").is_dir():
            return candidate
    return None


@pytest.fixture(scope="session")
def measured_data() -> Path:
    """Root folder of the measured data sets. Without them: skip, or fail where SINAN_REQUIRE_DATA is set."""
    root = _measured_root()
    if root is None:
        if os.environ.get("SINAN_REQUIRE_DATA"):
            pytest.fail(NO_DATA)
        pytest.skip(NO_DATA)
    return root


#: Test files of the fast lane, and the seconds that each was measured to take.
FAST: dict[str, float] = tomllib.loads((ROOT / "tests" / "fast.toml").read_text(encoding="utf-8"))["seconds"]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what is in the fast lane."""
    for item in items:
        path = item.path
        if path.is_relative_to(ROOT / "tests") and path.relative_to(ROOT / "tests").as_posix() in FAST:
            item.add_marker(pytest.mark.fast)


def _slower_than_listed(reports: dict[str, list[Any]]) -> list[str]:
    """Files of the fast lane that took far longer than `fast.toml` says."""
    took: dict[str, float] = {}
    for report in (one for kind in ("passed", "failed") for one in reports.get(kind, [])):
        file = report.nodeid.split("::")[0].removeprefix("tests/")
        took[file] = took.get(file, 0.0) + report.duration
    return [
        f"tests/{file}: {took[file]:.0f} s, in tests/fast.toml with {listed:g} s: measure it again"
        for file, listed in FAST.items()
        if took.get(file, 0.0) > 3.0 * listed + 5.0
    ]


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Say how many tests had no data, and what of the fast lane was slow."""
    if config.option.markexpr == "fast":
        for line in _slower_than_listed(terminalreporter.stats):
            terminalreporter.write_line(line)
    skipped = [r for r in terminalreporter.stats.get("skipped", []) if NO_DATA in str(r.longrepr)]
    if skipped:
        terminalreporter.write_line(f"{len(skipped)} measured tests were skipped: {NO_DATA}")


@pytest.fixture
def without_library(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Makes the import of a library fail, as where it is not installed."""
    whole = builtins.__import__

    def hide(library: str) -> None:
        def without(name: str, *rest: Any, **more: Any) -> Any:
            if name.split(".")[0] == library:
                raise ImportError(name)
            return whole(name, *rest, **more)

        monkeypatch.setattr(builtins, "__import__", without)

    return hide
