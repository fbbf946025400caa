"""A hover of one's own, then a turn: what cannot be told apart, and what flying it apart takes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sinan.experiments.student_labs.lab import Data, Lab, Mistake, Question, Words
from sinan.sensors.arrays import FloatArray

G, RATE, LENGTH, NOISE = 9.8, 10.0, 60.0, 0.5  # m/s^2, Hz, s, m
HOVER, TURNED = 30.0, 50.0  # s: the heading stands still before the first and after the second
#: Share of the largest difference between two cosines of the heading that the designed one has to reach.
_ENOUGH = 0.95


def make(rng: np.random.Generator) -> tuple[Data, Mapping[str, object]]:
    """Position that drifts off: a tilt error pulls in the Earth's axes, an accelerometer's bias in the body's."""
    t = np.arange(0.0, LENGTH, 1.0 / RATE)
    first = float(rng.uniform(0.2, 1.0) + rng.choice([0.0, np.pi]))
    heading = first + np.pi * np.clip((t - HOVER) / (TURNED - HOVER), 0.0, 1.0)
    tilt, bias = (float(rng.choice([-1.0, 1.0]) * rng.uniform(*span)) for span in ((0.002, 0.006), (0.03, 0.09)))
    start, speed = float(rng.uniform(-2.0, 2.0)), float(rng.uniform(-0.2, 0.2))
    position = start + speed * t + columns(t, heading) @ np.array([tilt, bias]) + NOISE * rng.standard_normal(len(t))
    return {"t": t, "heading": heading, "position": position}, {"tilt": tilt, "bias": bias, "heading": first}


def columns(t: FloatArray, heading: FloatArray) -> FloatArray:
    """(n, 2) position by tilt error and by bias: G t^2 / 2, and the cosine of the heading integrated twice."""
    step = np.diff(t, prepend=t[0])
    speed = np.cumsum(0.5 * step * (np.cos(heading) + np.cos(np.roll(heading, 1))))
    return np.column_stack([0.5 * G * t**2, np.cumsum(0.5 * step * (speed + np.concatenate([[0.0], speed[:-1]])))])


def tells(data: Data, heading: FloatArray) -> bool:
    """Whether hovering on at this heading [deg] changes what the bias does nearly as much as any heading can."""
    first = np.cos(data["heading"][0])
    return bool(np.abs(np.cos(np.deg2rad(heading[0])) - first) >= _ENOUGH * (1.0 + np.abs(first)))


LAB = Lab(
    make,
    (
        Question(
            "rank",
            "basic",
            1,
            0.1,
            Words(
                "stack H, H F, H F^2, H F^3 for (position, speed, tilt error, bias): how many rows are independent?",
                "对状态（位置、速度、倾斜误差、漂移）堆叠 H、HF、HF²、HF³：秩是多少？",
            ),
            (
                Mistake(
                    Words(
                        "tilt error and bias enter the speed as one sum only", "倾斜误差和漂移只以一个和的形式进入速度"
                    )
                ),
            ),
        ),
        Question(
            "direction",
            "basic",
            1,
            0.2,
            Words(
                "which bias hides a tilt error of 1 rad: g + cos(heading) b = 0",
                "多大的漂移恰好抵消 1 rad 的倾斜误差：g + cosψ·b = 0",
            ),
            (
                Mistake(Words("the sign: they cancel", "符号：二者相互抵消")),
                Mistake(
                    Words("the bias is along the body: the cosine of the heading", "漂移沿机体轴：须考虑偏航角的余弦")
                ),
            ),
        ),
        Question(
            "sum",
            "basic",
            1,
            1e-4,
            Words(
                "first 30 s: position = p0 + v0 t + s t^2 / 2 by least squares; s is the sum",
                "前 30 s：用最小二乘将位置拟合为 p = p0 + v0 t + s t²/2，s 即为二者之和",
            ),
            (
                Mistake(
                    Words("this is half of it: t^2 / 2", "这是一半：应为 t²/2"),
                ),
            ),
        ),
        Question(
            "tilt",
            "analysis",
            1,
            1e-4,
            Words(
                "the whole flight: p0, v0, tilt error and bias at once, the cosine of the heading integrated twice",
                "用全部数据同时估计 p0、v0、倾斜误差和漂移；偏航角余弦须积分两次",
            ),
            (Mistake(Words("in rad, not in degrees", "单位应为 rad，而不是度")),),
        ),
        Question(
            "bias",
            "analysis",
            1,
            8e-4,
            Words("of the same fit, in m/s^2", "同一次拟合的漂移，单位 m/s²"),
            (
                Mistake(
                    Words(
                        "the sign: acceleration = g tilt + cos(heading) bias", "符号：加速度 = g·倾斜误差 + cosψ·漂移"
                    )
                ),
            ),
        ),
        Question(
            "sigma",
            "analysis",
            1,
            1e-5,
            Words(
                "noise squared times the inverse of A' A, its diagonal, its root; noise from the residual",
                "噪声方差乘以 (AᵀA)⁻¹，取对角元再开方；噪声由残差求得",
            ),
            (
                Mistake(Words("this is the sigma if the tilt were known", "这是倾斜误差已知时的标准差")),
                Mistake(Words("this is the variance", "这是方差")),
            ),
        ),
        Question(
            "heading",
            "design",
            1,
            0.0,
            Words(
                "at which heading does the bias push most differently from the first?",
                "在哪个偏航角，漂移的作用与开始时相差最大？",
            ),
            accept=tells,
        ),
    ),
)
