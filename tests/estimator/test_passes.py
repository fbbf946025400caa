"""Two models are compared by the same readings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.estimator.evidence.flights.passes import FlightPasses
from sinan.estimator.filter.effect_forms import Terms
from sinan.estimator.filter.flight import Flight
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.effects import effect
from sinan.sensors.recording import SensorSpec
from sinan.sensors.simulate import simulate

EXACT = SensorSpec(noise_std=0.01, velocity_noise_std=0.01, bias_std=0.1, bias_walk=1e-3)


@pytest.fixture(scope="module")
def passes() -> FlightPasses:
    """Of a hover, which shows no lateness, whose receiver errs by a centimetre."""
    scenario = load_scenario("hover")
    receiver = replace(scenario.sensors["gps"], spec=EXACT)
    recording, _ = simulate(replace(scenario, sensors={**scenario.sensors, "gps": receiver}), np.random.default_rng(2))
    return FlightPasses(Flight.of(recording).believing(gate_level=None))


def test_a_fix_that_a_lateness_moves_out_of_the_log_is_no_gain_and_no_loss(passes: FlightPasses) -> None:
    t = passes.flight.recording.streams["gps"].t
    step = float(np.median(np.diff(t)))

    def at(lateness: float) -> tuple[float, float, int]:
        along = passes.along(Terms.of([(effect("gps.latency"), np.array([lateness]))]), passes.plain_motion)
        journal, _ = passes.run([], along)
        fixes = int(np.sum(journal.accepted & (journal.sensor == journal.sensors.index("gps"))))
        return passes.deviance(journal, "all"), -2.0 * journal.log_likelihood, fixes

    until, little = float(t[0]) - passes.start, 0.01 * step
    kept, lost = at(until - little), at(until + little)
    assert lost[2] == kept[2] - 1
    assert lost[1] - kept[1] > 30.0  # what the density of one fix was
    assert abs(lost[0] - kept[0]) < 6.0  # the filter begins with one fix less


def test_a_lateness_changes_neither_part(passes: FlightPasses) -> None:
    counted = []
    for lateness in (-0.3, -0.1, 0.0, 0.1, 0.3):
        along = passes.along(Terms.of([(effect("gps.latency"), np.array([lateness]))]), passes.plain_motion)
        journal, _ = passes.run([], along)
        mine = journal.sensor == journal.sensors.index("gps")
        ends = passes.end, passes.split
        inside = [journal.is_inside(passes.flight.recording, passes._late, passes.start, end) for end in ends]
        counted.append([set(journal.index[mine & one]) for one in inside])
    assert all(one == counted[0] for one in counted)
    assert len(counted[0][1]) > 0.6 * len(counted[0][0])
