"""JSON Schemas of the files that are read: what their readers ask for.

A `Table` notes every key that its reader asks for, with types and bounds, so that a reader that runs over a file with
every table leaves the schema of all such files behind. What a reader checks besides (keys that exclude one another) is
not in it. What keys mean is in the last tables of `keys.md`: that of the file, and before it that of what files share.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from sinan.experiments.datasets.registry import dataset_of
from sinan.experiments.gnss import simulated as ranges_of
from sinan.experiments.scenarios import loader
from sinan.experiments.schemas.outputs import FILES_READ, PAGE, rows
from sinan.experiments.student_labs import TITLES
from sinan.experiments.student_labs.lab import lab_of
from sinan.sensors.effects import CATALOGUE
from sinan.sensors.formats.header import SENSOR_KEYS
from sinan.sensors.formats.map_file import map_of
from sinan.sensors.formats.map_rules import QUANTITIES, REFERENCE_QUANTITIES
from sinan.sensors.formats.plain import FORMAT, files, read_declared
from sinan.sensors.formats.toml_table import Table
from sinan.sensors.manoeuvres import KINDS

Schema = dict[str, Any]
_ORIGIN = {"latitude": 0.0, "longitude": 0.0, "height": 0.0}


def recording() -> Schema:
    """Of `recording.toml`."""
    betas = {effect.name: [0.0] * effect.size for effect in CATALOGUE.values()}
    header = {"origin": _ORIGIN, "sensors": {name: {} for name in SENSOR_KEYS}, "effects": betas}
    table = Table("", {"format": FORMAT, "kind": "flight", "rows": dict.fromkeys(files(), 1), **header})
    read_declared(table)
    return table.schema


def log_map() -> Schema:
    """Of a map."""
    schema: Schema = {}
    sizes = {**QUANTITIES, "base": QUANTITIES["gps"], "reference": REFERENCE_QUANTITIES}
    file = {"records": {"fields": [["a", "int8"]]}}
    sensors: dict[str, Any] = {name: {} for name in SENSOR_KEYS}
    document: dict[str, Any] = {"kind": "flight", "origin": _ORIGIN, "sensors": sensors, "file": file}
    for polar in (False, True):
        tables = {name: _read_as(quantities, polar) for name, quantities in sizes.items()}
        rest = {"files": {"*": file}, "reference": tables.pop("reference"), "streams": tables}
        map_of(Path(), Table("", document | rest, schema=schema))
    return _any_name(schema)


def _read_as(quantities: Mapping[str, tuple[tuple[str, ...], str]], polar: bool) -> dict[str, Any]:
    """A table of a stream with every key; polar: of its velocity that way of being read, which excludes the others."""
    of = {key: {word: [*"abcd"][: len(outputs) or 1] for word in ("columns", "minus")}
          for key, (outputs, _) in quantities.items()}  # fmt: skip
    if polar and "velocity" in of:
        of["velocity"] = {"polar": ["speed", "course", "down"]}
    further = {"*": {"columns": "a", "minus": "b"}}
    return {**of, "time": {"column": "t", "minus": "late"}, "keep": {"column": "a"}, "covariates": further}


def scenario() -> Schema:
    """Of a scenario; "none" takes a key of the one that it is like away."""
    schema: Schema = {}
    sensors = {name: {"rate": 1.0} for name in loader.simulated()}
    manoeuvres = [{"kind": kind, "duration": 100.0} for kind in KINDS]
    common = {"origin": _ORIGIN, "environment": {"magnetic_field": [1.0, 0.0, 0.0]}, "sensors": sensors}
    for motion in ({"manoeuvre": manoeuvres}, {"turns": {"attitudes": [[0.0] * 3] * 2}}):
        loader.scenario_of(Table("", {**common, **motion}, schema=schema), "")
    return _or_none(schema)


def ranges() -> Schema:
    """Of a scenario of pseudoranges."""
    table = Table("", {"origin": [0.0, 0.0, 0.0], "error": [{}], "fault": [{}]})
    ranges_of.scenario_of(table, "")
    return table.schema


def dataset() -> Schema:
    """Of `dataset.toml`."""
    table = Table("", {"files": {"*": {}}, "maps": {"*": ""}})
    dataset_of(table, "")
    return _any_name(table.schema)


def lab_answer() -> Schema:
    """Of the `answer.json` of a lab: the questions of all labs, each with as many numbers as one of them asks for."""
    asked: Schema = {}
    for lab in TITLES:
        for question in lab_of(lab).questions:
            said = {"description": f"of the lab `{lab}`", **_numbers(question.size)}
            asked.setdefault(question.name, {"anyOf": []})["anyOf"].append(said)
    return {"type": ["object"], "properties": asked}


def _numbers(size: int) -> Schema:
    return {
        "type": ["array", "number"] if size == 1 else ["array"],
        "items": {"type": "number"}, "minItems": size, "maxItems": size,
    }  # fmt: skip


def described(name: str, schema: Schema, path: str = "") -> Schema:
    """The schema of a file with what its keys mean."""
    for key, inner in schema.get("properties", {}).items():
        whole = f"{path}.{key}" if path else key
        inner["description"] = next((said for pattern, said in _meanings(name) if pattern.fullmatch(whole)), "")
        described(name, inner, whole)
    for inner in schema.get("anyOf", ()):
        described(name, inner, path)
    for inner in (schema.get("items"), schema.get("additionalProperties")):
        if isinstance(inner, dict):
            described(name, inner, f"{path}.*")
    return schema


@cache
def _meanings(name: str) -> list[tuple[re.Pattern[str], str]]:
    """The paths of keys, `*` for any name, with what they mean: those of the file itself, then those of several."""
    shared, *own = re.split(r"^### `(.+)`$", PAGE.read_text(encoding="utf-8").split(FILES_READ)[1], flags=re.MULTILINE)
    text = dict(zip(own[::2], own[1::2], strict=True))[name] + shared
    said = [(path, meaning) for paths, meaning in rows(text) for path in re.findall(r"`([^`]+)`", paths)]
    return [(re.compile(re.escape(path).replace(r"\*", "[^.]+")), meaning) for path, meaning in said]


def _any_name(schema: Schema) -> Schema:
    """Of tables by names that the file gives, each like the one called `*`."""
    properties = schema.get("properties", {})
    if "*" in properties:
        schema["additionalProperties"] = properties.pop("*")
    for inner in properties.values():
        _any_name(inner)
    return schema


def _or_none(schema: Schema) -> Schema:
    """Every key of the tables may say "none"."""
    properties = schema.get("properties", {})
    for key, inner in properties.items():
        properties[key] = {"anyOf": [{"const": "none"}, _or_none(inner)]}
    return schema


#: By name: of what it is, and what makes it.
READ: dict[str, tuple[str, Callable[[], Schema]]] = {
    "recording.toml": ("what a recording declares: `recording.toml`", recording),
    "map.toml": ("how a log is read: `--map FILE`", log_map),
    "scenario.toml": ("a scenario of `sinan simulate`", scenario),
    "ranges.toml": ("a scenario of `sinan ranges`", ranges),
    "dataset.toml": ("what is known of a data set: `dataset.toml`", dataset),
    "answer.json": ("a student's answer, which `sinan lab check` reads", lab_answer),
}
