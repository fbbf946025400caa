"""Whatever a test makes a command write with `--json` has to fit the schema of that command."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from typer.testing import CliRunner, Result

from sinan.experiments.schemas import schema


@cache
def validator(name: str) -> jsonschema.Draft202012Validator:
    """Of one schema, itself checked."""
    jsonschema.Draft202012Validator.check_schema(schema(name))
    return jsonschema.Draft202012Validator(schema(name))


def require_fit(name: str, document: Any) -> None:
    """Fail with every place where a document does not fit."""
    errors = [f"{error.json_path}: {error.message[:200]}" for error in validator(name).iter_errors(document)]
    assert not errors, f"{name}: " + "\n".join(errors)


def schema_of(words: Sequence[str]) -> str:
    """Of what a command writes; of a capture it is that of a calibration."""
    whole = "-".join(words[:2])
    return whole if whole in ("camera-hand-eye", "camera-wand", "calibrate-all") else words[0]


@pytest.fixture(autouse=True)
def _documents_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    invoke = CliRunner.invoke

    def checked(self: CliRunner, app: Any, args: Sequence[str] = (), **more: Any) -> Result:
        result = invoke(self, app, args, **more)
        words = [*map(str, args)]
        if result.exit_code == 0 and "--json" in words[:-1]:
            path = Path(words[words.index("--json") + 1])
            if path.is_file():
                require_fit(schema_of(words), json.loads(path.read_text(encoding="utf-8")))
        return result

    monkeypatch.setattr(CliRunner, "invoke", checked)
