"""Every effect in the filter: the innovations of whole runs answer to beta as the propagated sensitivity says.

A new effect is taken up by its registry line and flown in the scenario that its declaration names.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from sinan.estimator.evidence.sensitivity import sensitivity_pass
from sinan.estimator.filter.effect_forms import is_lateness, with_covariates
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import FlightModel, flight_model
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.run_filter import run_filter
from sinan.estimator.filter.smoother import estimated_motion
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects import CATALOGUE, Effect
from sinan.sensors.motion import Motion
from sinan.sensors.recording import Recording
from sinan.sensors.scenario import Scenario
from sinan.sensors.simulate import simulate

ONE_PER_CENT = 0.01
STEP = 0.02  # of a plausible size, or less:
RESPONSE = 10.0  # sigma in all innovations together; above rounding, and the filter's response is still linear
DURATION = 32.0  # s of each scenario that are flown
#: All noise, walks and first errors by this factor. The regressors are evaluated along the smoothed motion, the exact
#: form along the filter's own, and only where the two agree is the sensitivity the derivative to a per cent.
QUIET = 0.03
NOISE = ("noise_density", "noise_std", "velocity_noise_std", "bias_walk", "bias_std")
INTERVAL = {"step": (14.0, np.inf), "transient": (14.0, 22.0)}  # s
#: A calibration shows it best, or it is asked of a flight besides.
IN_FLIGHT = {"accel_poses": "aerobatics", "gyro_poses": "aerobatics", "mag_poses": "aerobatics"}
DRAG = 0.25  # 1/s, of the scenarios' vehicle
#: Outliers leave the mean reading, and so the mean innovation, alone.
#: No scenario carries a camera: tests/estimator/test_camera_filter.py flies one.
NAMES = [
    n for n, e in CATALOGUE.items() if "flight" in e.kinds and e.stream != "camera" and not n.endswith(".outliers")
]
#: A lateness, and what else of its stream depends on the instant.
PAIRS = [
    (late, n) for late in NAMES if is_lateness(CATALOGUE[late])
    for n in NAMES if n != late and CATALOGUE[n].stream == CATALOGUE[late].stream and CATALOGUE[n].needs
]  # fmt: skip


def quiet(scenario: Scenario) -> Scenario:
    """The scenario with little noise."""
    sensors = {}
    for name, instrument in scenario.sensors.items():
        given = {key: getattr(instrument.spec, key) for key in NOISE}
        smaller = {key: QUIET * value for key, value in given.items() if value is not None}
        sensors[name] = replace(instrument, spec=replace(instrument.spec, **smaller))
    first = scenario.initial and tuple(QUIET * std for std in scenario.initial)
    return scenario.replace(sensors=sensors, initial=first)


@cache
def flown(scenario: str, drag_declared: bool, other: str = "") -> tuple[Recording, FlightModel, Motion]:
    """The beginning of a flight with nothing missing, its model and its estimated motion.

    Parameters
    ----------
    other : an effect that it has, and declares
    """
    present = {other: CATALOGUE[other].plausible} if other else {}
    recording, _ = simulate(quiet(load_scenario(scenario)), np.random.default_rng(7), present, declare=True)
    streams = {name: stream.rows(stream.t <= DURATION) for name, stream in recording.streams.items()}
    drag = {"motion.rotor_drag": (DRAG,)} if drag_declared else {}
    recording = recording.replace(streams=streams, effects={**recording.effects, **drag})
    model = flight_model(recording, gate_level=None)
    return recording, model, estimated_motion(run_filter(Flight(recording, model), engine="numba"))


def acting(name: str) -> Effect:
    """The effect, over an interval if it is time-localised."""
    entry = CATALOGUE[name]
    return entry if entry.localised is None else entry.over(*INTERVAL[name.split(".")[1]])


def by_reading(journal: Journal, rows: FloatArray) -> FloatArray:
    """Rows of whitened innovations, sensor after sensor: an order that a change of time stamps leaves alone."""
    order = np.lexsort((journal.index, journal.sensor))
    return np.concatenate([rows[journal.row[k] : journal.row[k + 1]] for k in order])


@pytest.mark.parametrize("name", NAMES)
def test_innovations_answer_as_the_sensitivity_says(name: str) -> None:
    """Central differences of whole runs, projected on S^-1/2 S_beta, against it: what the score works with."""
    entry = acting(name)
    scenario = IN_FLIGHT.get(entry.scenario, entry.scenario)
    assert answers(entry, *flown(scenario, "rotor_drag" in entry.needs)) == pytest.approx(1.0, abs=ONE_PER_CENT)


@pytest.mark.parametrize(("late", "other"), PAIRS)
def test_a_lateness_is_that_of_other_effects_too(late: str, other: str) -> None:
    """What they add is of the same instant: an antenna's arm turns, a compass's misalignment turns with the field."""
    entry = CATALOGUE[late]
    scenario = IN_FLIGHT.get(entry.scenario, entry.scenario)
    assert answers(entry, *flown(scenario, False, other)) == pytest.approx(1.0, abs=ONE_PER_CENT)


def answers(entry: Effect, recording: Recording, model: FlightModel, motion: Motion) -> FloatArray:
    """(p,) how much the innovations answer to each component, of what their sensitivity says: one."""
    assert not entry.missing(with_covariates(recording, entry.stream, motion))
    journal, found = sensitivity_pass(Flight(recording, model), [entry], motion=motion, keep_rows=1)
    assert np.all(journal.accepted)
    W = by_reading(journal, found.rows)
    parts = []
    for k in range(entry.size):
        size = min(STEP * entry.plausible_in(motion)[k], RESPONSE / np.linalg.norm(W[:, k]))
        h = size * np.eye(entry.size)[k]
        ahead, behind = (
            run_filter(Flight(recording, model), [(entry, sign * h)], engine="numba", stride=0) for sign in (1.0, -1.0)
        )
        change = -(by_reading(ahead, ahead.white) - by_reading(behind, behind.white)) / (2.0 * size)
        parts.append(change @ W[:, k] / (W[:, k] @ W[:, k]))
    return np.array(parts)


def test_outliers_leave_the_mean_alone() -> None:
    _, _, motion = flown("figure_eight", False)
    names = [name for name in CATALOGUE if name.endswith(".outliers")]
    assert names
    assert not any(np.any(CATALOGUE[name].regressor(motion)) for name in names)
