"""Scenarios whose IMU is slower: of half the samples a test takes half the time, and the density of its noise stays."""

from __future__ import annotations

from sinan.experiments.scenarios import load_scenario
from sinan.sensors.scenario import Scenario


def scenario_at(rate: float, name: str) -> Scenario:
    """A scenario whose accelerometer and gyroscope are sampled so often [Hz], those of poses as they are."""
    scenario = load_scenario(name)
    return scenario.with_imu_rate(rate) if scenario.kind == "flight" else scenario
