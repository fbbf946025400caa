"""`sinan estimate`: a flight -> states, biases and their consistency, as text, JSON and a page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

from estimator.filter import Engine
from experiments.datasets import reference_of, resolve
from experiments.estimate import bias_courses, estimated
from experiments.measured.preparation import prepared
from experiments.report.console import tell_notes
from experiments.report.files import write_json
from experiments.report.words import number, reference_name, reference_value
from experiments.residual_loop.open_source import require_kind
from sensors.errors import InputError


def run(
    input: str, engine: str, states: Path | None, map_file: Path | None, json: Path | None, html: Path | None
) -> str:
    """Run the filter, write what is asked for, return the summary for the terminal."""
    recording = resolve(input, map_file)
    tell_notes(recording)
    require_kind(recording, "flight", "estimate", "`sinan calibrate` or `sinan trace`")
    if engine not in get_args(Engine):
        raise InputError("--engine", engine, "one of " + ", ".join(get_args(Engine)))
    ready = prepared(recording)
    truth = reference_of(input, map_file)
    journal, document = estimated(ready.recording, engine, model=ready.model, truth=truth, states=states)  # type: ignore[arg-type]
    document["noise"] = list(ready.notes)
    if json is not None:
        write_json(json, document)
    if html is not None:
        from experiments.report.estimate_page import estimate_page

        estimate_page(html, recording.name, document, bias_courses(journal, truth))
    return summary(recording.name, document)


def summary(name: str, document: Mapping[str, Any]) -> str:
    """Biases with their uncertainty, NIS, and errors against the reference where there is one."""
    lines = [f"{name}: {number(document['duration'])} s"]
    for sensor, values in document["bias"].items():
        parts = zip(_listed(values), _listed(document["bias_std"][sensor]), strict=True)
        lines.append(f"  {sensor} bias  " + ", ".join(f"{number(b)} ± {number(s)}" for b, s in parts))
    for sensor, nis in document["nis"].items():
        rejected = document["rejected"].get(sensor, 0)
        lines.append(f"  {sensor} NIS a degree of freedom {number(nis)}, {rejected} readings refused")
    for quantity, value in (document.get("truth") or {}).items():
        if quantity.endswith("_rms"):
            lines.append(f"  {reference_name(quantity)}: {reference_value(quantity, value)}")
    lines += [f"  note: {note}" for note in [*document["noise"], *document.get("notes", [])]]
    return "\n".join(lines)


def _listed(values: Any) -> list[float]:
    return list(values) if isinstance(values, list | tuple) else [values]
