"""How long a function may be: it fits a screen. How branched it may be is ruff's (C901 in `pyproject.toml`)."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = ("sinan", "sensors", "estimator", "calibration", "experiments", "docs", "tests")
MOST_LINES = 60  # of signature and body; the docstring is not counted
KERNELS = "_numba.py"  # compiled: a call inside the loop costs


def lengths(text: str) -> Iterator[tuple[str, int]]:
    """Name and lines of every function, without those of its docstring."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            said = node.body[0] if ast.get_docstring(node, clean=False) is not None else None
            docstring = 0 if said is None else (said.end_lineno or said.lineno) - said.lineno + 1
            yield node.name, (node.end_lineno or node.lineno) - node.lineno + 1 - docstring


def test_the_docstring_is_not_counted() -> None:
    assert list(lengths('def f(\n    a,\n):\n    """One.\n\n    Two.\n    """\n    b = a\n    return b\n')) == [
        ("f", 5)
    ]


def test_no_function_is_longer_than_a_screen() -> None:
    files = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]
    assert len(files) > 500
    long = [
        f"{path.relative_to(ROOT)}: {name}, {lines} lines"
        for path in files
        if not path.name.endswith(KERNELS)
        for name, lines in lengths(path.read_text(encoding="utf-8"))
        if lines > MOST_LINES
    ]
    assert not long
