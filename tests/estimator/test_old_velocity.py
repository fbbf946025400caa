"""A receiver whose velocity is older than its position: its lead as a belief, in both engines, and found from a log."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest

from sinan.calibration.levels.assumptions import assumptions_of
from sinan.calibration.levels.declared_effects import Readings
from sinan.calibration.levels.fit import fit_levels
from sinan.calibration.levels.levels import Levels
from sinan.calibration.levels.preparation import level_notes
from sinan.calibration.levels.sizes import LATE_POSITION, sizes_of
from sinan.estimator.evidence.sensitivity import sensor_regressors
from sinan.estimator.filter.alignment import first_state
from sinan.estimator.filter.effect_forms import Along, Terms
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.layout import P_N, V_N
from sinan.estimator.filter.relinearise import run_relinearised
from sinan.estimator.filter.run_filter import run_filter
from sinan.sensors.effects import effect
from sinan.sensors.gps import Gps
from sinan.sensors.recording import POSITION, VELOCITY, Recording, SensorSpec, Stream
from sinan.sensors.rotation import matrix_from_quaternion
from tests.estimator.analytic_flight import SPECS, analytic_motion, fly
from tests.estimator.test_engines import AGREEMENT, difference

LEAD, LATE = 0.12, 0.16
#: With a receiver whose positions are good to centimetres.
FINE = {**SPECS, "gps": SensorSpec(noise_std=0.02, velocity_noise_std=0.1, bias_walk=0.001, bias_std=0.01)}


def older(
    duration: float, lead: float = LEAD, late: float = 0.0, specs: Mapping[str, SensorSpec] = SPECS
) -> tuple[Recording, np.ndarray]:
    """A flight whose fixes are stamped `late`, velocity `lead` more, and the true states at the IMU's samples."""
    recording, truth = fly(23, duration=duration, sensors=("gps", "baro"), specs=specs)
    gps = recording.streams["gps"]
    noise = gps.array(VELOCITY) - analytic_motion(gps.t).v_n
    old = analytic_motion(gps.t - lead).v_n + noise
    columns = {**gps.columns, **dict(zip(VELOCITY, old.T, strict=True))}
    return recording.replace(streams={**recording.streams, "gps": Stream(gps.t + late, columns)}), truth


def test_the_jacobian_is_the_derivative() -> None:
    gps, motion = Gps(1.0, 1.0, bias_std=1.0, lead=LEAD), analytic_motion(np.linspace(1.0, 5.0, 7))
    blocks = gps.jacobian(motion)
    for block, name in (("position", "p_n"), ("velocity", "v_n")):
        for k, step in enumerate(1e-3 * np.eye(3)):
            ends = [gps.predict(replace(motion, **{name: getattr(motion, name) + s * step})) for s in (1.0, -1.0)]
            assert np.allclose((ends[0] - ends[1]) / 2e-3, blocks[block][:, :, k], atol=1e-9)


def test_what_is_neglected_is_the_acceleration_over_the_lead() -> None:
    motion = analytic_motion(np.linspace(1.0, 20.0, 200))
    ahead = analytic_motion(motion.t + LEAD)
    left = ahead.p_n - Gps(1.0, 1.0, lead=LEAD).predict(motion)[:, :3]
    assert motion.a_n is not None
    assert np.allclose(left, 0.5 * motion.a_n * LEAD**2, atol=0.2 * np.max(np.abs(left)))


@pytest.mark.parametrize("way", [run_filter, run_relinearised])
def test_the_engines_agree(way: Callable[..., object]) -> None:
    recording, _ = older(5.0)
    flight = Flight.of(recording, latency={"gps": LEAD}, lead=LEAD, gate_level=None)
    fast, slow = (way(flight, engine=engine) for engine in ("numba", "filterpy"))
    assert difference(fast, slow) < AGREEMENT
    without = run_filter(Flight.of(recording, latency={"gps": LEAD}, gate_level=None))
    assert difference(without, fast) > 1e3 * AGREEMENT


def test_the_error_of_the_velocity_is_less_with_it() -> None:
    recording, truth = older(30.0, specs=FINE)
    errors = []
    for lead in (LEAD, 0.0):
        journal = run_filter(Flight.of(recording, latency={"gps": LEAD}, lead=lead, gate_level=None))
        t = np.searchsorted(recording.streams["imu"].t, journal.imu_t)
        errors.append(np.sqrt(np.mean((journal.imu_x[:, V_N] - truth[t, V_N])[2000:] ** 2)))
    assert errors[0] < 0.6 * errors[1]


def test_a_start_in_flight_is_where_the_body_is() -> None:
    recording, _ = older(3.0)
    recording = recording.replace(initial=replace(recording.initial, position=None, velocity=None))
    x, _ = first_state(Flight.of(recording, latency={"gps": LEAD}, lead=LEAD))
    gps = recording.streams["gps"]
    assert np.allclose(x[P_N], gps.array(POSITION)[0] - LEAD * gps.array(VELOCITY)[0])


def test_what_is_late_is_both() -> None:
    """The exact form of `gps.latency` is the receiver's own reading of an earlier instant."""
    gps, motion = Gps(1.0, 1.0, lead=LEAD), analytic_motion(np.linspace(1.0, 5.0, 401))
    late = effect("gps.latency").exact
    assert late is not None
    found = late(gps.predict(motion), np.array([0.2]), motion, gps)
    there = analytic_motion(motion.t - 0.2)
    assert np.allclose(found[50:], np.hstack([there.p_n + LEAD * there.v_n, there.v_n])[50:], atol=1e-3)


@pytest.fixture(scope="module")
def levels() -> Levels:
    """Of a minute without declared noise whose fixes are late, the velocity more."""
    recording, _ = older(60.0, late=LATE)
    return fit_levels(recording.replace(sensors={}), recording.environment.magnetic_field)


def test_the_lateness_of_each_is_found(levels: Levels) -> None:
    sigma = dict(zip(((s.sensor, s.key) for s in levels.found), levels.sigmas, strict=True))
    assert levels.latency["gps"] == pytest.approx(LATE + LEAD, abs=4.0 * sigma["latency", "gps"])
    assert levels.value(LATE_POSITION) == pytest.approx(LATE, abs=4.0 * sigma["latency", "gps_position"])
    assert sigma["latency", "gps_position"] < 0.02
    assert levels.lead == pytest.approx(LEAD, abs=0.02)


def test_it_stays_where_the_lateness_is_left_to_a_trace(levels: Levels) -> None:
    assert replace(levels, latency={}).lead == levels.lead == pytest.approx(LEAD, abs=0.02)


def test_what_a_trace_names_is_taken_off_once_when_it_is_declared() -> None:
    """`gps.latency` of the velocity, declared: the position is as much less late as before, and log L no less."""
    recording, _ = older(40.0, late=LATE, specs=FINE)
    bare = recording.replace(sensors={})
    told = bare.replace(effects={"gps.latency": (LATE + LEAD,)})
    plain, declared = (fit_levels(one, recording.environment.magnetic_field) for one in (bare, told))
    assert "gps" not in declared.latency
    assert declared.lead == pytest.approx(plain.lead, abs=0.01)
    assert plain.lead == pytest.approx(LEAD, abs=0.01)
    flights = plain.flight(bare), declared.flight(told)
    values = [run(Readings.of(flight).inputs(flight), "numba", 0).log_likelihood for flight in flights]
    assert values[1] > values[0] - 5.0


def test_an_antenna_on_an_arm_moves_while_the_position_is_awaited() -> None:
    recording, _ = older(20.0)
    flight = Flight.of(recording, latency={"gps": LEAD}, lead=LEAD, gate_level=None)
    terms, r = Terms.of({"gps.lever_arm": np.array([0.4, -0.2, 0.1])}), np.array([0.4, -0.2, 0.1])
    there = analytic_motion(flight.recording.streams["imu"].t)
    along = Along(flight, terms, there)
    at = along.at("gps")
    ahead = analytic_motion(at.t + LEAD)
    wanted = np.einsum("nij,j->ni", matrix_from_quaternion(ahead.q_nb), r)
    found = along.added["gps"].offset[:, :3]
    without = np.einsum("nij,j->ni", matrix_from_quaternion(at.q_nb), r)
    left, before = (np.sqrt(np.mean((one - wanted) ** 2)) for one in (found, without))
    assert left < 0.2 * before
    rows = sensor_regressors(along, "gps", [effect("gps.lever_arm")])
    unshaken = Along(flight, Terms(), there).added["gps"].offset  # of a receiver that does not follow vibration
    assert np.allclose(rows @ r, along.added["gps"].offset - unshaken, atol=1e-6)


def test_it_is_told_with_its_sigma(levels: Levels) -> None:
    recording, _ = older(60.0, late=LATE)
    bare = recording.replace(sensors={})
    rows = [row for row in assumptions_of(bare, levels, sizes_of(bare)) if "older than its position" in row.quantity]
    (row,) = rows
    assert (row.subject, row.unit, row.value) == ("gps", "s", pytest.approx(levels.lead))
    assert row.sigma is not None
    assert abs(row.value - LEAD) < 4.0 * row.sigma
    (told,) = [note for note in level_notes(levels) if note.startswith("gps: velocities")]
    said, sigma = re.findall(r"[\d.]+", told)
    assert float(said) == pytest.approx(1e3 * levels.lead, abs=0.5)
    assert float(sigma) == pytest.approx(1e3 * row.sigma, rel=0.5)
    assert told.endswith("ms older than the places of fixes, by the likelihood")
    younger = replace(levels, lead=-levels.lead)
    assert told.replace("older", "younger") in level_notes(younger)


def test_a_receiver_without_velocity_has_none() -> None:
    recording, _ = older(10.0)
    gps = recording.streams["gps"]
    places = Stream(gps.t, {name: gps[name] for name in POSITION})
    bare = recording.replace(sensors={}, streams={**recording.streams, "gps": places})
    assert LATE_POSITION not in sizes_of(bare)
    assert LATE_POSITION in sizes_of(recording.replace(sensors={}))
    assert LATE_POSITION not in sizes_of(recording)
    receiver = Flight.of(bare.replace(sensors=recording.sensors), lead=LEAD).model.sensors["gps"]
    assert isinstance(receiver, Gps)
    assert receiver.lead == 0.0
