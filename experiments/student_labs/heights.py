"""A flight's sonar and barometer of one's own: both heights, the barometer's bias, and the best of both."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sinan.experiments.student_labs.lab import Data, Lab, Mistake, Question, Words
from sinan.sensors.atmosphere import pressure_from_height, speed_of_sound

RATE, LENGTH = 5.0, 120.0  # Hz, s


def make(rng: np.random.Generator) -> tuple[Data, Mapping[str, object]]:
    """A flight between 1.5 and 4.5 m that leans, over ground that swallows an echo now and then."""
    t = np.arange(0.0, LENGTH, 1.0 / RATE)
    air, place = float(rng.uniform(-10.0, 35.0)), float(rng.uniform(50.0, 800.0))
    h = 3.0 - 1.5 * np.cos(2.0 * np.pi * t / float(rng.uniform(35.0, 50.0)))
    roll, pitch = (
        float(rng.uniform(0.2, 0.35)) * np.sin(2.0 * np.pi * t / x + rng.uniform(0.0, 6.0)) for x in (7.0, 9.0)
    )
    sonar, baro = float(rng.uniform(0.02, 0.05)), float(rng.uniform(0.15, 0.4))  # m
    drift = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 0.8))  # m/min
    d = h / (np.cos(roll) * np.cos(pitch)) + sonar * rng.standard_normal(len(t))
    time = 2.0 * d / speed_of_sound(np.array(air))
    time[rng.random(len(t)) < 0.05] = np.nan
    p = pressure_from_height(place + h + drift * t / 60.0 + baro * rng.standard_normal(len(t)))
    data = {"t": t, "time_of_flight": time, "roll": roll, "pitch": pitch, "pressure": p, "air": np.full(len(t), air)}
    return data, {"air": air, "place": place, "drift": drift, "sigma_sonar": sonar, "sigma_baro": baro}


LAB = Lab(
    make,
    (
        Question(
            "speed",
            "basic",
            1,
            0.3,
            Words("sqrt(1.4 x 287.05 x absolute temperature)", "声速 = √(1.4×287.05×绝对温度)"),
            (Mistake(Words("the temperature is in degC: the absolute one is needed", "温度应换算为绝对温度")),),
        ),
        Question(
            "height",
            "basic",
            1,
            0.01,
            Words(
                "mean height by sonar: d = v t / 2, times both cosines; leave rows without an echo out",
                "超声波平均高度：d = vΔt/2，再乘 cosθ cosφ；去掉没有反射波的行",
            ),
            (
                Mistake(Words("the tilt is still in it", "尚未做倾斜修正")),
                Mistake(Words("the sound goes there and back", "声波往返，应除以 2")),
            ),
        ),
        Question(
            "offset",
            "analysis",
            1,
            0.1,
            Words(
                "a line through barometer minus sonar: where is it at t = 0?",
                "对气压计高度减超声波高度做直线拟合，取 t = 0 处的值",
            ),
            (Mistake(Words("barometer minus sonar, not the other way round", "应为气压计减超声波")),),
        ),
        Question(
            "drift",
            "analysis",
            1,
            0.05,
            Words("the slope of that line, in m a minute", "该直线的斜率，单位为米/分"),
            (
                Mistake(within=0.002, hint=Words("this is in m/s", "这是米/秒")),
                Mistake(Words("barometer minus sonar, not the other way round", "应为气压计减超声波")),
            ),
        ),
        Question(
            "weight",
            "design",
            1,
            0.02,
            Words(
                "the variance of w x + (1 - w) y is least where w goes with the other one's variance; "
                "third differences (over sqrt(20)) show the noise",
                "w x + (1-w) y 的方差最小；噪声可由三阶差分（除以 √20）估计",
            ),
            (
                Mistake(Words("this is the barometer's share", "这是气压计的权重")),
                Mistake(Words("variances weigh, not standard deviations", "应按方差而不是标准差加权")),
            ),
        ),
    ),
)
