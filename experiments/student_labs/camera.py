"""A picture of two walls of one's own: the pinhole, its distortion, where it stands, how far apart two have to be."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sinan.experiments.student_labs.lab import Data, Lab, Mistake, Question, Words
from sinan.sensors.arrays import FloatArray
from sinan.sensors.camera import Intrinsics

NOISE = 0.3  # pixels
#: The point whose pixel is asked for [m]; the distance [m] and its wanted 1 sigma [m] of the design.
POINT, FAR, WANTED = np.array([0.5, 0.5, -0.5]), 5.0, 0.02


def walls() -> FloatArray:
    """(50, 3) feature points on two walls that meet at right angles, north, east, down [m]."""
    across, down = np.meshgrid(np.linspace(0.15, 1.15, 5), np.linspace(-1.4, -0.4, 5))
    flat, zero = (across.ravel(), down.ravel()), np.zeros(25)
    return np.concatenate([np.column_stack([flat[0], zero, flat[1]]), np.column_stack([zero, flat[0], flat[1]])])


def make(rng: np.random.Generator) -> tuple[Data, Mapping[str, object]]:
    """One picture of the walls' points, by a camera with radial distortion that looks into their corner."""
    points = walls()
    place = np.array([1.9, 1.7, -1.0]) + rng.uniform(-0.2, 0.2, 3)
    z = np.array([0.3, 0.3, -0.9]) + rng.uniform(-0.05, 0.05, 3) - place
    z /= np.linalg.norm(z)
    x = np.cross([0.0, 0.0, 1.0], z)
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(z, x), z])
    f, centre, k1 = rng.uniform(460.0, 580.0), rng.uniform([305.0, 225.0], [335.0, 255.0]), -rng.uniform(0.06, 0.15)
    intrinsics = Intrinsics(f * np.array([1.0, rng.uniform(0.98, 1.02)]), centre, "brown", np.array([k1]))
    uv = intrinsics.pixels((points - place) @ R.T) + NOISE * rng.standard_normal((len(points), 2))
    columns = {c: points[:, k] for k, c in enumerate("xyz")} | {"u": uv[:, 0], "v": uv[:, 1]}
    return columns, {"intrinsics": intrinsics.values[:4].tolist(), "k1": float(k1), "place": place.tolist()}


LAB = Lab(
    make,
    (
        Question(
            "intrinsics",
            "basic",
            4,
            0.5,
            Words(
                "f / dX, f / dY, u0, v0, without distortion; is the sum of squares of u and v at its minimum?",
                "f/dX、f/dY、u0、v0，不含畸变；u、v 残差的平方和是否最小？",
            ),
            (
                Mistake(Words("this is with the distortion", "这是含畸变的结果")),
                Mistake(Words("the order: f / dX, f / dY, u0, v0", "顺序应为 f/dX、f/dY、u0、v0")),
            ),
        ),
        Question(
            "rms",
            "basic",
            1,
            0.01,
            Words("root of the mean over the points of du^2 + dv^2", "各点 du²+dv² 的平均值再开方"),
            (Mistake(Words("the mean is over the points, not over u and v", "应对各点取平均，而不是对 u、v 取平均")),),
        ),
        Question(
            "pixel",
            "basic",
            2,
            0.3,
            Words(
                "P_c = R P_e + T, then f / dX P_x / P_z + u0; with the parameters just found",
                "先 P_c = R P_e + T，再 u = f/dX·P_x/P_z + u0；用刚求得的参数",
            ),
        ),
        Question(
            "k1",
            "analysis",
            1,
            2e-3,
            Words(
                "x (1 + k1 r^2), y (1 + k1 r^2) with r^2 = x^2 + y^2 on the plane z = 1, before f / dX multiplies",
                "在 z = 1 平面上 x(1+k1 r²)、y(1+k1 r²)，r² = x²+y²，然后再乘 f/dX",
            ),
            (Mistake(Words("the sign: a barrel has a negative k1", "符号：桶形畸变的 k1 为负")),),
        ),
        Question(
            "place",
            "analysis",
            3,
            2e-3,
            Words(
                "where the camera stands, with the distortion: P_c is zero there",
                "考虑畸变时摄像机的位置：该点的 P_c 为零",
            ),
            (
                Mistake(Words("this is T; the camera stands at -R' T", "这是平移向量 T；摄像机位置为 -RᵀT")),
                Mistake(Words("this is without the distortion", "这是不含畸变的结果")),
            ),
        ),
        Question(
            "baseline",
            "design",
            1,
            0.02,
            Words(
                "Z = f b / d; the difference d of two u has sqrt(2) times the noise of one, which the residual shows",
                "Z = f b/d；两个 u 之差 d 的噪声是单个噪声的 √2 倍，后者由残差求得",
            ),
            (
                Mistake(
                    Words(
                        "the difference of two pixels has twice the variance of one", "两个像素之差的方差是单个的两倍"
                    )
                ),
                Mistake(Words("the error of Z grows with its square", "Z 的误差与 Z 的平方成正比")),
            ),
        ),
    ),
)
