"""Which scenarios fly what the filter assumes, and why the others do not."""

from __future__ import annotations

from sinan.experiments.scenarios import load_scenario, scenario_names
from sinan.sensors.scenario import Scenario


def why_not(scenario: Scenario) -> str | None:
    """What in a scenario's world the filter is not told, in words; None: the filter's model is the truth."""
    if scenario.kind != "flight":
        return "poses: no motion that a filter could follow"
    if "gps" not in scenario.sensors:
        return "`level` bounds the acceleration by an assumption, which is no white noise of its sigma"
    if any(scenario.vibration.amplitude):
        return "the IMU shakes in its mount, the truth is that of the vehicle"
    return None


def matched_scenarios() -> dict[str, Scenario]:
    """The shipped scenarios in which every assumption of the filter holds."""
    loaded = {name: load_scenario(name) for name in scenario_names()}
    return {name: scenario for name, scenario in loaded.items() if why_not(scenario) is None}


def other_scenarios() -> dict[str, str]:
    """The other shipped scenarios, and why."""
    reasons = {name: why_not(load_scenario(name)) for name in scenario_names()}
    return {name: reason for name, reason in reasons.items() if reason is not None}
