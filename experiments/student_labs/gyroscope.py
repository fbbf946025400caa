"""A gyroscope of one's own, at rest and turned twice around: bias, scale, and how long a rest has to be."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sinan.experiments.student_labs.lab import Data, Lab, Mistake, Question, Words

RATE, REST, TURN, AFTER = 50.0, 20.0, 12.0, 4.0  # Hz, s
ANGLE = 4.0 * np.pi  # rad, two turns about z
WANTED = np.deg2rad(0.002)  # rad/s, 1 sigma of the bias that the design asks for


def make(rng: np.random.Generator) -> tuple[Data, Mapping[str, object]]:
    """Rest, two turns at the speed of a hand, rest; about the z axis."""
    t = np.arange(0.0, REST + TURN + AFTER, 1.0 / RATE)
    bias, scale = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.01, 0.03)), float(1.0 + rng.uniform(-0.04, 0.04))
    density = float(rng.uniform(2e-4, 6e-4))  # rad/s/sqrt(Hz)
    share = np.clip((t - REST) / TURN, 0.0, 1.0)
    w = ANGLE / TURN * (1.0 - np.cos(2.0 * np.pi * share))
    noise = density * np.sqrt(RATE) * rng.standard_normal(len(t))
    return {"t": t, "wz": w / scale + bias + noise}, {"bias": bias, "K": scale, "density": density}


LAB = Lab(
    make,
    (
        Question(
            "b",
            "basic",
            1,
            2e-4,
            Words(
                "the mean over the first 20 s at rest, with the sign of the model K (w + b)",
                "取前 20 s 静止段的平均值，注意模型 K(ω+b) 的符号",
            ),
            (
                Mistake(Words("the sign: b is added to the reading", "符号：b 与读数相加")),
                Mistake(Words("in rad/s", "单位应为 rad/s")),
            ),
        ),
        Question(
            "angle_raw",
            "basic",
            1,
            0.3,
            Words("add up reading times step over the whole log; in degrees", "对全部读数积分，单位为度"),
            (Mistake(Words("this is in radians", "这是弧度")),),
        ),
        Question(
            "angle",
            "basic",
            1,
            0.3,
            Words("the same after b is added", "加上 b 之后再积分"),
            (Mistake(Words("the bias is still in it", "偏移尚未去除")),),
        ),
        Question(
            "K",
            "analysis",
            1,
            1e-3,
            Words(
                "two turns are 720 deg: what factor makes the integral that?", "转两圈为 720 度：积分乘以多少才等于它？"
            ),
            (
                Mistake(Words("K multiplies the reading; this divides it", "尺度因子应乘以读数")),
                Mistake(Words("the bias is still in the integral", "积分中仍含有偏移")),
            ),
        ),
        Question(
            "density",
            "analysis",
            1,
            2e-5,
            Words("scatter at rest over the root of the rate of 50 Hz", "静止段标准差除以采样频率 50 Hz 的平方根"),
            (
                Mistake(
                    Words("this is the scatter of one reading, not its density", "这是单次读数的标准差，不是噪声密度")
                ),
            ),
        ),
        Question(
            "rest",
            "design",
            1,
            3.0,
            Words(
                "the mean over a time T has the 1 sigma N / sqrt(T); ask for 0.002 deg/s",
                "T 秒平均值的标准差为 N/√T；要求 0.002 度/秒",
            ),
            (Mistake(Words("a root too many", "多开了一次方")),),
        ),
    ),
)
