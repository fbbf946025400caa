"""Ground against objects: the morphological filter, a cloth and the lowest point, on scenes made up at random.

    python -m sinan.experiments.benchmarks.ground_filters [SEED]

Every scene is scanned once. Its points are placed by the true trajectory and mounting, by the filter's with the one
that the strips show, and by the filter's with the one that is declared, which is wrong. Prints a table: ground
called object / objects called ground, %. Needs `cloth-simulation-filter`: pip install -e '.[benchmark]' in the clone.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from sinan.experiments.mapping.cloud import Mounting, Scans, east_north_up, placed
from sinan.experiments.mapping.flight import ANGLES, surveyed
from sinan.experiments.mapping.making import scans_of, trajectory
from sinan.experiments.mapping.scene import Ground, Scene, scanned
from sinan.experiments.mapping.strips import fit_strips, strips_of
from sinan.experiments.mapping.terrain import ground_of, lowest_is_ground
from sinan.sensors.arrays import BoolArray, FloatArray

CROOKED = Mounting(np.array([0.02, -0.03]), np.array([0.1, -0.05, 0.05]), 0.02)
PLACED = ("true", "filter, strips", "filter, as declared")
Filter = Callable[[FloatArray], BoolArray]


def relief(rng: np.random.Generator, low: float = 1.0, high: float = 2.0) -> Ground:
    """Three waves of 40 to 90 m."""
    waves = [
        (rng.uniform(low, high), 2.0 * np.pi / rng.uniform(40.0, 90.0), *rng.uniform(0.0, 2.0 * np.pi, 2))
        for _ in range(3)
    ]

    def height(north: FloatArray, east: FloatArray) -> FloatArray:
        each = [a * np.sin(k * (np.cos(d) * north + np.sin(d) * east) + phase) for a, k, d, phase in waves]
        return np.asarray(sum(each))

    return height


def plane(rng: np.random.Generator) -> Ground:
    """Slopes to 5 %."""
    a, b = rng.uniform(-0.05, 0.05, 2)
    return lambda north, east: a * north + b * east


def terraces(rng: np.random.Generator) -> Ground:
    """Three steps of 0.8 to 3 m across a plane."""
    direction, level = rng.uniform(0.0, 2.0 * np.pi), plane(rng)
    steps = list(zip(np.sort(rng.uniform(-25.0, 25.0, 3)), rng.uniform(0.8, 3.0, 3), strict=True))

    def height(north: FloatArray, east: FloatArray) -> FloatArray:
        along = np.cos(direction) * north + np.sin(direction) * east
        return np.asarray(level(north, east) + sum(up * (along > place) for place, up in steps))

    return height


def houses(rng: np.random.Generator, count: int) -> tuple[tuple[float, float, float, float, float], ...]:
    """Of 5 to 18 m, 2.5 to 9 m high."""
    low, high = (-30.0, -28.0, 2.5, 2.5, 2.5), (30.0, 28.0, 9.0, 9.0, 9.0)
    drawn = rng.uniform(low, high, (count, 5)).tolist()
    return tuple((n, e, half_n, half_e, up) for n, e, half_n, half_e, up in drawn)


def trees(rng: np.random.Generator, count: int) -> tuple[tuple[float, float, float, float], ...]:
    """Crowns of 1.2 to 3 m radius, 3 to 9 m high."""
    drawn = rng.uniform((-35.0, -30.0, 1.2, 3.0), (35.0, 30.0, 3.0, 9.0), (count, 4)).tolist()
    return tuple((n, e, radius, up) for n, e, radius, up in drawn)


#: Drawn from a seed.
SCENES: dict[str, Callable[[np.random.Generator], Scene]] = {
    "plane": lambda rng: Scene(plane(rng)),
    "hills": lambda rng: Scene(relief(rng)),
    "steep hills": lambda rng: Scene(relief(rng, 2.0, 3.5)),
    "steps": lambda rng: Scene(terraces(rng)),
    "buildings": lambda rng: Scene(plane(rng), houses(rng, 7)),
    "trees": lambda rng: Scene(plane(rng), (), trees(rng, 25), 0.5),
    "wood on hills": lambda rng: Scene(relief(rng), (), trees(rng, 40), 0.4),
    "all": lambda rng: Scene(relief(rng), houses(rng, 5), trees(rng, 12), 0.5),
}


@contextmanager
def quiet() -> Iterator[None]:
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


def cloth(resolution: float, rigidness: int, slopes: bool) -> Filter:
    """A cloth that falls on the cloud turned upside down: W. Zhang et al., Remote Sensing 8(6), 2016, 501."""

    def ground(points: FloatArray) -> BoolArray:
        import CSF

        cloth = CSF.CSF()
        cloth.params.bSloopSmooth, cloth.params.cloth_resolution = slopes, resolution
        cloth.params.class_threshold, cloth.params.rigidness = 0.5, rigidness
        found, objects = CSF.VecInt(), CSF.VecInt()
        with quiet():
            cloth.setPointCloud(np.ascontiguousarray(points))
            cloth.do_filtering(found, objects, False)
        is_ground = np.zeros(len(points), dtype=bool)
        is_ground[np.array(found, dtype=np.int64)] = True
        return is_ground

    return ground


FILTERS: dict[str, Filter] = {
    "lowest of a cell": lowest_is_ground,
    "cloth, 2 m, stiff": cloth(2.0, 3, False),
    "cloth, 1 m": cloth(1.0, 2, False),
    "cloth, 0.5 m, slack": cloth(0.5, 1, False),
    "cloth, 1 m, slack, slopes": cloth(1.0, 1, True),
    "morphological": ground_of,
}


def clouds(scene: Scene, seed: int) -> tuple[dict[str, FloatArray], BoolArray]:
    """By trajectory (m, 3) east, north, up [m]; (m,) whether on an object."""
    recording, truth = surveyed(scene, CROOKED, seed)
    motion, _, drift = trajectory(recording)
    scans, straight = scans_of(recording), Mounting(CROOKED.boresight, CROOKED.lever_arm)
    fit = fit_strips(scans, motion, strips_of(motion, scans.t), None, drift)
    assert fit is not None
    exact = scanned(scene, truth, ANGLES, CROOKED, np.random.default_rng([seed, 1]))
    keep = np.isfinite(scans.ranges)
    on_object = scene.on_object(placed(Scans(truth.t, exact, ANGLES, np.empty(0)), truth, straight)[keep])
    points = (
        placed(Scans(truth.t, scans.ranges, ANGLES, np.empty(0)), truth, straight),
        placed(scans, motion, fit.mounting),
        placed(scans, motion, Mounting()),
    )
    return {name: east_north_up(p[keep], None) for name, p in zip(PLACED, points, strict=True)}, on_object


def main(arguments: list[str]) -> None:
    """Print the table."""
    seed = int(arguments[0]) if arguments else 10
    rows: dict[tuple[str, str], list[str]] = {(name, how): [] for how in PLACED for name in FILTERS}
    for number, make in enumerate(SCENES.values()):
        by_trajectory, on_object = clouds(make(np.random.default_rng([seed, number])), seed)
        for how, points in by_trajectory.items():
            for name, ground in FILTERS.items():
                found = ground(points)
                lost = f"{100.0 * np.mean(~found[~on_object]):.1f}"
                kept = f" / {100.0 * np.mean(found[on_object]):.1f}" if np.mean(on_object) > 0.02 else ""
                rows[name, how].append(lost + kept)
    print(f"| trajectory | filter | {' | '.join(SCENES)} |\n" + "| --- " * (len(SCENES) + 2) + "|")
    for (name, how), cells in rows.items():
        print(f"| {how} | {name} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main(sys.argv[1:])
