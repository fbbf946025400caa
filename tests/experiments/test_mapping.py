"""Scans to a map: what is simulated comes back, strips show the mounting, the budget is what errors do."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import laspy
import numpy as np
import pymap3d
import pytest
from scipy.spatial.transform import Rotation

from sinan.experiments.commands.map import run
from sinan.experiments.labs import run as run_lab
from sinan.experiments.mapping.budget import CAUSES, Sigmas, budget
from sinan.experiments.mapping.cloud import Cloud, Mounting, Scans, cloud_of, east_north_up, placed, write_las
from sinan.experiments.mapping.flight import ANGLES, SCENARIO, surveyed
from sinan.experiments.mapping.making import scans_of
from sinan.experiments.mapping.obstacles import obstacles_of, scan_in_plane
from sinan.experiments.mapping.scene import COUNTRY, Scene, hills, marched, scanned
from sinan.experiments.mapping.strips import SOUGHT, fit_strips, strips_of
from sinan.experiments.mapping.terrain import Grid, grids_of, ground_of, lowest_is_ground, write_grid
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.arrays import FloatArray
from sinan.sensors.formats.plain import write_recording
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import quaternion_exp, quaternion_multiply
from tests.experiments.conftest import require_fit

TRUE = Mounting(np.array([0.01, -0.015]), np.array([0.05, -0.03, 0.0]), 0.03)
MILLIMETRE, CENTIMETRE, TEN_PER_CENT = 1e-3, 1e-2, 0.1


@cache
def true_motion(rate: float = 100.0) -> Motion:
    """Of the survey."""
    scenario = load_scenario(SCENARIO)
    return scenario.trajectory().motion(np.arange(0.0, scenario.duration, 1.0 / rate))


@cache
def flown() -> Scans:
    """The survey with a crooked, late laser."""
    return scans_of(surveyed(COUNTRY, TRUE, 1)[0])


def test_points_lie_on_the_ground() -> None:
    motion = true_motion(2.0)
    ranges = scanned(Scene(hills), motion, ANGLES, TRUE)
    scans = Scans(motion.t + TRUE.time_offset, ranges, ANGLES, np.empty(0))
    p = placed(scans, motion, TRUE)[np.isfinite(ranges)]
    assert len(p) > 5000
    assert np.max(np.abs(-p[:, 2] - hills(p[:, 0], p[:, 1]))) < MILLIMETRE


def test_points_are_those_of_scipy_s_rotations_and_pymap3d_s_earth() -> None:
    """Instant by instant: mounting and attitude as intrinsic turns, position over the ellipsoid."""
    rng, origin = np.random.default_rng(8), (39.98, 116.34, 50.0)
    t, tilt = np.arange(0.0, 2.0, 0.1), rng.uniform(-0.3, 0.3, (20, 3))
    turns = Rotation.from_euler("ZYX", tilt + np.array([2.0, 0.0, 0.0]))
    p_n, v_n = np.column_stack([300.0 + 5.0 * t, -200.0 + 2.0 * t, -40.0 + t]), np.tile([5.0, 2.0, 1.0], (20, 1))
    motion = Motion(t, p_n, v_n, q_nb=turns.as_quat(scalar_first=True))
    mounting = Mounting(np.array([0.1, -0.2]), np.array([0.3, -0.1, 0.2]), 0.1)
    scans = Scans(t[1:], rng.uniform(10.0, 60.0, (19, 5)), np.linspace(-0.6, 0.6, 5), np.empty(0))
    found = east_north_up(placed(scans, motion, mounting).reshape(-1, 3), origin).reshape(19, 5, 3)
    board = Rotation.from_euler("XY", mounting.boresight)
    for k in range(19):  # the scan of stamp k + 1 is of instant k
        beams = np.column_stack([np.zeros(5), np.sin(scans.angles), np.cos(scans.angles)])
        ned = p_n[k] + turns[k].apply(mounting.lever_arm + board.apply(scans.ranges[k][:, None] * beams))
        place = pymap3d.ecef2geodetic(*pymap3d.ned2ecef(*ned.T, *origin))
        assert np.max(np.abs(found[k, :, 2] - place[2])) < MILLIMETRE
        east, north, _ = pymap3d.geodetic2enu(place[0], place[1], 0.0, origin[0], origin[1], 0.0)
        assert np.max(np.abs(found[k, :, :2] - np.column_stack([east, north]))) < 2.0 * MILLIMETRE


def test_strips_show_boresight_lever_arm_and_time() -> None:
    scans, motion = flown(), true_motion()
    found = fit_strips(scans, motion, strips_of(motion, scans.t))
    assert found is not None
    truth = np.array([*TRUE.boresight, *TRUE.lever_arm[:2], TRUE.time_offset])
    assert np.all(np.abs(found.beta - truth) < 4.0 * found.sigma)
    assert all(found.determined(k) for k in range(5))
    assert found.after < 0.1 * found.before


def test_strips_of_a_laser_that_is_straight_show_nothing() -> None:
    scans, motion = scans_of(surveyed(COUNTRY, Mounting(), 2)[0]), true_motion()
    found = fit_strips(scans, motion, strips_of(motion, scans.t))
    assert found is not None
    assert np.all(np.abs(found.beta) < 4.0 * found.sigma)


def test_a_level_ground_does_not_seem_to_show_the_lever_arm_ahead() -> None:
    """Planes of few noisy points slope, each its own way; taken for the ground's, they show what level ground hides."""
    motion = true_motion()
    straight = (motion.t > 5.0) & (motion.t < 15.0)
    there = motion.at(motion.t[straight][::10])
    back = replace(there, t=there.t + 20.0, p_n=there.p_n + np.array([0.0, 8.0, 0.0]))
    both = Motion(
        np.concatenate([there.t, back.t]), np.concatenate([there.p_n, back.p_n]), np.concatenate([there.v_n] * 2),
        q_nb=np.tile([1.0, 0.0, 0.0, 0.0], (2 * len(there), 1)),
    )  # fmt: skip
    ranges = scanned(Scene(lambda north, east: 0.0 * north), both, ANGLES, Mounting())
    ranges += 0.03 * np.random.default_rng(4).standard_normal(ranges.shape)
    found = fit_strips(Scans(both.t, ranges, ANGLES, np.empty(0)), both, strips_of(both, both.t))
    assert found is not None
    ahead = [(name, part) for name, part, _ in SOUGHT].index(("laser.lever_arm", "x"))
    assert not found.determined(ahead)


#: Causes that are one for a whole flight, and their components.
CONSTANT = {"boresight": 2, "lever arm": 3, "time": 1}
SIGMAS = Sigmas(0.03, 2e-3, np.array([2e-3, 3e-3, 5e-3]), np.array([0.05, 0.05, 0.1]), np.array([3e-3, 4e-3]),
                np.array([0.02, 0.03, 0.02]), 0.002)  # fmt: skip


@cache
def scanned_hills() -> tuple[Motion, Scans]:
    motion, angles = true_motion(200.0), np.deg2rad(np.linspace(-30.0, 30.0, 7))
    t = motion.t[200:-200:97]
    return motion, Scans(t, marched(hills, motion.at(t), angles, Mounting()), angles, np.empty(0))


@pytest.mark.parametrize("cause", CAUSES)
def test_the_budget_is_what_errors_do(cause: str) -> None:
    """Points of a map with an error in one cause, against where their beams really hit."""
    motion, scans = scanned_hills()
    draws: list[FloatArray | np.random.Generator] = [np.random.default_rng(3)] * 30
    if cause in CONSTANT:  # one draw a flight: each component by its sigma instead, which is exact to first order
        draws = list(np.eye(CONSTANT[cause]))
    squares = np.zeros(2)
    for draw in draws:
        moved = points_with(cause, motion, scans, SIGMAS, draw) - placed(scans, motion, Mounting())
        squares += [np.nanmean(moved[..., 0] ** 2 + moved[..., 1] ** 2), np.nanmean(moved[..., 2] ** 2)]
    found = np.sqrt(squares if cause in CONSTANT else squares / len(draws))
    assert found == pytest.approx(budget(scans, motion, SIGMAS, Mounting())[cause], rel=TEN_PER_CENT)


def points_with(
    cause: str, motion: Motion, scans: Scans, s: Sigmas, draw: FloatArray | np.random.Generator
) -> FloatArray:
    """Where a map with that error has the points."""
    n = len(motion)
    if not isinstance(draw, np.random.Generator):
        named = {"boresight": "boresight", "lever arm": "lever_arm", "time": "time_offset"}[cause]
        size = {"boresight": s.boresight, "lever arm": s.lever_arm, "time": s.time}[cause]
        moved = size * draw
        return placed(scans, motion, Mounting(**{named: float(moved[0]) if cause == "time" else moved}))
    rng = draw
    if cause == "range":
        scans = replace(scans, ranges=scans.ranges + s.range * rng.standard_normal(scans.ranges.shape))
    elif cause == "angle":
        scans = replace(scans, angles=scans.angles + s.angle * rng.standard_normal(len(scans.angles)))
    elif cause == "attitude":
        turned = quaternion_exp(s.attitude * rng.standard_normal((n, 3)))
        motion = replace(motion, q_nb=quaternion_multiply(motion.q_nb, turned))
    else:
        motion = replace(motion, p_n=motion.p_n + s.position * rng.standard_normal((n, 3)))
    return placed(scans, motion, Mounting())


@cache
def country_seen(noise: float = 0.03) -> tuple[Cloud, FloatArray, np.ndarray]:
    """Points of the true survey, their map coordinates, whether each is on an object."""
    motion = true_motion(10.0)
    ranges = scanned(COUNTRY, motion, ANGLES, Mounting())
    scans = Scans(motion.t, ranges, ANGLES, np.broadcast_to(100.0 * ANGLES + 200.0, ranges.shape))
    strip = strips_of(motion, motion.t)
    on_object = COUNTRY.on_object(cloud_of(scans, motion, Mounting(), strip).p_n)
    noisy = replace(scans, ranges=ranges + noise * np.random.default_rng(5).standard_normal(ranges.shape))
    cloud = cloud_of(noisy, motion, Mounting(), strip)
    return cloud, east_north_up(cloud.p_n, None), on_object


def test_ground_is_told_from_houses_and_trees_on_hills() -> None:
    _, points, on_object = country_seen()
    ground = ground_of(points)
    assert np.mean(~ground[~on_object]) < 0.005
    assert np.mean(ground[on_object]) < 0.08  # feet of walls and crowns, below half a metre
    plainly = lowest_is_ground(points)
    assert np.mean(ground != ~on_object) < 0.2 * np.mean(plainly != ~on_object)


def test_an_echo_of_an_echo_does_not_take_the_ground_with_it() -> None:
    _, points, on_object = country_seen()
    deep = points.copy()
    rows = np.random.default_rng(6).choice(np.flatnonzero(~on_object), 20, replace=False)
    deep[rows, 2] -= 8.0
    kept = np.ones(len(points), dtype=bool)
    kept[rows] = False
    assert np.mean(ground_of(deep)[kept & ~on_object]) > 0.995


def test_terrain_and_objects_are_those_of_the_country(tmp_path: Path) -> None:
    _, points, _ = country_seen()
    terrain, _, objects = grids_of(points, ground_of(points), 1.0)
    rows, columns = np.indices(terrain.height.shape)
    north, east = terrain.north + rows + 0.5, terrain.east + columns + 0.5
    near = (np.abs(north) < 30.0) & (np.abs(east) < 30.0)
    assert np.all(np.isfinite(terrain.height[near]))
    assert np.sqrt(np.mean((terrain.height - hills(north, east))[near] ** 2)) < 0.12
    found = obstacles_of(objects)
    truth = [(e, n) for n, e, *_ in (*COUNTRY.houses, *COUNTRY.trees)]
    assert len(found) == len(truth)
    assert all(min(np.hypot(one.east - e, one.north - n) for one in found) < 1.0 for e, n in truth)
    write_grid(tmp_path / "t.asc", terrain)
    back = np.loadtxt(tmp_path / "t.asc", skiprows=6)[::-1]
    assert np.nanmax(np.abs(np.where(back == -9999.0, np.nan, back) - terrain.height)) < MILLIMETRE


def test_an_obstacle_in_the_plane_of_a_scan_is_where_the_house_is() -> None:
    cloud, _, on_object = country_seen()
    scan = scan_in_plane(cloud, ~on_object, true_motion(10.0))
    left, right, away = scan.obstacles()[0]
    assert right - left > 1.0
    assert away == pytest.approx(np.min(np.hypot(scan.across, scan.up)[scan.on_object]), abs=2.0)
    assert np.all(np.diff(scan.across) > -CENTIMETRE * 20)


def test_a_small_obstacle_is_none() -> None:
    height = np.zeros((10, 10))
    height[2, 2], height[5:8, 5:8] = 9.0, 3.0
    (only,) = obstacles_of(Grid(height, 100.0, 200.0, 0.5))
    assert (only.east, only.north, only.height, only.area) == (103.25, 203.25, 3.0, 2.25)


def test_the_cloud_s_file_has_class_intensity_and_height(tmp_path: Path) -> None:
    cloud, points, on_object = country_seen()
    write_las(tmp_path / "c.laz", cloud, ~on_object, (40.0, 116.0, 50.0))
    las = laspy.read(tmp_path / "c.laz")
    assert np.max(np.abs(np.asarray(las.z) - points[:, 2] - 50.0)) < 2.0 * MILLIMETRE
    assert np.array_equal(np.asarray(las.classification) == 2, ~on_object)
    assert np.asarray(las.intensity)[0] == round(float(cloud.intensity[0]))


def test_a_recording_becomes_a_map(tmp_path: Path) -> None:
    """With the filter's trajectory: the mounting, of which the recording says nothing, is found."""
    recording, _ = surveyed(COUNTRY, TRUE, 6)
    write_recording(recording, tmp_path / "flight")
    text = run(str(tmp_path / "flight"), tmp_path / "map", 1.0, True, None, tmp_path / "map.json")
    told = json.loads((tmp_path / "map.json").read_text())
    found = {(one["effect"], one["component"]): one["value"] for one in told["strips"]["found"]}
    assert found["laser.boresight", "roll"] == pytest.approx(0.01, abs=1e-3)
    assert found["laser.boresight", "pitch"] == pytest.approx(-0.015, abs=5e-3)
    assert found["laser.time_offset", "b"] == pytest.approx(0.03, abs=5e-3)
    true = {("laser.lever_arm", "x"): TRUE.lever_arm[0], ("laser.lever_arm", "y"): TRUE.lever_arm[1]}
    for one in told["strips"]["found"]:  # 3 sigma: the trajectory's error, not the cells' noise, is most of it
        hidden = {**true, ("laser.boresight", "roll"): 0.01, ("laser.boresight", "pitch"): -0.015,
                  ("laser.time_offset", "b"): 0.03}[one["effect"], one["component"]]  # fmt: skip
        assert one["value"] == pytest.approx(hidden, abs=3.0 * one["std"])
    assert told["strips"]["rms_after"] < 0.3 * told["strips"]["rms_before"]
    assert len(told["obstacles"]) == len(COUNTRY.houses) + len(COUNTRY.trees)
    require_fit("map", told)
    assert "laser.boresight roll" in text
    made = {path.name for path in (tmp_path / "map").iterdir()}
    assert made == {f"{name}.{kind}" for name in ("terrain", "surface", "objects") for kind in ("asc", "png")} | {
        "cloud.laz", "index.html"
    }  # fmt: skip


def test_the_lab_finds_what_it_hides(tmp_path: Path) -> None:
    lines: list[str] = []
    run_lab("laser_map", tmp_path, lines.append)
    scores = {line.split(":")[0]: line.split(":")[1].split() for line in lines if "as declared" in line}
    assert float(scores["points, vertical error / m RMS"][3]) < 0.07
    assert float(scores["terrain, error / m RMS"][3]) < 0.15
    assert float(scores["ground called object / %"][3]) < 0.5
    assert float(scores["ground called object / %"][0]) > 3.0  # crooked strips are what spoils the ground
