"""Simulated pictures: a camera aboard that flies over marks whose places are known.

reading = pixel of a mark (motion) + sum over effects (apply - predict) + white noise, one row a mark and picture.
"""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.camera import Camera
from sinan.sensors.covariates import camera_from
from sinan.sensors.motion import Motion
from sinan.sensors.readings import World, instants, lost
from sinan.sensors.recording import Stream
from sinan.sensors.scenario import Instrument

#: Of a simulated camera: a mark nearer than this is out of focus [m].
NEAREST = 0.1


def pictures(world: World) -> tuple[Stream, FloatArray]:
    """The stream of the camera, and the known points (k, 4): number, north, east, down [m].

    In a picture are the marks of the lowest numbers that the plain camera would see, so one stays in it while it is
    in view; one that the effects move out of the picture is not read. A picture that is lost is lost whole.

    Neglects blur, marks that hide each other, and a shutter that reads line by line.
    """
    instrument = world.scenario.sensors["camera"]
    camera = camera_from(instrument.spec, f"scenario {world.scenario.name}")
    places = marks(world, instrument)
    t = instants(world.scenario, "camera", world.rng("camera.clock"))
    t = t[~lost(world, "camera", t)]
    picture, mark = _in_view(camera, world.vehicle.trajectory.motion(t), places, instrument)
    motion = _at(world, camera, t[picture], places[mark])
    uv = seen(world, camera, motion)
    uv = uv + camera.sigma * world.rng("camera.noise").standard_normal(uv.shape)
    read = _inside(uv, instrument)
    columns = {"point": mark[read].astype(np.float64), "u": uv[read, 0], "v": uv[read, 1]}
    return Stream(t[picture][read], columns), np.column_stack([np.arange(len(places)), places])


def marks(world: World, instrument: Instrument) -> FloatArray:
    """(marks, 3) evenly over a square about the start, on the ground but for half a metre, north, east, down [m]."""
    rng, given = world.rng("camera.marks"), instrument.marks
    across = rng.uniform(-given.reach, given.reach, (given.count, 2)) + np.array(world.scenario.start[:2])
    return np.column_stack([across, world.scenario.ground_down + rng.uniform(-given.height, given.height, given.count)])


def seen(world: World, camera: Camera, motion: Motion) -> FloatArray:
    """(n, 2) pixels with effects, without noise."""
    plain = camera.predict(motion)
    value = plain.copy()
    for present in world.on("camera"):
        if present.effect.name == "camera.time_offset":  # the rows of a picture are of one instant: no motion to shift
            earlier = world.vehicle.motion(motion.t - present.beta[0], "camera")
            change = camera.predict(earlier.with_covariates(**_own(motion))) - plain
        else:
            change = present.effect.change(plain, present.beta, motion, camera)
        acting = (motion.t >= present.t0) & (motion.t < present.t1)
        value += np.where(acting[:, None], change, 0.0)
    return value


def _at(world: World, camera: Camera, t: FloatArray, point_n: FloatArray) -> Motion:
    """The motion at the instants of the rows, with each row's mark and the camera."""
    motion = world.vehicle.motion(t, "camera")
    return motion.with_covariates(point_n=point_n, camera=camera.covariate(len(t)))


def _own(motion: Motion) -> dict[str, FloatArray]:
    return {name: motion.covariates[name] for name in ("point_n", "camera")}


def _in_view(camera: Camera, motion: Motion, places: FloatArray, instrument: Instrument) -> tuple[IntArray, IntArray]:
    """(n,) picture and mark of each row, pictures in order."""
    none = np.zeros(0, dtype=np.int64)
    picture, mark = [none], [none]
    for k in range(len(motion)):
        there = motion.rows(np.full(len(places), k)).with_covariates(point_n=places)
        inside = _inside(camera.predict(there), instrument) & (camera.points_c(there)[:, 2] > NEAREST)
        chosen = np.flatnonzero(inside)[: instrument.marks.most]
        picture.append(np.full(len(chosen), k, dtype=np.int64))
        mark.append(chosen.astype(np.int64))
    return np.concatenate(picture), np.concatenate(mark)


def _inside(uv: FloatArray, instrument: Instrument) -> BoolArray:
    """(n,) whether pixels are in the picture."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.all((uv >= -0.5) & (uv <= np.array(instrument.marks.size) - 0.5), axis=1))
