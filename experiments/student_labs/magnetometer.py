"""A magnetometer of one's own on six faces: scale and offset, heading with tilt, and what the motors' current adds."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sinan.experiments.labs.attitudes import faces
from sinan.experiments.student_labs.lab import Data, Lab, Mistake, Question, Words

COLUMNS = ("mx", "my", "mz")
NOISE = 0.002  # of the field's norm
FIELD = 0.5  # gauss
HIGHEST = 20.0  # A


def make(rng: np.random.Generator) -> tuple[Data, Mapping[str, object]]:
    """Six faces without current, the same again with it, and a last row that leans: heading is asked of that."""
    K, b = 1.0 + rng.uniform(-0.05, 0.05, 3), rng.uniform(-0.15, 0.15, 3)
    d = rng.choice([-1.0, 1.0], 3) * rng.uniform(0.004, 0.01, 3)
    roll, pitch, yaw = (float(rng.uniform(-x, x)) for x in (0.5, 0.4, 3.0))
    turned = np.array([np.cos(yaw), -np.sin(yaw), 0.0]) * 0.5 + np.array([0.0, 0.0, np.sqrt(0.75)])
    Ry = np.array([[np.cos(pitch), 0, -np.sin(pitch)], [0, 1, 0], [np.sin(pitch), 0, np.cos(pitch)]])
    Rx = np.array([[1, 0, 0], [0, np.cos(roll), np.sin(roll)], [0, -np.sin(roll), np.cos(roll)]])
    m = np.vstack([faces()[:, ::2].reshape(-1, 3)] * 2 + [(Rx @ Ry @ turned)[None]])
    n = len(m) // 2
    current = np.concatenate([np.zeros(n), rng.uniform(0.0, HIGHEST, n), [0.0]])
    raw = FIELD * (m / K - b - current[:, None] * d + NOISE * rng.standard_normal(m.shape))
    tilt = np.zeros((len(m), 2))
    tilt[-1] = roll, pitch
    data = {c: raw[:, k] for k, c in enumerate(COLUMNS)}
    key = {"K": K.tolist(), "b": b.tolist(), "d": d.tolist(), "heading": float(np.rad2deg(yaw))}
    return data | {"current": current, "roll": tilt[:, 0], "pitch": tilt[:, 1]}, key


LAB = Lab(
    make,
    (
        Question(
            "norm",
            "basic",
            1,
            1e-4,
            Words(
                "mean of the norms of the rows without current, without the last row; not the norm of the mean",
                "无电流各行（最后一行除外）模长的平均值，而不是平均值的模长",
            ),
        ),
        Question(
            "K",
            "basic",
            3,
            2e-3,
            Words(
                "divide by the mean norm first; the residual is |K (m + b)| - 1",
                "先除以平均模长（归一化）；残差为 |K(m+b)| - 1",
            ),
            (Mistake(Words("K multiplies the reading; this divides it", "尺度因子应乘以读数")),),
        ),
        Question(
            "b",
            "basic",
            3,
            2e-3,
            Words("in units of the mean norm; rows without current only", "以平均模长归一化；只用无电流的数据"),
            (
                Mistake(Words("the sign: b is added to the reading", "符号：b 与读数相加")),
                Mistake(
                    Words(
                        "this is in gauss; b belongs to normalised readings", "这是以高斯为单位的值；b 应对应归一化读数"
                    )
                ),
            ),
        ),
        Question(
            "heading",
            "analysis",
            1,
            0.5,
            Words(
                "turn the field back by pitch and roll; heading = atan2(-m_y', m_x')",
                "先用俯仰角和滚转角将磁场转到水平面，再由 atan2(-m_y', m_x') 求偏航角",
            ),
            (
                Mistake(Words("this is the heading without the tilt", "这是没有倾斜修正的偏航角")),
                Mistake(Words("the sign: heading is counted clockwise", "符号：偏航角顺时针为正")),
            ),
        ),
        Question(
            "d",
            "design",
            3,
            4e-4,
            Words("let the offset grow with the current: |K (m + b + I d)| = 1", "令偏移随电流变化：|K(m+b+I d)| = 1"),
            (
                Mistake(Words("the sign: d is added like b", "符号：d 与 b 一样相加")),
                Mistake(Words("per ampere, not at the highest current", "应为每安培电流的值，而不是最大电流时的值")),
            ),
        ),
    ),
)
