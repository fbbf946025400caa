"""`sinan map`: a flight with a scanning laser -> point cloud, terrain, surface, objects, error budget, strips."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sinan.calibration.levels.preparation import settled
from sinan.estimator.filter.smoother import estimated_motion, smooth
from sinan.experiments.datasets import called, resolve
from sinan.experiments.mapping.budget import Sigmas, budget
from sinan.experiments.mapping.cloud import Cloud, Mounting, Scans, cloud_of, east_north_up, write_las
from sinan.experiments.mapping.strips import SOUGHT, StripFit, fit_strips, strips_of
from sinan.experiments.mapping.terrain import Grid, grids_of, ground_of, write_grid
from sinan.experiments.report.console import tell_notes, working
from sinan.experiments.report.files import write_json
from sinan.experiments.residual_loop.open_source import require_kind
from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.motion import Motion
from sinan.sensors.recording import Recording
from sinan.sensors.window import WHOLE, Span

#: 1-sigma of what no recording declares: a beam's angle [rad], boresight [rad], lever arm [m], stamps [s].
ASSUMED_ANGLE, ASSUMED_BORESIGHT, ASSUMED_LEVER_ARM, ASSUMED_TIME = 1e-3, 5e-3, 0.02, 2e-3


def run(
    input: str,
    out: Path,
    cell: float,
    adjust: bool,
    map_file: Path | None,
    span: Span = WHOLE,
    choice: Choice = FIRST,
) -> str:
    """Make the map, write its files, return the summary for the terminal."""
    recording = resolve(input, map_file, span, choice)
    tell_notes(recording)
    require_kind(recording, "flight", "map", "a flight with a scanning laser")
    scans = scans_of(recording)
    declared = declared_mounting(recording)
    with working("running the filter", flies=True):
        motion, sigmas = trajectory(recording)
    inside = (scans.t - 0.2 > motion.t[0]) & (scans.t + 0.2 < motion.t[-1])
    scans = Scans(scans.t[inside], scans.ranges[inside], scans.angles, scans.intensity[inside[: len(scans.intensity)]])
    if not np.any(np.isfinite(scans.ranges)):
        raise InputError(recording.where, "no scan within the IMU's time", "scans during the flight", "stream laser")
    with working("making the map"):
        strip = strips_of(motion, scans.t)
        fit = fit_strips(scans, motion, strip, declared)
        mounting = fit.mounting if adjust and fit is not None else declared
        cloud = cloud_of(scans, motion, mounting, strip)
        points = east_north_up(cloud.p_n, recording.origin)
        ground = ground_of(points)
        grids = grids_of(points, ground, cell)
        parts = budget(scans, motion, with_fit(sigmas, fit if adjust else None), mounting)
    told = as_json(cloud, ground, fit, parts, adjust) | {"called": called(input, recording, span), "cell": cell}
    write(out, cloud, ground, grids, told, recording)
    return summary(told, out)


def scans_of(recording: Recording) -> Scans:
    """The laser's scans; a single beam is a scan of one.

    Raises
    ------
    InputError : no laser
    """
    stream = recording.streams.get("laser")
    if stream is None:
        raise InputError(recording.where, f"streams {', '.join(recording.streams)}", "a stream laser")
    if "range" in stream:
        angles, names = np.zeros(1), ["range"]
    else:
        angles = np.asarray(recording.spec("laser").angles)
        names = [f"range_{k}" for k in range(len(angles))]
    ranges = stream.array(names)
    bright = [name.replace("range", "intensity") for name in names]
    intensity = stream.array(bright) if stream.has(bright) else np.empty((0, len(names)))
    return Scans(stream.t, np.where(ranges > 0.0, ranges, np.nan), angles, intensity)


def declared_mounting(recording: Recording) -> Mounting:
    """What `[effects]` of the recording says of the laser."""
    told = {name: np.asarray(beta, dtype=np.float64) for name, beta in recording.effects.items()}
    return Mounting(
        told.get("laser.boresight", np.zeros(2)),
        told.get("laser.lever_arm", np.zeros(3)),
        float(told.get("laser.time_offset", np.zeros(1))[0]),
    )


def trajectory(recording: Recording) -> tuple[Motion, Sigmas]:
    """The smoothed motion, and its median 1-sigma with what else a point depends on.

    The laser takes no part: the filter takes the ground for flat, and the map is there to show that it is not. A base
    receiver of the recording does (DGPS).
    """
    streams = {name: stream for name, stream in recording.streams.items() if name != "laser"}
    effects = {name: beta for name, beta in recording.effects.items() if not name.startswith("laser.")}
    journal = settled(recording.replace(streams=streams, effects=effects)).run()
    smoothed = smooth(journal, sigmas=True)
    motion = estimated_motion(journal, smoothed=smoothed)
    sigma = np.median(smoothed.sigma, axis=0)
    spec = recording.spec("laser")
    return motion, Sigmas(
        spec.noise_std or 0.03, ASSUMED_ANGLE, sigma[6:9], sigma[0:3], np.full(2, ASSUMED_BORESIGHT),
        np.full(3, ASSUMED_LEVER_ARM), ASSUMED_TIME,
    )  # fmt: skip


def with_fit(sigmas: Sigmas, fit: StripFit | None) -> Sigmas:
    """The same with what the strips say of the mounting."""
    if fit is None:
        return sigmas
    arm = np.array([fit.sigma[2], fit.sigma[3], ASSUMED_LEVER_ARM])
    return replace(sigmas, boresight=fit.sigma[:2], lever_arm=arm, time=float(fit.sigma[4]))


def as_json(
    cloud: Cloud, ground: BoolArray, fit: StripFit | None, parts: dict[str, tuple[float, float]], adjust: bool
) -> dict[str, Any]:
    """Counts, what the strips show, the budget."""
    strips = None
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
        "points": len(cloud),
        "ground_points": int(np.count_nonzero(ground)),
        "strip_count": int(cloud.strip.max()) + 1,
        "intensity": bool(cloud.intensity.size),
        "strips": strips,
        "budget": {cause: {"horizontal": h, "vertical": v} for cause, (h, v) in parts.items()},
    }


def write(
    out: Path, cloud: Cloud, ground: BoolArray, grids: tuple[Grid, Grid, Grid], told: dict[str, Any],
    recording: Recording,
) -> None:  # fmt: skip
    """The cloud, three grids with a picture each, the numbers and the page."""
    from sinan.experiments.report.map_page import map_page

    out.mkdir(exist_ok=True)
    write_las(out / "cloud.laz", cloud, ground, recording.origin)
    for name, grid in zip(("terrain", "surface", "objects"), grids, strict=True):
        write_grid(out / f"{name}.asc", grid)
    write_json(out / "map.json", told)
    map_page(out, told, grids)


def summary(told: dict[str, Any], out: Path) -> str:
    """Points, strips, budget, files."""
    lines = [f"{told['called']}: {told['points']} points, {told['ground_points']} of them ground, "
             f"in {told['strip_count']} strips"]  # fmt: skip
    strips = told["strips"]
    if strips is None:
        lines.append("  strips: too few overlap to show the mounting")
    else:
        done = "applied" if strips["applied"] else "not applied: --adjust does"
        before, after = strips["rms_before"], strips["rms_after"]
        lines.append(f"  strips differ by {before:.3f} m RMS in height, by {after:.3f} m with ({done})")
        lines += [f"    {mounting_words(one)}" for one in strips["found"]]
    lines.append("  error of a point, 1 sigma: horizontal, vertical / m")
    for cause, one in told["budget"].items():
        lines.append(f"    {cause:10} {one['horizontal']:.3f}  {one['vertical']:.3f}")
    files = ", ".join(str(out / name) for name in ("cloud.laz", "terrain.asc", "index.html"))
    return "\n".join([*lines, f"files: {files} ..."])


def mounting_words(one: dict[str, Any]) -> str:
    """`laser.boresight roll 0.0100 ± 0.0001 rad`."""
    unit = {"laser.boresight": "rad", "laser.lever_arm": "m", "laser.time_offset": "s"}[one["effect"]]
    part = "" if one["component"] == "b" else f" {one['component']}"
    told = f"{one['value']:.4f} ± {one['std']:.4f} {unit}" if one["determined"] else "not determined by these strips"
    return f"{one['effect']}{part} {told}"


def shaded(grid: Grid) -> FloatArray:
    """(rows, columns) brightness of a relief with the sun in the north-west, 0 to 1; NaN where nothing is known."""
    slope_n, slope_e = np.gradient(grid.height, grid.cell)
    sun = np.array([-1.0, 1.0, 1.2]) / np.sqrt(1.0 + 1.0 + 1.44)  # east, north, up
    light = (-slope_e * sun[0] - slope_n * sun[1] + sun[2]) / np.sqrt(1.0 + slope_e**2 + slope_n**2)
    return np.asarray(np.clip(light, 0.0, 1.0))
