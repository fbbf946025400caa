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
from sinan.sensors.joining import joined
from sinan.sensors.recording import Recording, SensorSpec, Stream
from sinan.sensors.simulate import simulate

EXACT = SensorSpec(noise_std=0.01, velocity_noise_std=0.01, bias_std=0.1, bias_walk=1e-3)


def hover() -> Recording:
    """It shows no lateness, and its receiver errs by a centimetre."""
    scenario = load_scenario("hover")
    receiver = replace(scenario.sensors["gps"], spec=EXACT)
    return simulate(replace(scenario, sensors={**scenario.sensors, "gps": receiver}), np.random.default_rng(2))[0]


@pytest.fixture(scope="module")
def passes() -> FlightPasses:
    return FlightPasses(Flight.of(hover()).believing(gate_level=None))


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
        mine = journal.accepted & (journal.sensor == journal.sensors.index("gps"))
        counted.append([set(journal.index[mine & passes.counted(journal, part)]) for part in ("all", "fitting")])
    assert all(one == counted[0] for one in counted)
    assert len(counted[0][1]) > 0.6 * len(counted[0][0])


def test_what_is_fitted_is_what_is_compared() -> None:
    """An offset that begins shortly before the part of the log that is fitted ends."""
    recording = hover()
    gps = recording.streams["gps"]
    split = FlightPasses(Flight.of(recording).believing(gate_level=None)).split
    off = (gps.t > split - 1.0) & (gps.t < split + 5.0)
    moved = Stream(gps.t, {**gps.columns, "north": gps["north"] + off})
    flight = Flight.of(recording.replace(streams={**recording.streams, "gps": moved})).believing(gate_level=None)
    wanted = effect("gps.transient").over(split - 1.0, split + 5.0)
    fit = FlightPasses(flight).fitted(Terms.of([(wanted, np.zeros(3))]), "fitting")
    assert fit.own.vector == pytest.approx([1.0, 0.0, 0.0], abs=4.0 * float(np.max(fit.std)))
    assert np.max(fit.std) < 0.03


def test_a_log_that_is_joined_to_another_has_ends_of_its_own(passes: FlightPasses) -> None:
    first, second = hover(), hover()
    both = FlightPasses(Flight.of(joined([first, second])).believing(gate_level=None))
    gps, (begin, end) = both.flight.recording.streams["gps"].t, both.table.spans[1]
    journal, _ = both.run([], both.plain)
    mine = np.flatnonzero(journal.sensor == journal.sensors.index("gps"))
    logged, counted = gps[journal.index[mine]], both.counted(journal, "all")[mine]
    near = (np.abs(logged - begin) < 0.4) | (np.abs(logged - end) < 0.4)
    assert np.any(near)
    assert not np.any(counted[near])
    assert np.all(counted[(logged > begin + 0.5) & (logged < end - 0.5)])
