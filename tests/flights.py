"""Scenarios whose IMU is slower: of half the samples a test takes half the time, and the density of its noise stays."""

from __future__ import annotations

from dataclasses import replace

from sinan.experiments.scenarios import load_scenario
from sinan.sensors.scenario import Scenario


def scenario_at(rate: float, name: str) -> Scenario:
    """A scenario whose accelerometer and gyroscope are sampled so often [Hz], those of poses as they are."""
    scenario = load_scenario(name)
    if scenario.kind != "flight":
        return scenario
    sensors = {n: replace(s, rate=rate) if n in ("accel", "gyro") else s for n, s in scenario.sensors.items()}
    return scenario.replace(sensors=sensors)
