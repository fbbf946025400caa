"""What a study of pseudoranges says, as text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sinan.experiments.report.words import length, number, shown_stages, stage_names


def summary(document: Mapping[str, Any]) -> str:
    """The result in a few lines."""
    lines = [f"{document['recording']}: {document['epochs']} epochs, {', '.join(document['systems'])}"]
    lines[0] += f"; position errors against {document['reference']}" if document.get("reference") else ""
    lines.append(f"  verdict: {document['verdict']}")
    stages = shown_stages(document)
    width = max(map(len, stage_names(stages)))
    for name, stage in zip(stage_names(stages), stages, strict=True):
        error = stage.get("position_error")
        text = f"  {name:{width}}  residual {number(stage['residual_rms'])} m RMS"
        lines.append(text + (f", position error {number(error['mean'])} m mean" if error else ""))
    if document.get("noise"):
        nis = document["noise"]["nis_per_dof"]
        sizes = ", ".join(f"{name} {size:.2f}" for name, size in document["noise"]["system"].items())
        lines.append(
            f"  noise of a range by likelihood, m: {sizes}; NIS {number(nis['fixed'])} -> {number(nis['fitted'])}"
        )
    dgps = document.get("dgps")
    if dgps:
        error = dgps.get("position_error")
        text = f"  with corrections of the base, {length(dgps['baseline'])} away"
        lines.append(text + (f": position error {number(error['mean'])} m mean" if error else ""))
    lines += [f"  excluded: {item['satellite']} in {item['epochs']} epochs" for item in document["excluded"]]
    lines += [f"  note: {note}" for note in document["journal"]]
    return "\n".join(lines)
