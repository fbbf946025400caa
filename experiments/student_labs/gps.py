"""Pseudoranges of one's own: four satellites, one that is off, corrections of a base station."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sinan.experiments.student_labs.lab import Data, Lab, Mistake, Question, Words
from sinan.sensors.arrays import FloatArray

SATELLITES, RADIUS, DISTANCE = 8, 6.371e6, 2.6e7  # of a round Earth [m]; of a satellite from its centre [m]
NOISE, COMMON, MULTIPATH = 0.3, 8.0, 40.0  # m
XYZ = ("x", "y", "z")


def make(rng: np.random.Generator) -> tuple[Data, Mapping[str, object]]:
    """Satellites above a place on a round Earth; errors that a base shares, and a reflection that it does not."""
    up = rng.standard_normal(3)
    up /= np.linalg.norm(up)
    receiver = RADIUS * up + rng.uniform(-100.0, 100.0, 3)
    places: list[FloatArray] = []
    while len(places) < SATELLITES:
        one = rng.standard_normal(3)
        one /= np.linalg.norm(one)
        if one @ up > 0.45 and all(one @ other < 0.97 for other in places):
            places.append(one)
    s = DISTANCE * np.array(places)
    clock, off = float(rng.uniform(-3e3, 3e3)), int(rng.integers(4, SATELLITES))
    common = COMMON * rng.standard_normal(SATELLITES)
    rho = np.linalg.norm(s - receiver, axis=1) + clock + common + NOISE * rng.standard_normal(SATELLITES)
    rho[off] += MULTIPATH
    correction = -common + NOISE * rng.standard_normal(SATELLITES)
    data = {c: s[:, k] for k, c in enumerate(XYZ)} | {"pseudorange": rho, "correction": correction}
    return data, {"receiver": receiver.tolist(), "clock": clock, "off": off + 1}


LAB = Lab(
    make,
    (
        Question(
            "position_four",
            "basic",
            3,
            0.5,
            Words(
                "four unknowns: position and clock, from the first four rows; go on until the step is "
                "below a millimetre",
                "四个未知数：位置与接收机钟差，用前四颗卫星；迭代至步长小于 1 mm",
            ),
            (Mistake(Words("these are all satellites, not the first four", "这是用全部卫星求得的")),),
        ),
        Question(
            "clock",
            "basic",
            1,
            0.5,
            Words("the fourth unknown, as a range in m", "第四个未知数，以米为单位"),
            (
                Mistake(
                    Words("the sign: here the clock is added to the distance", "符号：此处伪距等于距离加接收机钟差")
                ),
            ),
        ),
        Question(
            "satellite",
            "analysis",
            1,
            0.1,
            Words(
                "corrections first; then leave out one after the other and compare the sums of squares; count from 1",
                "先加校正值，再逐个去掉卫星比较残差平方和；从 1 开始编号",
            ),
            (Mistake(Words("count from 1", "从 1 开始编号")),),
        ),
        Question(
            "position",
            "design",
            3,
            0.3,
            Words("corrections applied, and without the one that is off", "使用校正值，并去掉有误差的卫星"),
            (
                Mistake(Words("the corrections are not applied", "尚未使用校正值")),
                Mistake(Words("the satellite that is off is still in it", "仍包含有误差的卫星")),
            ),
        ),
    ),
)
