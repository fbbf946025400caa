"""The notebooks run as a reader would run them, and so do the lines of the first page."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import pyplot
from typer.main import get_command
from typer.testing import CliRunner

DOCS = Path(__file__).parents[2] / "docs"
sys.path.append(str(DOCS / "make"))

import notebooks  # noqa: E402
import ten_minutes_figure  # noqa: E402

from sinan.experiments.commands.cli import app  # noqa: E402


@pytest.fixture(autouse=True)
def the_same_code(monkeypatch: pytest.MonkeyPatch) -> None:
    """A kernel is a process of its own: it has to find the package that is tested here."""
    monkeypatch.setenv("PYTHONPATH", str(DOCS.parent))
    monkeypatch.setenv("MPLBACKEND", "agg")


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("name", notebooks.names())
def test_a_notebook_runs_to_its_end(name: str) -> None:
    done = notebooks.execute(name)
    assert all(cell.execution_count for cell in done.cells if cell.cell_type == "code")


def test_every_notebook_is_in_the_order_of_the_site() -> None:
    assert sorted(notebooks.ORDER) == notebooks.names()


@pytest.fixture
def at_a_desk(tmp_path: Path, measured_data: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty folder, and the measured data where `sinan fetch` leaves them."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SINAN_DATA", str(measured_data))
    mpl.use("agg")
    yield tmp_path
    pyplot.close("all")


def test_the_lines_of_the_first_page_run(
    at_a_desk: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[list[int]] = []
    monkeypatch.setattr(pyplot, "show", lambda: shown.append(pyplot.get_fignums()))
    stepped, found, simulated = ten_minutes_figure.blocks()
    names: dict[str, Any] = {}
    exec(compile(stepped, "ten_minutes.md, first", "exec"), names)
    assert "the filter's gain is the same: True" in capsys.readouterr().out
    assert [one.get_ylabel() for one in names["axes"]] == [f"gyro {axis} [rad/s]" for axis in "xyz"]
    first, last = names["sigma"][0], names["sigma"][-1]
    assert np.all(last < 0.4 * first)
    exec(compile(found, "ten_minutes.md, second", "exec"), names)
    assert (names["found"].verdict, names["found"].found) == ("effects", ("mag.time_offset", "gps.latency"))
    assert all((at_a_desk / name).stat().st_size > 1e5 for name in ("estimate.html", "trace.html"))
    said = capsys.readouterr().out
    page = ten_minutes_figure.PAGE.read_text(encoding="utf-8")
    assert re.search(r"mag\.time_offset: 0\.089\d ± 0\.002\d s", said)
    assert "0.089 ± 0.003 s" in page
    exec(compile(simulated, "ten_minutes.md, third", "exec"), names)
    assert np.all(names["result"].biases()["off"].abs() < 4.0)
    assert len(shown) == 3
    assert all(shown)  # each block's figure


def test_the_commands_of_the_first_page_are_commands(at_a_desk: Path) -> None:
    """All of them are understood; those that take a second or two are run."""
    page = ten_minutes_figure.PAGE.read_text(encoding="utf-8")
    lines = re.findall(r"^sinan [a-z]+ .*$", page, re.MULTILINE)
    assert len(lines) == 9
    for line in lines:
        _, name, *arguments = line.replace("$log", "px4_v6xrt_flight/corrupt_unregistered_msg_id.ulg").split()
        get_command(app).commands[name].make_context(name, list(arguments))  # type: ignore[attr-defined]
        if name in ("fetch", "info") or "rfly_course" in line:
            done = CliRunner().invoke(app, [name, *arguments])
            assert done.exit_code == 0, (line, done.output)
    assert (at_a_desk / "mag.html").exists()
