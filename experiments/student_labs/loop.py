"""A residual of one's own: which effect explains it, its size, and the error on data that took no part in the fit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sinan.experiments.student_labs.lab import Data, Lab, Mistake, Question, Words
from sinan.sensors.arrays import IntArray

RATE, LENGTH, NOISE = 2.0, 300.0, 0.1  # Hz, s, m: the declared noise of a reading
TRAINED = 200.0  # s: what comes later is held out
CANDIDATES = ("current", "temperature", "airspeed")


def make(rng: np.random.Generator) -> tuple[Data, Mapping[str, object]]:
    """A residual with one effect in it, and three covariates, of which another one resembles the right one."""
    t = np.arange(0.0, LENGTH, 1.0 / RATE)
    waves = [np.sin(2.0 * np.pi * t / p + rng.uniform(0.0, 6.0)) for p in rng.uniform(11.0, 70.0, 6)]
    plain = np.array([waves[2 * k] + 0.6 * waves[2 * k + 1] for k in range(3)])
    order = rng.permutation(3)
    right, alike = int(order[0]), int(order[1])
    plain[alike] = 0.75 * plain[right] + 0.5 * plain[alike]
    x = plain / np.std(plain, axis=1, keepdims=True) * np.array([[3.0], [4.0], [2.0]])  # A, degC, m/s
    beta = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.08, 0.2)) / float(np.std(x[right]))
    residual = beta * x[right] + NOISE * rng.standard_normal(len(t))
    data = {"t": t, "residual": residual} | dict(zip(CANDIDATES, x, strict=True))
    return data, {"effect": right + 1, "beta": beta, "alike": alike + 1}


def rows(data: Data, late: bool) -> IntArray:
    """Numbers of the rows that are held out (late), or of those that the fit sees."""
    return np.flatnonzero((data["t"] >= TRAINED) == late)


_FIT = Words("only the rows before 200 s take part in the fit", "只有 200 s 之前的数据参与拟合")
LAB = Lab(
    make,
    (
        Question(
            "statistics",
            "basic",
            3,
            0.5,
            Words(
                "(x' r)^2 / (x' x) / 0.01 of each candidate alone, rows before 200 s",
                "对每个候选项分别计算 (xᵀr)²/(xᵀx)/0.01，用 200 s 之前的数据",
            ),
            (
                Mistake(
                    Words(
                        "these are of all rows: the last 100 s are held out",
                        "这是全部数据的结果：最后 100 s 不参与拟合",
                    )
                ),
                Mistake(Words("in units of the noise's variance, 0.01 m^2", "应以噪声方差 0.01 m² 为单位")),
            ),
        ),
        Question(
            "effect",
            "basic",
            1,
            0.1,
            Words("the candidate that explains most, counted from 1", "解释残差最多的候选项，从 1 开始编号"),
            (
                Mistake(
                    Words(
                        "this one resembles the right one: its statistic is smaller",
                        "它只是与正确的候选项相似，统计量较小",
                    )
                ),
            ),
        ),
        Question(
            "beta",
            "analysis",
            1,
            2e-5,
            Words("least squares of r = beta x: x' r / (x' x)", "r = βx 的最小二乘解：xᵀr/(xᵀx)"),
            (Mistake(_FIT), Mistake(Words("the sign", "符号"))),
        ),
        Question(
            "sigma",
            "analysis",
            1,
            1e-5,
            Words("the noise, 0.1 m, over the root of x' x", "噪声 0.1 m 除以 xᵀx 的平方根"),
            (Mistake(Words("this is the variance", "这是方差"), 2e-7),),
        ),
        Question(
            "held_out",
            "analysis",
            2,
            2e-4,
            Words(
                "root of the mean square of the residual, rows from 200 s on, before and after beta x is taken off",
                "200 s 之后残差的均方根：减去 βx 之前和之后",
            ),
            (Mistake(Words("these are of the rows that the fit has seen", "这是参与拟合的数据的结果"), 2e-4),),
        ),
        Question(
            "remaining",
            "analysis",
            1,
            0.02,
            Words(
                "largest statistic of the other two after the effect: project x out of the candidate and out of r",
                "加入该项之后其余两项中最大的统计量：先从候选项和残差中去掉 x 的分量",
            ),
            (
                Mistake(
                    Words("x is still in the candidate: project it out there too", "候选项中仍含有 x 的分量，也应去掉"),
                    0.05,
                ),
            ),
        ),
        Question(
            "seconds",
            "design",
            1,
            20.0,
            Words(
                "beta / 10 is to be five sigma; sigma falls with the root of the length",
                "β/10 应等于 5 倍标准差；标准差随长度的平方根减小",
            ),
            (
                Mistake(
                    Words(
                        "sigma falls with the root of the length, not with the length",
                        "标准差与长度的平方根成反比，而不是与长度成反比",
                    )
                ),
            ),
        ),
    ),
)
