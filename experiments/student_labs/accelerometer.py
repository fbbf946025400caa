"""Ten poses of an accelerometer of one's own; the same with g = 1; an attitude that shows what they leave open."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sinan.experiments.labs.attitudes import determined, poses
from sinan.experiments.student_labs.lab import Data, Lab, Mistake, Question, Words
from sinan.sensors.arrays import FloatArray
from sinan.sensors.rotation import quaternion_from_rpy, rotate_back

G, NOISE, POSE = 9.8, 0.005, 9  # m/s^2, m/s^2 of a pose's mean, the row whose pitch is asked for
COLUMNS = ("ax", "ay", "az")
_SIGN = Words(
    "the sign of b: the model is K (a + b), so b is minus what the sensor adds",
    "偏移 b 的符号：模型为 K (a + b)，b 与传感器附加的量相反",
)


def make(rng: np.random.Generator) -> tuple[Data, Mapping[str, object]]:
    """The course's ten attitudes, held by hand a few degrees off, with errors of the student's own."""
    K, b = 1.0 + rng.uniform(-0.03, 0.03, 3), rng.uniform(-0.3, 0.3, 3)
    lean = quaternion_from_rpy(np.deg2rad(rng.uniform(-5.0, 5.0, (10, 3))))
    f = rotate_back(lean, poses() / np.linalg.norm(poses(), axis=1, keepdims=True) * G)
    raw = f / K - b + NOISE * rng.standard_normal((10, 3))
    return {c: raw[:, k] for k, c in enumerate(COLUMNS)}, {"K": K.tolist(), "b": b.tolist()}


def closes(data: Data, angles: FloatArray) -> bool:
    """Whether an attitude of this roll and pitch [deg], beside the ten, determines all nine unknowns of T K."""
    q = quaternion_from_rpy(np.deg2rad([[angles[0], angles[1], 0.0]]))
    more = rotate_back(q, np.array([[0.0, 0.0, -G]]))
    return bool(np.all(determined(np.vstack([poses(), more]), 2e-3)[0] < 0.005))


LAB = Lab(
    make,
    (
        Question(
            "K",
            "basic",
            3,
            2e-3,
            Words("is the residual | K (a + b) | - g, with g = 9.8?", "残差是否为 |K(a+b)| - g，g = 9.8？"),
            (
                Mistake(Words("K multiplies the reading; this divides it", "尺度因子 K 应乘以读数，而不是除")),
                Mistake(Words("this is K for g = 1", "这是 g = 1 时的尺度因子")),
            ),
        ),
        Question(
            "b",
            "basic",
            3,
            5e-3,
            Words(
                "b is added before K multiplies; did the fit run to its end?", "偏移 b 在乘 K 之前相加；迭代收敛了吗？"
            ),
            (Mistake(_SIGN),),
        ),
        Question(
            "index_before",
            "basic",
            1,
            1e-3,
            Words("sum of squares with K = 1 and b = 0", "取 K = 1、b = 0 时的残差平方和，即指标函数"),
        ),
        Question(
            "index_after",
            "basic",
            1,
            1e-4,
            Words("sum of squares at the minimum, not its root or mean", "最优参数处的平方和，不是平均值或平方根"),
        ),
        Question(
            "K_one",
            "analysis",
            3,
            2e-4,
            Words("the same calibration with g = 1", "取 g = 1 重新标定"),
            (Mistake(Words("this is K for g = 9.8", "这是 g = 9.8 时的尺度因子")),),
        ),
        Question(
            "pitch",
            "analysis",
            1,
            0.02,
            Words(
                "at rest f = (g sin pitch, ...): forward-right-down, the z axis reads -g",
                "静止时 f_x = g sinθ，θ 为俯仰角；前-右-下坐标系，z 轴读数为 -g",
            ),
            (
                Mistake(
                    Words(
                        "the sign: the accelerometer reads specific force, minus gravity",
                        "符号：加速度计测量的是比力，与重力加速度方向相反",
                    )
                ),
                Mistake(Words("this is the pitch of the raw reading", "这是由标定前的读数求得的俯仰角")),
                Mistake(Words("this is in radians; degrees are asked for", "单位应为度")),
            ),
        ),
        Question(
            "attitude",
            "design",
            2,
            0.0,
            Words(
                "which product of two axes is zero in all ten attitudes? lean so that it is not",
                "十个姿态中哪两轴读数之积恒为零？请选择使其不为零的姿态",
            ),
            accept=closes,
        ),
    ),
)
