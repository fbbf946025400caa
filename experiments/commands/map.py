"""`sinan map`: a flight with a scanning laser -> point cloud, terrain, surface, objects, error budget, strips."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sinan.experiments.datasets import called, resolve
from sinan.experiments.mapping.cloud import write_las
from sinan.experiments.mapping.making import Map, mapped
from sinan.experiments.mapping.strips import SOUGHT, mounting_words
from sinan.experiments.mapping.terrain import write_grid
from sinan.experiments.report.console import tell_notes, working
from sinan.experiments.report.files import write_json
from sinan.experiments.report.words import counted
from sinan.experiments.residual_loop.open_source import require_kind
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.recording import Recording
from sinan.sensors.window import WHOLE, Span


def run(
    input: str,
    out: Path,
    cell: float,
    adjust: bool,
    map_file: Path | None,
    json: Path | None = None,
    span: Span = WHOLE,
    choice: Choice = FIRST,
) -> str:
    """Make the map, write its files, return the summary for the terminal."""
    recording = resolve(input, map_file, span, choice)
    tell_notes(recording)
    require_kind(recording, "flight", "map", "a flight with a scanning laser")
    with working("running the filter and making the map", flies=True):
        made = mapped(recording, cell, adjust)
    document = as_json(made, adjust) | {"called": called(input, recording, span), "cell": cell}
    write(out, made, document, recording)
    if json is not None:
        write_json(json, document)
    return summary(document, out)


def as_json(made: Map, adjust: bool) -> dict[str, Any]:
    """Counts, what the strips show, the budget, obstacles."""
    fit, strips = made.fit, None
    if fit is not None:
        strips = {
            "comparisons": fit.cells,
            "rms_before": fit.before,
            "rms_after": fit.after,
            "applied": adjust,
            "found": [
                {
                    "effect": name,
                    "component": part,
                    "value": float(fit.beta[k]),
                    "std": float(fit.sigma[k]),
                    "determined": fit.determined(k),
                }
                for k, (name, part, _) in enumerate(SOUGHT)
            ],
        }
    return {
        "format": 1,
        "points": len(made.cloud),
        "ground_points": int(np.count_nonzero(made.ground)),
        "strip_count": int(made.cloud.strip.max()) + 1,
        "intensity": bool(made.cloud.intensity.size),
        "strips": strips,
        "budget": {cause: {"horizontal": h, "vertical": v} for cause, (h, v) in made.budget.items()},
        "obstacles": [vars(one) for one in made.obstacles],
    }


def write(out: Path, made: Map, document: dict[str, Any], recording: Recording) -> None:
    """The cloud, three grids with a picture each, and the page."""
    from sinan.experiments.report.map_page import map_page

    out.mkdir(parents=True, exist_ok=True)
    write_las(out / "cloud.laz", made.cloud, made.ground, recording.origin)
    for name in ("terrain", "surface", "objects"):
        write_grid(out / f"{name}.asc", getattr(made, name))
    map_page(out, document, made)


def summary(document: dict[str, Any], out: Path) -> str:
    """Points, strips, budget, files."""
    lines = [f"{document['called']}: {document['points']} points, {document['ground_points']} of them ground, "
             f"in {document['strip_count']} strips"]  # fmt: skip
    strips = document["strips"]
    if strips is None:
        lines.append("  strips: too few overlap to show the mounting")
    else:
        done = "applied" if strips["applied"] else "not applied"
        before, after = strips["rms_before"], strips["rms_after"]
        lines.append(f"  strips differ by {before:.3f} m RMS in height, by {after:.3f} m with ({done})")
        lines += ["    {}: {}".format(*mounting_words(one)) for one in strips["found"]]
    lines.append("  error of a point, 1 sigma: horizontal, vertical / m")
    for cause, one in document["budget"].items():
        lines.append(f"    {cause:10} {one['horizontal']:.3f}  {one['vertical']:.3f}")
    if document["obstacles"]:
        one = document["obstacles"][0]
        count = counted(len(document["obstacles"]), "obstacle")
        place = f"{one['east']:.1f} m east, {one['north']:.1f} m north"
        lines.append(f"  {count} above a metre, the highest {one['height']:.1f} m at {place}")
    files = ", ".join(str(out / name) for name in ("cloud.laz", "terrain.asc", "index.html"))
    return "\n".join([*lines, f"files: {files} ..."])
