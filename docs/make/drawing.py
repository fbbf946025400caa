"""The house style of the site's figures, and how they are kept: small, the same bytes from the same numbers."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

BEFORE, AFTER, SOFT, BAND = "#c8553d", "#0b6e99", "#8a97a5", "#e8eef3"
COLOURS = 48


def panels(columns: int = 1, rows: int = 1, height: float = 2.7, **options: Any) -> tuple[Figure, Any]:
    """A figure as wide as a page, and its axes (rows, columns)."""
    figure = Figure(figsize=(7.6, height * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    for one in axes.ravel():
        one.spines[["top", "right"]].set_visible(False)
        one.tick_params(labelsize=8)
        one.xaxis.label.set_size(9)
        one.yaxis.label.set_size(9)
    return figure, axes


def keep(figure: Figure, path: Path) -> None:
    """Write a picture of few colours."""
    from PIL import Image

    path.parent.mkdir(parents=True, exist_ok=True)
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=90, metadata={"Software": None})
    picture = Image.open(buffer).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    picture.save(path, optimize=True)
