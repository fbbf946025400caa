"""JSON Schemas of the documents that commands write, from the tables of `keys.md`; docs/json.md says how they read."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

PAGE = Path(__file__).with_name("keys.md")
#: The heading under which the keys of files that are read stand.
FILES_READ = "\n## Files that are read\n"
_TYPES = {
    "number": "number",
    "whole": "integer",
    "text": "string",
    "flag": "boolean",
    "table": "object",
    "null": "null",
}


@cache
def sections() -> dict[str, tuple[str, str]]:
    """The tables of each document as they stand on the page, by its name: the heading, and what is below it.

    `sinan trace` is called trace, `index.json` of `sinan blind` is called blind-index.
    """
    parts = re.split(r"^## (`sinan .+`)$", PAGE.read_text(encoding="utf-8").split(FILES_READ)[0], flags=re.MULTILINE)
    named = {"-".join(re.findall("[a-z]+", head.replace(".json", ""))[1:]): head for head in parts[1::2]}
    return {
        name: (head, text) for (name, head), text in zip(named.items(), parts[2::2], strict=True) if "| key" in text
    }


def title(name: str) -> str:
    """What one document is."""
    command, _, file = sections()[name][0].partition(": ")
    return f"{file} of {command}" if file else f"what {command} writes as JSON"


def rows(text: str) -> list[tuple[str, str]]:
    """The keys of a table with their meaning."""
    return re.findall(r"^\| (`.*`) \| (.*) \|$", text, re.MULTILINE)


def document(name: str) -> dict[str, Any]:
    """The schema of one document."""
    schema = _object({})
    for keys, meaning in rows(sections()[name][1]):
        said = [key.partition(": ") for key in re.findall(r"`([^`]+)`", keys)]
        for k, (path, _, _) in enumerate(said):
            _add(schema, path, next(kind for _, _, kind in said[k:] if kind), meaning)
    return schema


def _add(schema: dict[str, Any], path: str, kind: str, meaning: str) -> None:
    """Add one key, and the tables that it is in: one without a row of its own means what its first key does."""
    for key in path.removesuffix("?").split("."):
        schema = _below(_object(schema), key, not path.endswith("?"), meaning)
    for word, value in _of(kind).items():
        schema[word] = [*schema.get("type", ()), *value] if word == "type" else value
    schema["description"] = meaning


def _object(schema: dict[str, Any]) -> dict[str, Any]:
    """The schema as one of a table, or also of one."""
    if "object" not in schema.setdefault("type", []):
        schema["type"].append("object")
    schema.setdefault("additionalProperties", False)
    return schema


def _below(schema: dict[str, Any], key: str, required: bool, meaning: str) -> dict[str, Any]:
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
    below.setdefault("description", meaning)
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
