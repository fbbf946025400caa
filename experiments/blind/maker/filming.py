"""A camera aboard that sees marks whose places are known: how it sits, where they are, what it reads.

Its noise is white and as declared in a rough world too: what is rough there are the other instruments.
"""

from __future__ import annotations

import numpy as np

from sinan.experiments.blind.maker.body import Body
from sinan.experiments.blind.maker.catalogue import Hidden, log_uniform
from sinan.experiments.blind.maker.forward_camera import CHANGES, Pinhole
from sinan.experiments.blind.maker.measure import STAMP_DECIMALS, Plan, belonging, stamps
from sinan.experiments.blind.maker.turning import exp_rotation, quaternion
from sinan.sensors.arrays import FloatArray, IntArray
from sinan.sensors.recording import SensorSpec, Stream

#: A camera that looks down, the top of its picture ahead: columns are its axes in the body.
LOOKS_DOWN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
PICTURES, NOISE, SIZE = (2.0, 8.0), (0.3, 1.2), np.array([640.0, 480.0])  # Hz, pixels
FOCAL = (300.0, 700.0)  # pixels: 94 to 49 deg across
#: Marks on the ground below the path, and how many of a picture are read; their heights' 1-sigma [m].
MARKS, READ, HEIGHT = 60, 6, 0.5


def filmed(rng: np.random.Generator, plan: Plan) -> tuple[Stream, SensorSpec, FloatArray]:
    """The camera's stream, what its header declares, and the marks (k, 4): number, north, east, down [m]."""
    noise, focal = log_uniform(rng, *NOISE), log_uniform(rng, *FOCAL) * (1.0 + 0.01 * rng.normal(size=2))
    axes = exp_rotation(0.3 * rng.normal(size=(1, 3)))[0] @ LOOKS_DOWN
    camera = Pinhole(np.round(focal, 3), SIZE, axes, np.round(0.1 * rng.normal(size=3), 3))
    points = draw_marks(rng, plan)
    t = stamps(rng, plan.scene, log_uniform(rng, *PICTURES))
    body = plan.scene.motion(belonging(plan, "camera", t))
    picture, mark = in_view(rng, camera, body, points[:, 1:])
    seen = rows_of(body, picture)
    uv = reading(camera, plan.of_stream("camera"), seen, points[mark, 1:])
    uv = uv + noise * rng.normal(size=uv.shape)
    keep = np.isfinite(uv).all(axis=1) & camera.inside(uv)
    columns = {"point": mark[keep].astype(np.float64), "u": np.round(uv[keep, 0], 4), "v": np.round(uv[keep, 1], 4)}
    spec = SensorSpec(
        noise_std=noise, focal=camera.focal, centre=camera.middle, lens="brown",
        mounting=quaternion(axes[None])[0], lever_arm=camera.place,
    )  # fmt: skip
    return Stream(np.round(t[picture[keep]], STAMP_DECIMALS), columns), spec, points


def draw_marks(rng: np.random.Generator, plan: Plan) -> FloatArray:
    """(k, 4) number, north, east, down: near the ground under the path, as far aside of it as the camera sees [m]."""
    t = rng.uniform(plan.scene.begin, plan.scene.end, MARKS)
    p = plan.scene.motion(np.sort(t)).p
    aside = 0.5 * (plan.scene.ground_down - p[:, 2:]) * rng.normal(size=(MARKS, 2))
    down = plan.scene.ground_down + HEIGHT * rng.normal(size=MARKS)
    return np.column_stack([np.arange(MARKS), np.round(p[:, :2] + aside, 3), np.round(down, 3)])


def in_view(rng: np.random.Generator, camera: Pinhole, body: Body, marks: FloatArray) -> tuple[IntArray, IntArray]:
    """(n,) picture and mark of each row: `READ` of the marks that the camera as declared has in its picture."""
    none = np.zeros(0, dtype=np.int64)
    picture, mark = [none], [none]
    for k in range(len(body.t)):
        one = rows_of(body, np.full(len(marks), k))
        there = np.flatnonzero(camera.inside(np.nan_to_num(camera.pixels(one, marks), nan=-1e9)))
        chosen = np.sort(rng.permutation(there)[:READ])
        picture.append(np.full(len(chosen), k))
        mark.append(chosen)
    return np.concatenate(picture), np.concatenate(mark)


def reading(camera: Pinhole, hidden: list[Hidden], body: Body, marks: FloatArray) -> FloatArray:
    """(n, 2) pixels with the effects, each of the plain reading; without noise."""
    plain = camera.pixels(body, marks)
    value = plain.copy()
    for one in hidden:
        if one.name in CHANGES:
            value += camera.with_effects([one]).pixels(body, marks) - plain
    return value


def rows_of(body: Body, rows: IntArray) -> Body:
    """The body at some of its instants, which may come again."""
    return Body(*(getattr(body, name)[rows] for name in Body.__dataclass_fields__))
