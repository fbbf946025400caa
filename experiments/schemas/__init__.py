"""JSON Schemas (draft 2020-12) of what the commands write as JSON and of the files that are read."""

from __future__ import annotations

from typing import Any

DRAFT = "https://json-schema.org/draft/2020-12/schema"


def titles() -> dict[str, str]:
    """The schemas by name, and of what they are."""
    from sinan.experiments.schemas.inputs import READ
    from sinan.experiments.schemas.outputs import sections
    from sinan.experiments.schemas.outputs import title as title_of

    return {name: title_of(name) for name in sections()} | {name: title for name, (title, _) in READ.items()}


def schema(name: str) -> dict[str, Any]:
    """One schema by its name.

    Raises
    ------
    InputError : no such schema
    """
    from sinan.experiments.schemas.inputs import READ, described
    from sinan.experiments.schemas.outputs import document
    from sinan.sensors.errors import InputError

    if name not in titles():
        raise InputError(name, "no such schema", "one of " + ", ".join(titles()))
    inner = described(name, READ[name][1]()) if name in READ else document(name)
    return {"$schema": DRAFT, "title": titles()[name], **inner}
