"""Ground against objects, and both as grids: terrain model, surface model, heights of objects."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.files import write_text

#: Cloth: side of its mesh and height above it that is still ground [m]; 1: slack, follows hills; docs/notes/map.md.
RESOLUTION, THRESHOLD, RIGIDNESS = 0.5, 0.5, 1
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


@contextmanager
def _quiet() -> Iterator[None]:
    """The library writes its progress on standard output, past Python."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def ground_of(points: FloatArray) -> BoolArray:
    """(m,) which points are ground, by a cloth that falls on the cloud turned upside down.

    Parameters
    ----------
    points : (m, 3) east, north, up [m]

    Source: W. Zhang et al., Remote Sensing 8(6), 2016, 501; their library.

    Raises
    ------
    InputError : it is not installed
    """
    try:
        import CSF
    except ImportError:
        raise InputError("cloth-simulation-filter", "not installed", "`pip install 'sinan-nav[map]'`") from None
    filter = CSF.CSF()
    filter.params.bSloopSmooth = False
    filter.params.cloth_resolution = RESOLUTION
    filter.params.class_threshold = THRESHOLD
    filter.params.rigidness = RIGIDNESS
    filter.params.time_step = 1.0
    ground, objects = CSF.VecInt(), CSF.VecInt()
    with _quiet():
        filter.setPointCloud(np.ascontiguousarray(points))
        filter.do_filtering(ground, objects, False)
    found = np.zeros(len(points), dtype=bool)
    found[np.array(ground, dtype=np.int64)] = True
    return found


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

    Outside the ground's points no terrain is made up: NaN.
    """
    from scipy.interpolate import LinearNDInterpolator

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
    if np.count_nonzero(known) > 3:
        terrain[~known] = LinearNDInterpolator(middle[known], terrain[known])(middle[~known])
    objects = np.maximum(surface - terrain, 0.0)
    east, north = (float(value) for value in low)
    first, second, third = (Grid(z.reshape(rows, columns), east, north, cell) for z in (terrain, surface, objects))
    return first, second, third


def write_grid(path: Path, grid: Grid) -> None:
    """An ESRI ASCII grid; the northernmost row comes first."""
    rows, columns = grid.height.shape
    head = f"ncols {columns}\nnrows {rows}\nxllcorner {grid.east:.3f}\nyllcorner {grid.north:.3f}\n"
    head += f"cellsize {grid.cell:g}\nNODATA_value {NOTHING:g}\n"
    filled = np.where(np.isfinite(grid.height), grid.height, NOTHING)[::-1]
    lines = (" ".join(f"{value:.3f}" if value != NOTHING else f"{NOTHING:g}" for value in row) for row in filled)
    write_text(path, head + "\n".join(lines) + "\n")
