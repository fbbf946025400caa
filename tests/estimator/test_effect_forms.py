"""Effects in the filter: innovations answer to beta as the propagated sensitivity says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.estimator.evidence.sensitivity import Sensitivity, candidate_streams, sensitivity_pass, sensor_regressors
from sinan.estimator.filter.effect_forms import Along, Terms, declared_terms, stream_form, with_covariates
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import flight_model
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.run_filter import run_filter
from sinan.estimator.filter.smoother import estimated_motion
from sinan.experiments.scenarios.loader import load_scenario
from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects import CATALOGUE, effect, effects_for
from sinan.sensors.errors import InputError
from sinan.sensors.motion import Motion
from sinan.sensors.ranging import slant_range_jacobian
from sinan.sensors.recording import Recording
from sinan.sensors.simulate import simulate

ONE_PER_CENT = 0.01
STEP = 0.02  # of a plausible size: the response is linear there
NAMES = sorted(
    e.name for e in CATALOGUE.values()
    if "flight" in e.kinds and not e.is_local and e.stream not in ("pseudorange", "level", "base")
)  # fmt: skip


@pytest.fixture(scope="module")
def flown() -> tuple[Recording, Motion, Journal, Sensitivity]:
    recording, _ = simulate(load_scenario("aerobatics"), np.random.default_rng(7))
    model = flight_model(recording, gate_level=None)
    journal = run_filter(Flight(recording, model), engine="numba")
    motion = estimated_motion(journal)
    candidates = [
        e for e in effects_for("flight", candidate_streams(model))
        if not e.missing(with_covariates(recording, e.stream, motion))
    ]  # fmt: skip
    return recording, motion, *sensitivity_pass(Flight(recording, model), candidates, motion=motion, keep_rows=1)


def by_reading(journal: Journal) -> FloatArray:
    """Whitened innovations, sensor after sensor: an order that a change of time stamps leaves alone."""
    order = np.lexsort((journal.index, journal.sensor))
    return np.concatenate([journal.white[journal.row[k] : journal.row[k + 1]] for k in order])


@pytest.mark.parametrize("name", NAMES)
def test_innovations_answer_as_the_sensitivity_says(flown, name: str) -> None:
    """Central differences of whole runs, projected on S^-1/2 S_beta, against it: what the score works with."""
    recording, motion, journal, found = flown
    if name not in [e.name for e in found.effects]:
        pytest.skip("the scenario lacks what the effect needs")
    entry, model = effect(name), journal.model
    k = entry.size - 1
    h = np.zeros(entry.size)
    h[k] = STEP * entry.plausible_in(motion)[k]
    ends = [
        by_reading(run_filter(Flight(recording, model), {name: s * h}, engine="numba", stride=0)) for s in (1.0, -1.0)
    ]
    S = np.zeros(len(journal.white))
    S[np.repeat(journal.accepted, journal.dof)] = found.rows[:, found.of(name)][:, k]
    order = np.lexsort((journal.index, journal.sensor))
    S = np.concatenate([S[journal.row[i] : journal.row[i + 1]] for i in order])
    slope = -(ends[0] - ends[1]) @ S / (2.0 * h[k]) / (S @ S)
    assert abs(slope - 1.0) < ONE_PER_CENT


def test_declared_effects_are_modelled() -> None:
    scenario = load_scenario("figure_eight")
    beta = [0.05, -0.03, 0.04]
    declared, _ = simulate(scenario, np.random.default_rng(3), {"mag.scale": beta}, declare=True)
    model = flight_model(declared)
    with_it = run_filter(Flight(declared, model), engine="numba", stride=0)
    without = run_filter(Flight(declared.replace(effects={}), model.replace(gate_level=None)), engine="numba", stride=0)
    assert with_it.nis_per_dof()["mag"] == pytest.approx(1.0, abs=0.05)
    assert without.nis_per_dof()["mag"] > 1.5


def test_beta_of_the_wrong_length_is_named() -> None:
    with pytest.raises(ValueError, match=r"`mag.scale` is \[0.1\]; expected 3"):
        Terms.of({"mag.scale": [0.1]})


def test_declared_effect_that_does_not_exist() -> None:
    recording, _ = simulate(load_scenario("hover"), np.random.default_rng(1))
    with pytest.raises(InputError, match=r"\[effects\].*mag.scael"):
        declared_terms(recording.replace(effects={"mag.scael": (0.1,)}))
    with pytest.raises(InputError, match=r"\[effects\] baro.lag: -0.1; expected b of at least 0 s"):
        declared_terms(recording.replace(effects={"baro.lag": (-0.1,)}))
    assert declared_terms(recording.replace(effects={"baro.lag": (0.0,)})).vector == [0.0]


def test_scores_of_a_clean_flight_are_normal(flown) -> None:
    """b' Lambda^-1 b over all candidates: chi-square with as many degrees of freedom as directions that are seen."""
    found = flown[3]
    Lambda, b = found.total
    scale = 1.0 / np.sqrt(np.diag(Lambda).clip(1e-300))
    w, Q = np.linalg.eigh(Lambda * np.outer(scale, scale))
    seen = w > 1e-6
    z = (Q.T @ (b * scale))[seen] / np.sqrt(w[seen])
    assert abs(np.mean(z**2) - 1.0) < 3.3 * np.sqrt(2.0 / seen.sum())


def test_effects_on_readings_that_the_reference_does_not_predict(flown) -> None:
    """Upside down a sonar's beam is above the horizon: its prediction is infinite, and an effect adds nothing to it."""
    recording, motion, _, _ = flown
    on_its_back = np.tile((0.0, 1.0, 0.0, 0.0), (len(motion), 1))
    over = replace(motion, q_nb=on_its_back)
    model = flight_model(recording, gate_level=None)
    for name in ("sonar.sound_speed", "sonar.beam_cone", "sonar.mount_offset"):
        terms = Terms.of({name: effect(name).plausible})
        along = Along(Flight(recording, model), terms, over)
        form = stream_form(along, "sonar")
        assert np.all(np.isfinite(form.offset))
        assert np.all(np.isfinite(form.D))
        rows = sensor_regressors(along, "sonar", [effect(name)])
        assert np.all(np.isfinite(rows))


def test_the_jacobian_of_a_beam_above_the_horizon_makes_no_warning() -> None:
    over = Motion(t=np.zeros(2), p_n=np.zeros((2, 3)), q_nb=np.array([[0.0, 1.0, 0.0, 0.0], [0.5, 0.5, 0.5, 0.5]]))
    assert set(slant_range_jacobian(over)) == {"position", "attitude"}


@pytest.mark.parametrize("stream", ["sonar", "laser"])
def test_a_late_beam_above_the_horizon_changes_nothing(stream: str) -> None:
    """Its rate is infinity less infinity: taken as a regressor, it would make the next estimate no number."""
    over = Motion(
        t=np.zeros(2), p_n=np.tile((0.0, 0.0, -3.0), (2, 1)), v_n=np.ones((2, 3)),
        q_nb=np.array([[0.1, 0.98, 0.1, -0.1], [0.5, 0.8, -0.2, 0.3]]),
        w_ib_b=np.array([[1.0, 2.0, 0.5], [-1.0, 0.3, 2.0]]),
    )  # fmt: skip
    np.testing.assert_array_equal(effect(f"{stream}.time_offset").regressor(over), 0.0)
