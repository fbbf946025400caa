"""Ground against objects, and both as grids: terrain model, surface model, heights of objects."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.files import write_text

#: The published settings of the filter: side of a cell [m], slope of the ground, radius of the largest object [m],
#: height above the provisional ground that is still ground [m], and what a slope adds to it [m].
CELL, SLOPE, RADIUS, THRESHOLD, BY_SLOPE = 1.0, 0.15, 18.0, 0.5, 1.25
#: A single cell that lies so much below all about it is an echo of an echo [m].
PIT = 2.0
#: So far from where a beam fell the terrain is told [m].
REACH = 2.0
#: What an empty cell says in a file.
NOTHING = -9999.0


@dataclass(frozen=True)
class Grid:
    """A raster of heights.

    Attributes
    ----------
    height : (rows, columns) m, first row the southernmost; NaN: nothing known
    east, north : of the lower left corner [m]
    cell : side [m]
    """

    height: FloatArray
    east: float
    north: float
    cell: float


def ground_of(points: FloatArray) -> BoolArray:
    """(m,) which points are ground, by the simple morphological filter.

    The lowest points of cells are opened with discs of growing radius r; what an opening takes down by more than
    `SLOPE` r is no ground. Between the cells that are left lies the provisional ground (linear), and points that are
    hardly above it are ground. docs/notes/ground.md compares it with a cloth.

    Parameters
    ----------
    points : (m, 3) east, north, up [m]

    Neglects objects that are wider than 2 `RADIUS` and ground that stands up like one. The published filter fills gaps
    by springs, and takes points below the provisional ground for no ground too.

    Source: T. J. Pingel, K. C. Clarke, W. A. McBride, ISPRS J. Photogrammetry and Remote Sensing 77, 2013.
    """
    from scipy.ndimage import map_coordinates

    low = points[:, :2].min(axis=0)
    place = (points[:, :2] - low) / CELL
    lowest = _lowest(np.floor(place).astype(np.int64), points[:, 2])
    ground = _linear(np.where(_stands(lowest), np.nan, lowest))
    slope = np.hypot(*np.gradient(ground, CELL)) if min(ground.shape) > 1 else np.zeros_like(ground)
    at, steep = (map_coordinates(one, place.T - 0.5, order=1, mode="nearest") for one in (ground, slope))
    return np.asarray(points[:, 2] - at < THRESHOLD + BY_SLOPE * steep)


def _lowest(place: IntArray, up: FloatArray) -> FloatArray:
    """The lowest height in every cell; NaN: no point there."""
    lowest = np.full(place.max(axis=0) + 1, np.inf)
    np.minimum.at(lowest, tuple(place.T), up)
    return np.where(np.isinf(lowest), np.nan, lowest)


def _stands(lowest: FloatArray) -> BoolArray:
    """Cells that are empty, a pit, or on something that stands on the ground."""
    from scipy.ndimage import distance_transform_edt

    none = np.isnan(lowest)
    nearest = distance_transform_edt(none, return_distances=False, return_indices=True)
    height = lowest[tuple(nearest)]
    pit = -_opened(-height, 1) - height > PIT
    height = np.where(pit, -_opened(-height, 1), height)
    found = none | pit
    for radius in range(1, int(np.ceil(RADIUS / CELL)) + 1):
        opened = _opened(height, radius)
        found |= height - opened > SLOPE * radius * CELL
        height = opened
    return found


def _opened(height: FloatArray, radius: int) -> FloatArray:
    """Opening with an octagon, which squares and crosses in turn make."""
    from scipy.ndimage import generate_binary_structure, maximum_filter, minimum_filter

    shapes = generate_binary_structure(2, 1), generate_binary_structure(2, 2)
    for step in range(radius):
        height = minimum_filter(height, footprint=shapes[step % 2], mode="nearest")
    for step in range(radius):
        height = maximum_filter(height, footprint=shapes[step % 2], mode="nearest")
    return height


def _linear(height: FloatArray) -> FloatArray:
    """Cells that are NaN filled linearly between the others, beyond them by the nearest."""
    from scipy.interpolate import LinearNDInterpolator
    from scipy.ndimage import distance_transform_edt

    unknown = np.isnan(height)
    if not unknown.any() or unknown.all():
        return np.zeros_like(height) if unknown.all() else height
    filled = height.copy()
    known = np.argwhere(~unknown)
    if np.all(np.ptp(known, axis=0) > 0):
        filled[unknown] = LinearNDInterpolator(known, height[~unknown])(np.argwhere(unknown))
    beyond = np.isnan(filled)
    nearest = distance_transform_edt(beyond, return_distances=False, return_indices=True)
    return np.asarray(filled[tuple(nearest)])


def lowest_is_ground(points: FloatArray, cell: float = 2.0, threshold: float = THRESHOLD) -> BoolArray:
    """(m,) the plain way, to compare with: what is not far above the lowest point of its cell."""
    key = np.floor(points[:, :2] / cell).astype(np.int64)
    _, where = np.unique(key, axis=0, return_inverse=True)
    lowest = np.full(where.max() + 1, np.inf)
    np.minimum.at(lowest, where.ravel(), points[:, 2])
    return np.asarray(points[:, 2] - lowest[where.ravel()] < threshold)


def grids_of(points: FloatArray, ground: BoolArray, cell: float) -> tuple[Grid, Grid, Grid]:
    """Terrain (mean of the ground's points, linear between them), surface (highest point), objects (their difference).

    Parameters
    ----------
    points : (m, 3) east, north, up [m]
    ground : (m,)
    cell : m

    Where no beam fell within `REACH`, and outside the ground's points, no terrain is made up: NaN.
    """
    from scipy.interpolate import LinearNDInterpolator
    from scipy.ndimage import distance_transform_edt

    low = np.floor(points[:, :2].min(axis=0) / cell) * cell
    place = np.floor((points[:, :2] - low) / cell).astype(np.int64)
    columns, rows = place.max(axis=0) + 1
    flat = place[:, 1] * columns + place[:, 0]
    surface = np.full(rows * columns, -np.inf)
    np.maximum.at(surface, flat, points[:, 2])
    surface[np.isneginf(surface)] = np.nan
    count = np.bincount(flat[ground], minlength=rows * columns)
    total = np.bincount(flat[ground], weights=points[ground, 2], minlength=rows * columns)
    known = count > 0
    terrain = np.full(rows * columns, np.nan)
    terrain[known] = total[known] / count[known]
    middle = np.column_stack([np.tile(np.arange(columns), rows), np.repeat(np.arange(rows), columns)]) + 0.5
    beam = np.isfinite(surface).reshape(rows, columns)
    seen = distance_transform_edt(~beam).ravel() * cell <= REACH
    if np.count_nonzero(known) > 3:
        gaps = ~known & seen
        terrain[gaps] = LinearNDInterpolator(middle[known], terrain[known])(middle[gaps])
    objects = np.maximum(surface - terrain, 0.0)
    east, north = (float(value) for value in low)
    first, second, third = (Grid(z.reshape(rows, columns), east, north, cell) for z in (terrain, surface, objects))
    return first, second, third


def shaded(grid: Grid) -> FloatArray:
    """(rows, columns) brightness of a relief with the sun in the north-west, 0 to 1; NaN where nothing is known."""
    slope_n, slope_e = np.gradient(grid.height, grid.cell)
    sun = np.array([-1.0, 1.0, 1.2]) / np.sqrt(1.0 + 1.0 + 1.44)  # east, north, up
    light = (-slope_e * sun[0] - slope_n * sun[1] + sun[2]) / np.sqrt(1.0 + slope_e**2 + slope_n**2)
    return np.asarray(np.clip(light, 0.0, 1.0))


def write_grid(path: Path, grid: Grid) -> None:
    """An ESRI ASCII grid; the northernmost row comes first."""
    rows, columns = grid.height.shape
    head = f"ncols {columns}\nnrows {rows}\nxllcorner {grid.east:.3f}\nyllcorner {grid.north:.3f}\n"
    head += f"cellsize {grid.cell:g}\nNODATA_value {NOTHING:g}\n"
    filled = np.where(np.isfinite(grid.height), grid.height, NOTHING)[::-1]
    lines = (" ".join(f"{value:.3f}" if value != NOTHING else f"{NOTHING:g}" for value in row) for row in filled)
    write_text(path, head + "\n".join(lines) + "\n")
