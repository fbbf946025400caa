"""Laser, GPS and IMU make a map of made-up country; its strips show how the laser is mounted."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sinan.experiments.mapping.budget import CAUSES
from sinan.experiments.mapping.cloud import Mounting, Scans, placed
from sinan.experiments.mapping.flight import ANGLES, surveyed
from sinan.experiments.mapping.making import Map, mapped
from sinan.experiments.mapping.scene import COUNTRY
from sinan.experiments.mapping.strips import SOUGHT
from sinan.experiments.mapping.terrain import Grid
from sinan.experiments.report.map_page import add_pictures, bars
from sinan.experiments.report.page import Page
from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.recording import Recording

#: How the laser is mounted, which the recording does not say.
CROOKED = Mounting(np.array([0.02, -0.03]), np.array([0.1, -0.05, 0.0]), 0.02)
SEED, CELL = 1, 1.0


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """The map of a flight with a crooked, late laser, without and with what its strips show."""
    recording, truth = surveyed(COUNTRY, CROOKED, SEED)
    crooked, made = mapped(recording, CELL, adjust=False), mapped(recording, CELL)
    assert made.fit is not None
    true = np.array([*CROOKED.boresight, *CROOKED.lever_arm[:2], CROOKED.time_offset])
    rows = []
    for k, (name, part, _) in enumerate(SOUGHT):
        words = f"{made.fit.beta[k]:.4f} ± {made.fit.sigma[k]:.4f}"
        say(f"{name} {part}: {words}, hidden {true[k]:.4f}")
        rows.append([f"{name} {part}", words, f"{true[k]:.4f}"])
    scores = [scores_of(one, recording, truth) for one in (crooked, made)]
    for name, before, after in zip(SCORES, *scores, strict=True):
        say(f"{name}: {before:.3f} as declared, {after:.3f} with what the strips show")
    page = Page(
        "A map by laser, GPS and IMU",
        "A multicopter with DGPS flies strips over hills, houses and trees, with a laser that is neither straight nor "
        "in the centre nor on time. The recording says nothing of it. Surfaces of overlapping strips have to be one: "
        "that shows how it is mounted. Then the cloud, and what of it is ground.",
    )
    page.table(["", "found", "hidden"], rows, (1, 2))
    page.table(
        ["", "as declared", "with what the strips show"],
        [[name, f"{before:.3f}", f"{after:.3f}"] for name, before, after in zip(SCORES, *scores, strict=True)],
        (1, 2),
    )
    add_pictures(page, made)
    page.heading("Error of a point")
    causes = {cause: made.budget[cause] for cause in (*CAUSES, "together")}
    page.figure(bars({cause: {"horizontal": h, "vertical": v} for cause, (h, v) in causes.items()}),
                "1-sigma by cause, RMS over the points: what to expect without the truth.")  # fmt: skip
    page.write(out / "laser_map.html")


SCORES = (
    "points, horizontal error / m RMS", "points, vertical error / m RMS", "terrain, error / m RMS",
    "ground called object / %", "objects called ground / %",
)  # fmt: skip


def scores_of(made: Map, recording: Recording, truth: Motion) -> tuple[float, ...]:
    """The numbers of `SCORES`."""
    p_true, on_object = true_points(made, recording, truth)
    error = made.cloud.p_n - p_true
    level = -(made.points[:, 2] + made.cloud.p_n[:, 2])  # of the map's heights, which are ellipsoidal
    return (
        float(np.sqrt(np.mean(error[:, 0] ** 2 + error[:, 1] ** 2))),
        float(np.sqrt(np.mean(error[:, 2] ** 2))),
        terrain_error(made.terrain, float(np.median(-level))),
        100.0 * float(np.mean(~made.ground[~on_object])),
        100.0 * float(np.mean(made.ground[on_object])),
    )


def true_points(made: Map, recording: Recording, truth: Motion) -> tuple[FloatArray, BoolArray]:
    """(m, 3) where the beams of the cloud's points are by true trajectory and mounting, and whether on an object.

    The readings' noise is in it, some centimetres along the beam.
    """
    stream = recording.streams["laser"]
    ranges = stream.array([f"range_{k}" for k in range(len(ANGLES))])
    scans = Scans(truth.t, np.where(ranges > 0.0, ranges, np.nan), ANGLES, np.empty(0))
    inside = np.isin(stream.t, made.cloud.t)
    points = placed(scans, truth, Mounting(CROOKED.boresight, CROOKED.lever_arm))[inside]
    points = points[np.isfinite(scans.ranges[inside])]
    return points, -points[:, 2] - COUNTRY.bare(points[:, 0], points[:, 1]) > NOISE


NOISE = 0.15  # m, of a point's height: what is higher is no ground


def terrain_error(terrain: Grid, origin: float) -> float:
    """RMS error of the terrain model where it knows the ground [m]."""
    rows, columns = terrain.height.shape
    north = np.asarray(terrain.north + (np.arange(rows)[:, None] + 0.5) * terrain.cell, dtype=np.float64)
    east = np.asarray(terrain.east + (np.arange(columns)[None, :] + 0.5) * terrain.cell, dtype=np.float64)
    error = terrain.height - origin - COUNTRY.bare(north, east)
    return float(np.sqrt(np.nanmean(error**2)))
