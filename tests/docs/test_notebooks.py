"""The notebooks run as a reader would run them, and so do the lines of the first page."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
sys.path.append(str(DOCS / "make"))

import notebooks  # noqa: E402


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


def test_the_lines_of_the_first_page_run(capsys: pytest.CaptureFixture[str]) -> None:
    first, stepped = re.findall(
        r"```python\n(.*?)```", (DOCS / "ten_minutes.md").read_text(encoding="utf-8"), re.DOTALL
    )
    exec(compile(first, "ten_minutes.md, first", "exec"), {})
    exec(compile(stepped, "ten_minutes.md, second", "exec"), {})
    assert re.search(r"bias of the barometer -?\d+\.\d\d \+- 0\.\d\d m", capsys.readouterr().out)
