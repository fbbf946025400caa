"""Sizes of noise beside effects that nobody has named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import stats

from sinan.calibration.levels import preparation
from sinan.calibration.levels.beside_effects import Explained, beside_effects
from sinan.calibration.levels.levels import Levels
from sinan.calibration.levels.preparation import Prepared, prepared
from sinan.calibration.levels.problem import Problem
from sinan.estimator.evidence.score import log_evidence_of_all, statistic_of
from sinan.estimator.filter.flight import Flight
from sinan.experiments.residual_loop.open_flight import flight_source, source_of
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.recording import Recording, SensorSpec, Stream
from sinan.sensors.simulate import simulate
from tests.flights import scenario_at


def test_the_odds_for_all_effects_are_those_of_two_normal_laws() -> None:
    """Of readings that are noise alone, and of those whose covariance has what effects of plausible sizes add."""
    rng = np.random.default_rng(3)
    W, plausible = rng.standard_normal((40, 5)), np.array([0.1, 0.3, 1.0, 2.0, 5.0])
    z = rng.standard_normal(40) + W @ (plausible * rng.standard_normal(5))
    with_all = stats.multivariate_normal(cov=np.eye(40) + W @ np.diag(plausible**2) @ W.T).logpdf(z)
    assert log_evidence_of_all(W, z, plausible) == pytest.approx(with_all - stats.norm.logpdf(z).sum())


@cache
def flown(drift: float) -> Recording:
    """Forty seconds of a figure of eight that declares nothing, whose gyroscope drifts with its temperature."""
    recording, _ = simulate(scenario_at(50.0, "figure_eight"), np.random.default_rng(8), {})
    streams = {name: s.rows(s.t < s.t[0] + 40.0) for name, s in recording.streams.items()}
    imu = streams["imu"]
    temperature = 25.0 + 15.0 * np.sin(0.25 * imu.t)
    columns = {**imu.columns, "temperature": temperature}
    for axis, share in zip("xyz", (1.0, -0.7, 0.4), strict=True):
        columns[f"gyro_{axis}"] = columns[f"gyro_{axis}"] + share * drift * (temperature - 25.0)
    return recording.replace(streams={**streams, "imu": Stream(imu.t, columns)}, sensors={}, truth=None)


#: Of the gyroscope [rad/s/K].
DRIFT = 4e-4


@cache
def opened(drift: float) -> Prepared:
    """With sizes as they are without effects."""
    return prepared(flown(drift), late=False)


@cache
def beside(drift: float) -> Prepared:
    """With sizes as they are beside effects."""
    return prepared(flown(drift), late=False, effects=explained_of)


def explained_of(flight: Flight) -> Explained:
    """What all effects at once explain."""
    return source_of(flight, flight.recording).explained_by_all


def moved(drift: float) -> FloatArray:
    """By how many of their sigmas sizes are moved by effects that are open."""
    return in_sigmas(opened(drift).levels, beside(drift).levels)


def in_sigmas(before: Levels, after: Levels) -> FloatArray:
    """What sizes have changed by."""
    sizes = [size for size in before.found if not size.linear]
    sigmas = np.array([before.sigma_of[size.sensor, size.key] for size in sizes])
    return np.array([np.log(after.value(s) / before.value(s)) for s in sizes]) / sigmas


def test_without_an_effect_sizes_are_what_they_are() -> None:
    """Though all effects are open."""
    assert np.max(np.abs(moved(0.0))) < 0.3


def test_the_loop_opens_a_flight_beside_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the flight's own readings, and with what all effects explain of them."""
    asked = list[float]()

    def watched(levels: Levels, flight: Flight, effects: Callable[[Flight], Explained]) -> Levels:
        asked.append(effects(flight)(flight))
        return levels

    monkeypatch.setattr(preparation, "beside_effects", watched)
    source = flight_source(flown(DRIFT))
    assert asked == [pytest.approx(explained_of(opened(DRIFT).flight)(opened(DRIFT).flight), rel=0.02)]
    assert source.flight.model.gyro.sigma == opened(DRIFT).model.gyro.sigma


def test_a_log_with_one_fix_is_opened() -> None:
    """None of whose readings need be counted: nothing is explained then."""
    assert log_evidence_of_all(np.zeros((0, 3)), np.zeros(0), np.ones(3)) == 0.0
    whole = flown(DRIFT)
    imu = whole.streams["imu"]
    few = {"imu": imu.rows(imu.t < imu.t[0] + 6.0), "gps": whole.streams["gps"].rows([0])}
    told = {"gps": SensorSpec(noise_std=1.0, velocity_noise_std=0.1, bias_walk=0.0)}
    assert flight_source(whole.replace(streams=few, sensors=told)).candidates


def test_noise_leaves_an_effect_to_itself() -> None:
    """A gyroscope that drifts is told by a score half as large again; lateness stays as it was found."""
    scores = []
    for ready in (opened(DRIFT), beside(DRIFT)):
        source = source_of(ready.flight, ready.recording)
        scores.append(statistic_of(source.evidence(source.fit(())), "gyro.temperature").statistic)
    assert scores[1] > 1.3 * scores[0] > 40.0
    assert np.max(np.abs(moved(DRIFT))) > 1.0
    assert beside(DRIFT).levels.latency == opened(DRIFT).levels.latency


def test_both_terms_together_are_larger_there() -> None:
    """By sources opened with either noise, not by passes of the first with that of the second; the first alone is
    smaller.
    """
    before, after = opened(DRIFT), beside(DRIFT)
    sizes = [size for size in before.levels.found if not size.linear]
    values, explained = list[float](), list[float]()
    for ready in (before, after):
        problem = Problem(ready.recording, sizes, ready.levels)
        values.append(problem.value(problem.theta(ready.levels)))
        explained.append(explained_of(ready.flight)(ready.flight))
    assert values[1] < values[0]
    assert sum((values[1], explained[1])) > sum((values[0], explained[0])) + 2.0
    assert explained_of(before.flight)(after.flight) == pytest.approx(explained[1], rel=0.05)


def test_sizes_stay_where_effects_explain_the_same_whatever_they_are() -> None:
    """But for what the search without effects had left."""
    ready = opened(DRIFT)
    found = beside_effects(ready.levels, ready.flight, lambda _: lambda _: 7.0)
    assert np.max(np.abs(in_sigmas(ready.levels, found))) < 0.15


def test_what_is_declared_stays() -> None:
    """Nothing is sought where no size is open."""
    ready = opened(DRIFT)
    declared = replace(ready.levels, found=(), covariance=None)
    assert beside_effects(declared, ready.flight, explained_of) is declared


def test_where_no_model_follows_from_a_noise_it_is_not_taken() -> None:
    """Effects that explain ever more as the gyroscope's noise falls, of which no model follows below a half of it."""
    ready = opened(DRIFT)

    def explained(flight: Flight) -> float:
        share = flight.model.gyro.sigma / ready.model.gyro.sigma
        if share < 0.5:
            raise InputError("noise", f"{share}", "more")
        return float(-10.0 * np.log(share))

    found = beside_effects(ready.levels, ready.flight, lambda _: explained).flight(ready.recording)
    assert 0.5 <= found.model.gyro.sigma / ready.model.gyro.sigma < 0.9


def test_a_size_at_its_bound_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the noise without effects is as large as may be, and effects explain more with less of it."""
    ready = opened(DRIFT)
    size = next(s for s in ready.levels.found if (s.sensor, s.key) == ("gyro", "noise_density"))
    loud = ready.levels.with_size(size, size.at(size.bounds[1]))

    def explained(flight: Flight) -> float:
        return float(-100.0 * np.log(flight.model.gyro.sigma / ready.model.gyro.sigma))

    monkeypatch.setattr(Problem, "value", lambda *_: 0.0)
    monkeypatch.setattr(Problem, "value_and_gradient", lambda _, theta: (0.0, np.zeros(len(theta))))
    found = beside_effects(loud, loud.flight(ready.recording), lambda _: explained)
    assert found.value(size) < 0.5 * loud.value(size)


@pytest.mark.parametrize("error", [InputError("noise", "none", "some"), np.linalg.LinAlgError()])
def test_where_no_model_follows_sizes_stay(error: Exception) -> None:
    def none(_: Flight) -> Explained:
        raise error

    assert beside_effects(opened(DRIFT).levels, opened(DRIFT).flight, none) is opened(DRIFT).levels
