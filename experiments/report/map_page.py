"""The page of a map: shaded reliefs, what the strips show, the error budget."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sinan.experiments.mapping.making import Map
from sinan.experiments.mapping.obstacles import ScanInPlane, scan_in_plane
from sinan.experiments.mapping.strips import mounting_words
from sinan.experiments.mapping.terrain import Grid, shaded
from sinan.experiments.report.figures import AFTER, BEFORE, new_figure
from sinan.experiments.report.page import Page, png
from sinan.sensors.files import write_bytes

#: Obstacles that the page names; the JSON has all.
MOST = 20


def map_page(out: Path, document: Mapping[str, Any], made: Map) -> None:
    """Write `index.html` and a picture of each grid into the folder."""
    page = Page(
        f"{document['called']}: a map",
        f"{document['points']} points, {document['ground_points']} of them ground, "
        f"in {document['strip_count']} strips.",
    )
    add_pictures(page, made, out)
    add_strips(page, document["strips"])
    page.heading("Error of a point")
    page.figure(bars(document["budget"]), "1-sigma by cause, RMS over the points.")
    page.text(
        "Attitude and position: the smoother's. Range: declared. Angle, mounting and time: assumed for instruments of "
        "this class, or, where the map has it in it, what the strips say.", note=True,
    )  # fmt: skip
    page.write(out / "index.html")


def add_pictures(page: Page, made: Map, out: Path | None = None) -> None:
    """Terrain, surface, objects, their obstacles, one scan; the first three into the folder too."""
    words = (
        ("terrain", "The ground: mean of its points, linear between them, shaded from the north-west."),
        ("surface", "The highest point of every cell: ground and what stands on it."),
        ("objects", "How high it stands above the ground."),
    )
    for name, caption in words:
        figure = relief(getattr(made, name)) if name != "objects" else heights(made.objects)
        if out is not None:
            write_bytes(out / f"{name}.png", png(figure))
        page.figure(figure, caption)
    page.heading("Obstacles")
    if not made.obstacles:
        page.text("Nothing stands a metre above the ground.")
        return
    rows = [[f"{v:.1f}" for v in (o.east, o.north, o.height, o.area)] for o in made.obstacles[:MOST]]
    page.table(["east / m", "north / m", "height / m", "area / m²"], rows, (0, 1, 2, 3))
    scan = scan_in_plane(made.cloud, made.ground, made.motion)
    near = "; ".join(f"{left:.1f} to {right:.1f} m, {away:.1f} m away" for left, right, away in scan.obstacles())
    page.figure(profile(scan), f"One scan in its plane, from the body. Across it stands something at {near}.")


def add_strips(page: Page, strips: Mapping[str, Any] | None) -> None:
    """What the strips show of the mounting."""
    page.heading("What the strips show")
    if strips is None:
        page.text("Too few strips overlap to show how the laser is mounted.")
        return
    done = "The map has it in it." if strips["applied"] else "The map is made without it."
    page.text(
        f"Where two strips overlap their surfaces differ by {strips['rms_before']:.3f} m RMS in height, and by "
        f"{strips['rms_after']:.3f} m with the mounting below. {done}"
    )
    page.table(["", "found"], [list(mounting_words(one)) for one in strips["found"]])


def profile(scan: ScanInPlane) -> Figure:
    """Points of one scan, ground and objects."""
    figure, axes = new_figure(1, 1, 3.2)
    one = axes[0, 0]
    for on, colour, label in ((False, BEFORE, "ground"), (True, AFTER, "object")):
        chosen = scan.on_object == on
        one.plot(scan.across[chosen], scan.up[chosen], ".", color=colour, label=label)
    one.plot([0.0], [0.0], "k^", label="body")
    one.set_aspect("equal", adjustable="datalim")
    one.set_xlabel("to the right / m", fontsize=9)
    one.set_ylabel("upwards / m", fontsize=9)
    one.legend(frameon=False, fontsize=9)
    return figure


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
