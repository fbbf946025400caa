"""`recording.toml` as text: what a recording declares, so that reading it back gives the same numbers."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields

import numpy as np

from sinan.sensors.recording import Environment, Initial, Recording, SensorSpec

#: First line of every `recording.toml` that is written here: such a folder may be replaced, on demand.
WRITTEN_BY = "# written by sinan"
_ORIGIN = ("latitude", "longitude", "height")


def header_text(recording: Recording, rows: Mapping[str, int]) -> str:
    """The text of `recording.toml`; what was not declared is not written.

    Parameters
    ----------
    rows : of each CSV file, by the name of its stream
    """
    lines = [WRITTEN_BY, "format = 1", f"name = {_value(recording.name)}", f"kind = {_value(recording.kind)}"]
    lines += ["", "[rows]", *(f"{name} = {count}" for name, count in rows.items())]
    if recording.origin is not None:
        lines += _table("origin", dict(zip(_ORIGIN, recording.origin, strict=True)))
    lines += _table("environment", _declared(recording.environment, Environment()))
    lines += _table("initial", _declared(recording.initial, Initial()))
    for sensor, spec in recording.sensors.items():
        lines += ["", f"[sensors.{sensor}]", *_entries(_declared(spec, SensorSpec()))]
    if recording.truth is not None and recording.truth.kind:
        aligned = {"aligned": True} if recording.truth.aligned else {}
        lines += _table("truth", {"kind": recording.truth.kind, "known": recording.truth.known, **aligned})
    lines += _table("effects", {name: list(beta) for name, beta in recording.effects.items()})
    return "\n".join(lines) + "\n"


def growing_header(
    name: str, kind: str, environment: Environment, reference: str, rows: Mapping[str, int] | None
) -> str:
    """The text of `recording.toml` of a recording that is being written, or was just ended.

    Parameters
    ----------
    reference : kind of the reference; empty: there is none
    rows : of each CSV file; None: it goes on
    """
    lines = [WRITTEN_BY, "format = 1", f"name = {_value(name)}", f"kind = {_value(kind)}"]
    lines += ["unfinished = true"] if rows is None else ["", "[rows]", *(f"{key} = {n}" for key, n in rows.items())]
    lines += _table("environment", _declared(environment, Environment()))
    lines += _table("truth", {"kind": reference, "aligned": True} if reference else {})
    return "\n".join(lines) + "\n"


def _declared(record: object, default: object) -> dict[str, object]:
    """The fields of a record that differ from its defaults."""
    entries = {field.name: getattr(record, field.name) for field in fields(record)}  # type: ignore[arg-type]
    return {
        name: value for name, value in entries.items()
        if value is not None and (isinstance(value, np.ndarray) or value != getattr(default, name))
    }  # fmt: skip


def _table(name: str, entries: Mapping[str, object]) -> list[str]:
    return ["", f"[{name}]", *_entries(entries)] if entries else []


def _entries(entries: Mapping[str, object]) -> list[str]:
    return [f"{_key(name)} = {_value(value)}" for name, value in entries.items()]


def _key(name: str) -> str:
    bare = name and all(letter.isascii() and (letter.isalnum() or letter in "_-") for letter in name)
    return name if bare else _text(name)


def _value(value: object) -> str:
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, np.ndarray | list | tuple):
        return "[" + ", ".join(_value(entry) for entry in value) + "]"
    return repr(float(value))  # type: ignore[arg-type]


def _text(text: str) -> str:
    """A TOML basic string: JSON's escapes are TOML's, except that TOML escapes DEL and has no surrogate pairs."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
