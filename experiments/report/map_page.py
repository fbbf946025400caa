"""The page of a map: shaded reliefs, what the strips show, the error budget."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sinan.experiments.commands.map import mounting_words, shaded
from sinan.experiments.mapping.terrain import Grid
from sinan.experiments.report.figures import AFTER, BEFORE, new_figure
from sinan.experiments.report.page import Page, png
from sinan.sensors.files import write_bytes


def map_page(out: Path, told: Mapping[str, Any], grids: tuple[Grid, Grid, Grid]) -> None:
    """Write `index.html` and a picture of each grid into the folder."""
    page = Page(
        f"{told['called']}: a map",
        f"{told['points']} points, {told['ground_points']} of them ground, in {told['strip_count']} strips.",
    )
    words = (
        ("terrain", "The ground: mean of its points, linear between them, shaded from the north-west."),
        ("surface", "The highest point of every cell: ground and what stands on it."),
        ("objects", "How high it stands above the ground."),
    )
    for (name, caption), grid in zip(words, grids, strict=True):
        figure = relief(grid) if name != "objects" else heights(grid)
        write_bytes(out / f"{name}.png", png(figure))
        page.figure(figure, caption)
    page.heading("What the strips show")
    strips = told["strips"]
    if strips is None:
        page.text("Too few strips overlap to show how the laser is mounted.")
    else:
        done = "The map has it in it." if strips["applied"] else "The map is made without it; `--adjust` takes it in."
        page.text(
            f"Where two strips overlap their surfaces differ by {strips['rms_before']:.3f} m RMS in height, and by "
            f"{strips['rms_after']:.3f} m with the mounting below. {done}"
        )
        page.table(["", "found"], [split(mounting_words(one)) for one in strips["found"]])
    page.heading("Error of a point")
    page.figure(bars(told["budget"]), "1-sigma by cause, RMS over the points.")
    page.text(
        "Attitude and position: the smoother's. Range: declared. Angle, mounting and time: assumed for instruments of "
        "this class, or, with `--adjust`, what the strips say.", note=True,
    )  # fmt: skip
    page.write(out / "index.html")


def split(words: str) -> list[str]:
    """Name and value."""
    parts = words.split(" ")
    count = 2 if parts[1] in ("roll", "pitch", "x", "y") else 1
    return [" ".join(parts[:count]), " ".join(parts[count:])]


def _extent(grid: Grid) -> tuple[float, float, float, float]:
    rows, columns = grid.height.shape
    return grid.east, grid.east + columns * grid.cell, grid.north, grid.north + rows * grid.cell


def relief(grid: Grid) -> Figure:
    """Shaded, with the height as colour."""
    figure, axes = new_figure(1, 1, 6.0)
    one = axes[0, 0]
    picture = one.imshow(grid.height, origin="lower", extent=_extent(grid), cmap="terrain")
    one.imshow(shaded(grid), origin="lower", extent=_extent(grid), cmap="gray", vmin=0.0, vmax=1.0, alpha=0.45)
    figure.colorbar(picture, ax=one, label="height / m", shrink=0.8)
    one.set_xlabel("east / m", fontsize=9)
    one.set_ylabel("north / m", fontsize=9)
    return figure


def heights(grid: Grid) -> Figure:
    """Heights above the ground."""
    figure, axes = new_figure(1, 1, 6.0)
    one = axes[0, 0]
    known = grid.height[np.isfinite(grid.height)]
    most = max(float(np.max(known)), 0.1) if known.size else 1.0
    picture = one.imshow(grid.height, origin="lower", extent=_extent(grid), cmap="viridis", vmin=0.0, vmax=most)
    figure.colorbar(picture, ax=one, label="above the ground / m", shrink=0.8)
    one.set_xlabel("east / m", fontsize=9)
    one.set_ylabel("north / m", fontsize=9)
    return figure


def bars(budget: Mapping[str, Mapping[str, float]]) -> Figure:
    """Horizontal and vertical sigma of each cause."""
    figure, axes = new_figure(1, 1, 2.8)
    one, y = axes[0, 0], np.arange(len(budget))[::-1]
    one.barh(y + 0.2, [part["horizontal"] for part in budget.values()], 0.38, color=AFTER, label="horizontal")
    one.barh(y - 0.2, [part["vertical"] for part in budget.values()], 0.38, color=BEFORE, label="vertical")
    one.set_yticks(y, list(budget))
    one.set_xlabel("1 sigma / m", fontsize=9)
    one.legend(frameon=False, fontsize=9)
    return figure
