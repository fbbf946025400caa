"""Scans to a map: what is simulated comes back, strips show the mounting, the budget is what errors do."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import laspy
import numpy as np
import pytest

from sinan.experiments.commands.map import run
from sinan.experiments.mapping.budget import CAUSES, Sigmas, budget
from sinan.experiments.mapping.cloud import Mounting, Scans, cloud_of, east_north_up, placed, write_las
from sinan.experiments.mapping.scene import COUNTRY
from sinan.experiments.mapping.strips import fit_strips, strips_of
from sinan.experiments.mapping.terrain import grids_of, ground_of, lowest_is_ground, write_grid
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.arrays import FloatArray
from sinan.sensors.formats.plain import write_recording
from sinan.sensors.motion import Motion
from sinan.sensors.recording import Stream
from sinan.sensors.rotation import quaternion_exp, quaternion_multiply
from sinan.sensors.simulate import simulate

ANGLES = np.deg2rad(np.linspace(-35.0, 35.0, 25))
NOISE = 0.02  # m
TRUE = Mounting(np.array([0.01, -0.015]), np.array([0.05, -0.03, 0.0]), 0.03)
TEN_PER_CENT = 0.1


@cache
def flown() -> tuple[Motion, Scans]:
    """The survey with a crooked, late laser."""
    motion = survey(rate=10.0)
    ranges = scanned(motion, ANGLES, TRUE) + NOISE * np.random.default_rng(1).standard_normal(
        (len(motion), len(ANGLES))
    )
    return motion, Scans(motion.t + TRUE.time_offset, ranges, ANGLES, np.tile(ANGLES * 100 + 200, (len(motion), 1)))


def test_points_lie_on_the_country() -> None:
    motion, scans = flown()
    p = placed(replace(scans, ranges=scanned(motion, ANGLES, TRUE)), motion, TRUE)
    flat = np.abs(p[..., 1]) < 5.0
    above = -p[..., 2] - country(p[..., 0], p[..., 1])
    assert np.quantile(np.abs(above[flat]), 0.9) < 1e-4  # beams that graze a wall may lie on either side of it


def test_strips_show_boresight_lever_arm_and_time() -> None:
    motion, scans = flown()
    strip = strips_of(motion, scans.t)
    assert strip.max() == 6
    found = fit_strips(scans, motion, strip)
    assert found is not None
    truth = np.array([*TRUE.boresight, *TRUE.lever_arm[:2], TRUE.time_offset])
    assert np.all(np.abs(found.beta - truth) < 4.0 * found.sigma)
    assert all(found.determined(k) for k in range(5))
    assert found.after < 0.1 * found.before


def test_strips_that_are_right_show_nothing() -> None:
    motion, _ = flown()
    ranges = scanned(motion, ANGLES, Mounting()) + NOISE * np.random.default_rng(2).standard_normal(
        (len(motion), len(ANGLES))
    )
    found = fit_strips(Scans(motion.t, ranges, ANGLES, np.empty(0)), motion, strips_of(motion, motion.t))
    assert found is not None
    assert np.all(np.abs(found.beta) < 4.0 * found.sigma)


@pytest.mark.parametrize("cause", CAUSES)
def test_the_budget_is_what_errors_do(cause: str) -> None:
    """Scans of the true country with an error in one cause; points against where their beams really hit."""
    motion = survey(rate=4.0)
    rng, n = np.random.default_rng(3), len(motion)
    sigmas = Sigmas(0.03, 2e-3, np.array([2e-3, 3e-3, 5e-3]), np.array([0.05, 0.05, 0.1]), np.array([3e-3, 4e-3]),
                    np.array([0.02, 0.03, 0.02]), 0.01)  # fmt: skip
    angles = np.deg2rad(np.linspace(-30.0, 30.0, 7))
    ranges = scanned(motion, angles, Mounting(), hills)
    scans = Scans(motion.t, ranges, angles, np.empty(0))
    draws: list[FloatArray | np.random.Generator] = [rng] * 30
    if cause in CONSTANT:  # one draw a flight: each component by its sigma instead, which is exact to first order
        draws = list(np.eye(CONSTANT[cause]))
    squares = np.zeros(2)
    for draw in draws:
        moved = points_with(cause, motion, scans, sigmas, draw) - placed(scans, motion, Mounting())
        squares += [np.mean(moved[..., 0] ** 2 + moved[..., 1] ** 2), np.mean(moved[..., 2] ** 2)]
    found = np.sqrt(squares if cause in CONSTANT else squares / len(draws))
    assert n > 100
    assert found == pytest.approx(budget(scans, motion, sigmas, Mounting())[cause], rel=TEN_PER_CENT)


#: Causes that are one for a whole flight, and their components.
CONSTANT = {"boresight": 2, "lever arm": 3, "time": 1}


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


def test_ground_objects_and_files(tmp_path: Path) -> None:
    motion, scans = flown()
    high = slice(0, 600)  # the strips at 30 m
    scans = Scans(scans.t[high], scans.ranges[high], ANGLES, scans.intensity[high])
    cloud = cloud_of(scans, motion, TRUE, strips_of(motion, scans.t))
    points = east_north_up(cloud.p_n, None)
    ground, true = ground_of(points), ~on_it(cloud.p_n[:, 0], cloud.p_n[:, 1])
    wrong, plainly = np.mean(ground != true), np.mean(lowest_is_ground(points) != true)
    assert wrong < 0.05
    assert wrong < plainly
    terrain, _, objects = grids_of(points, ground, 1.0)
    rows, columns = np.indices(terrain.height.shape)
    north, east = terrain.north + rows + 0.5, terrain.east + columns + 0.5
    known = np.isfinite(terrain.height)
    assert np.median(np.abs(terrain.height - hills(north, east))[known]) < 0.05
    house = objects.height[int(12.0 - objects.north), int(8.0 - objects.east)]
    assert house == pytest.approx(5.0, abs=1.0)  # the roof is level, the ground under it is not
    write_grid(tmp_path / "t.asc", terrain)
    back = np.loadtxt(tmp_path / "t.asc", skiprows=6)[::-1]
    assert np.nanmax(np.abs(np.where(back == -9999.0, np.nan, back) - terrain.height)) < 1e-3
    write_las(tmp_path / "c.laz", cloud, ground, (40.0, 116.0, 50.0))
    las = laspy.read(tmp_path / "c.laz")
    assert np.max(np.abs(np.asarray(las.z) - points[:, 2] - 50.0)) < 0.002
    assert np.array_equal(np.asarray(las.classification) == 2, ground)
    assert np.asarray(las.intensity)[0] == round(float(cloud.intensity[0]))


def test_a_recording_becomes_a_map(tmp_path: Path) -> None:
    """A square over the country, 25 m lower, with a crooked scanning laser; the trajectory is the filter's."""
    scenario = load_scenario("square")
    made, _ = simulate(scenario, np.random.default_rng(6))
    t, crooked = made.streams["laser"].t[::2], Mounting(np.array([0.02, -0.03]))
    truth = scenario.trajectory().motion(t)
    ranges = scanned(truth, ANGLES, crooked, lambda north, east: country(north, east) - 25.0)
    ranges = np.nan_to_num(ranges + NOISE * np.random.default_rng(7).standard_normal(ranges.shape), nan=0.0)
    columns = {f"range_{k}": column for k, column in enumerate(ranges.T)}
    sensors = {**made.sensors, "laser": replace(made.sensors["laser"], angles=ANGLES)}
    recording = made.replace(streams={**made.streams, "laser": Stream(t, columns)}, sensors=sensors)
    write_recording(recording, tmp_path / "flight")
    text = run(str(tmp_path / "flight"), tmp_path / "map", 1.0, True, None)
    told = json.loads((tmp_path / "map" / "map.json").read_text())
    found = {(one["effect"], one["component"]): one for one in told["strips"]["found"]}
    roll = found["laser.boresight", "roll"]
    assert roll["determined"]
    assert roll["value"] == pytest.approx(0.02, abs=0.005)  # the attitude's own error is 2 mrad, and differs by strip
    assert told["strips"]["rms_after"] < told["strips"]["rms_before"]
    assert "laser.boresight roll" in text
    made_files = {path.name for path in (tmp_path / "map").iterdir()}
    assert made_files >= {"cloud.laz", "terrain.asc", "surface.asc", "objects.asc", "terrain.png", "index.html"}
