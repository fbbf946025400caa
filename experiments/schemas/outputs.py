"""JSON Schemas of the documents that commands write, from the tables of `keys.md`; docs/json.md says how they read."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

PAGE = Path(__file__).with_name("keys.md")
_TYPES = {
    "number": "number",
    "whole": "integer",
    "text": "string",
    "flag": "boolean",
    "table": "object",
    "null": "null",
}


@cache
def sections() -> dict[str, str]:
    """The tables of each document as they stand on the page, by its name."""
    parts = re.split(r"^## `sinan ([^`]+)`$", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {
        name.replace(" ", "-"): text for name, text in zip(parts[1::2], parts[2::2], strict=True) if "| key" in text
    }


def document(name: str) -> dict[str, Any]:
    """The schema of one document."""
    schema = _object({})
    for keys, meaning in re.findall(r"^\| (`.*`) \| (.*) \|$", sections()[name], re.MULTILINE):
        said = [key.partition(": ") for key in re.findall(r"`([^`]+)`", keys)]
        for k, (path, _, _) in enumerate(said):
            _add(schema, path, next(kind for _, _, kind in said[k:] if kind), meaning)
    return schema


def _add(schema: dict[str, Any], path: str, kind: str, meaning: str) -> None:
    """Add one key, and the tables that it is in."""
    for key in path.removesuffix("?").split("."):
        schema = _below(_object(schema), key, not path.endswith("?"))
    for word, value in _of(kind).items():
        schema[word] = [*schema.get("type", ()), *value] if word == "type" else value
    schema["description"] = meaning


def _object(schema: dict[str, Any]) -> dict[str, Any]:
    """The schema as one of a table, or also of one."""
    if "object" not in schema.setdefault("type", []):
        schema["type"].append("object")
    schema.setdefault("additionalProperties", False)
    return schema


def _below(schema: dict[str, Any], key: str, required: bool) -> dict[str, Any]:
    """The schema of a key of a table: `name`, `name[]` for the entries of a list, `*` for any name, `*_rms`."""
    name = key.rstrip("[]")
    if name == "*":
        schema["additionalProperties"] = schema.get("additionalProperties") or {}
        below = schema["additionalProperties"]
    elif "*" in name:
        below = schema.setdefault("patternProperties", {}).setdefault(f"^{name.replace('*', '.+')}$", {})
    else:
        if required and name not in schema.get("properties", {}):
            schema.setdefault("required", []).append(name)
        below = schema.setdefault("properties", {}).setdefault(name, {})
    for _ in range((len(key) - len(name)) // 2):
        if "array" not in below.setdefault("type", []):
            below["type"].append("array")
        below = below.setdefault("items", {})
    return below


def _of(kind: str) -> dict[str, Any]:
    """The words of JSON Schema for a type as the page has it."""
    if kind.endswith("?"):
        inner = _of(kind[:-1])
        return inner | {"type": [*inner["type"], "null"]}
    if kind.startswith("["):
        return {"type": ["array"], "items": _of(kind[1:-1])}
    if " or " in kind:
        return {"enum": [json.loads(word) for word in kind.split(" or ")]}
    return {"const": json.loads(kind)} if kind[0].isdigit() else {"type": [_TYPES[kind]]} if kind != "any" else {}
