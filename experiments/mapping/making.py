"""A map from a recording: trajectory, strips, points, ground, grids, obstacles, budget."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sinan.calibration.levels.preparation import prepared
from sinan.estimator.filter.layout import DP, DTHETA
from sinan.estimator.filter.smoother import estimated_motion, joint_covariance
from sinan.experiments.mapping.budget import Sigmas, budget
from sinan.experiments.mapping.cloud import Cloud, Mounting, Scans, cloud_of, east_north_up
from sinan.experiments.mapping.obstacles import Obstacle, obstacles_of
from sinan.experiments.mapping.strips import KNOT, Drift, StripFit, fit_strips, strips_of
from sinan.experiments.mapping.terrain import Grid, grids_of, ground_of
from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.motion import Motion
from sinan.sensors.recording import Recording

#: 1-sigma of what no recording declares: a range [m], a beam's angle [rad], boresight [rad], lever arm [m], stamps [s].
ASSUMED_RANGE, ASSUMED_ANGLE, ASSUMED_BORESIGHT, ASSUMED_LEVER_ARM, ASSUMED_TIME = 0.03, 1e-3, 5e-3, 0.02, 2e-3
#: Scans so near to the ends of the trajectory are left out: their stamps may be late [s].
MARGIN = 0.2
#: Position and attitude in the error state.
POSE = np.r_[DP, DTHETA]


@dataclass(frozen=True)
class Map:
    """What the scans show.

    Attributes
    ----------
    motion : smoothed trajectory
    cloud, points, ground : the points, their map coordinates (m, 3) east, north, up [m], which of them are ground
    terrain, surface, objects : grids of the ground, of all, and their difference
    obstacles : what stands on the ground, highest first
    mounting, fit : used; what the strips say, None: too few overlap
    budget : by cause the horizontal and the vertical 1-sigma [m]
    """

    motion: Motion
    cloud: Cloud
    points: FloatArray
    ground: BoolArray
    terrain: Grid
    surface: Grid
    objects: Grid
    obstacles: list[Obstacle]
    mounting: Mounting
    fit: StripFit | None
    budget: dict[str, tuple[float, float]]


def mapped(recording: Recording, cell: float, adjust: bool = True) -> Map:
    """Make the map.

    Parameters
    ----------
    recording : a flight with a laser
    cell : side of a cell of the grids [m]
    adjust : with the mounting that overlapping strips show; else as it is declared

    Raises
    ------
    InputError : no laser, no scan during the flight, or points that cover no area
    """
    scans, declared = scans_of(recording), declared_mounting(recording)
    motion, sigmas, drift = trajectory(recording)
    scans = scans.between(motion.t[0] + MARGIN, motion.t[-1] - MARGIN)
    if not np.any(np.isfinite(scans.ranges)):
        raise InputError(recording.where, "no scan within the IMU's time", "scans during the flight", "stream laser")
    strip = strips_of(motion, scans.t)
    fit = fit_strips(scans, motion, strip, declared, drift)
    mounting = fit.mounting if adjust and fit is not None else declared
    cloud = cloud_of(scans, motion, mounting, strip)
    points = east_north_up(cloud.p_n, recording.origin)
    ground = ground_of(points)
    terrain, surface, objects = grids_of(points, ground, cell)
    if min(terrain.height.shape) < 2:
        cells = "points over {} x {} cells of {:g} m".format(*terrain.height.shape, cell)
        raise InputError(recording.where, cells, "a flight over ground, two cells wide or more; a smaller --cell")
    parts = budget(scans, motion, with_fit(sigmas, fit if adjust else None), mounting)
    found = obstacles_of(objects)
    return Map(motion, cloud, points, ground, terrain, surface, objects, found, mounting, fit, parts)


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
    declared = {name: np.asarray(beta, dtype=np.float64) for name, beta in recording.effects.items()}
    return Mounting(
        declared.get("laser.boresight", np.zeros(2)),
        declared.get("laser.lever_arm", np.zeros(3)),
        float(declared.get("laser.time_offset", np.zeros(1))[0]),
    )


def trajectory(recording: Recording) -> tuple[Motion, Sigmas, Drift]:
    """The smoothed motion, its median 1-sigma with what else a point depends on, and how its errors go together.

    Laser and sonar take no part: the filter takes the ground for flat, and the map is there to show that it is not. A
    base receiver of the recording does (DGPS).
    """
    heights = ("laser", "sonar")
    streams = {name: stream for name, stream in recording.streams.items() if name not in heights}
    effects = {name: beta for name, beta in recording.effects.items() if not name.startswith(heights)}
    journal = prepared(recording.replace(streams=streams, effects=effects)).run()
    motion = estimated_motion(journal)
    t, covariance = joint_covariance(journal, POSE, max(1, round(KNOT / float(np.median(np.diff(motion.t))))))
    drift = Drift(t, covariance.reshape(len(t) * len(POSE), -1))
    sigma = np.median(np.sqrt(np.diag(drift.covariance)).reshape(len(t), -1), axis=0)
    return motion, Sigmas(
        recording.spec("laser").noise_std or ASSUMED_RANGE, ASSUMED_ANGLE, sigma[3:], sigma[:3],
        np.full(2, ASSUMED_BORESIGHT), np.full(3, ASSUMED_LEVER_ARM), ASSUMED_TIME,
    ), drift  # fmt: skip


def with_fit(sigmas: Sigmas, fit: StripFit | None) -> Sigmas:
    """The same with what the strips say of the mounting."""
    if fit is None:
        return sigmas
    arm = np.array([fit.sigma[2], fit.sigma[3], ASSUMED_LEVER_ARM])
    return replace(sigmas, boresight=fit.sigma[:2], lever_arm=arm, time=float(fit.sigma[4]))
