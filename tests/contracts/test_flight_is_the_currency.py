"""What needs a recording and its model takes one `Flight`, and not the two side by side."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("sensors", "estimator", "calibration", "experiments", "sinan")


def taking_both(source: str) -> list[str]:
    """Functions with a parameter `recording` and another `model`."""
    functions = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef)]
    named = {f.name: {a.arg for a in (*f.args.posonlyargs, *f.args.args, *f.args.kwonlyargs)} for f in functions}
    return [name for name, parameters in named.items() if {"recording", "model"} <= parameters]


@pytest.mark.parametrize("folder", FOLDERS)
def test_no_function_takes_recording_and_model_apart(folder: str) -> None:
    found = {str(p.relative_to(ROOT)): taking_both(p.read_text()) for p in sorted((ROOT / folder).rglob("*.py"))}
    assert {path: names for path, names in found.items() if names} == {}


def test_a_function_that_takes_both_is_seen() -> None:
    assert taking_both("def run(recording, *, model): ...\ndef fit(flight): ...") == ["run"]
