"""A slow error of the GPS that nobody declared: found, its noise taken off, and effects seen beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.estimator.filter.flight_model import flight_model
from sinan.experiments.residual_loop.flight import FlightSource
from sinan.experiments.residual_loop.flight_passes import FlightPasses
from sinan.experiments.residual_loop.gps_drift import GpsDrift, Law, Whitening, error_at_nodes, nodes_for, rows_of
from sinan.experiments.residual_loop.select import select
from sinan.experiments.scenarios import load_scenario, parse_effect
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import POSITION, Recording
from sinan.sensors.simulate import simulate

TAU, SHARE = 4.0, 0.8


def flown(scenario: str, seed: int, *effects: str) -> Recording:
    return simulate(load_scenario(scenario), np.random.default_rng(seed), [parse_effect(e) for e in effects])[0]


def drifting(recording: Recording, seed: int, tau: float = TAU, share: float = SHARE) -> Recording:
    """With a first-order Markov process on each coordinate of the GPS, in shares of its declared noise."""
    rng, gps = np.random.default_rng(seed), recording.streams["gps"]
    error = np.empty((len(gps.t), 3))
    error[0] = rng.standard_normal(3)
    for k, decay in enumerate(np.exp(-np.diff(gps.t) / tau), start=1):
        error[k] = decay * error[k - 1] + np.sqrt(1.0 - decay**2) * rng.standard_normal(3)
    error *= share * recording.spec("gps").noise_std
    columns = {**gps.columns, **{c: gps.columns[c] + error[:, i] for i, c in enumerate(POSITION)}}
    return recording.replace(streams={**recording.streams, "gps": replace(gps, columns=columns)})


def source(recording: Recording) -> FlightSource:
    return FlightSource(recording, flight_model(recording))


@pytest.fixture(scope="module")
def plain() -> Recording:
    return flown("figure_eight", 31)


def test_the_whitening_is_a_root_of_the_covariance() -> None:
    rng = np.random.default_rng(1)
    V, A = rng.standard_normal((400, 6)), rng.standard_normal((6, 6))
    V[:200, 3:] = 0.0  # which is later
    K = A @ A.T
    dense = np.eye(400) + V @ K @ V.T
    whitening = Whitening(V, K)
    L = np.linalg.cholesky(dense)
    y = rng.standard_normal((400, 3))
    np.testing.assert_allclose(whitening.of(y), np.linalg.solve(L, y), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(whitening.log_root, np.log(np.diag(L)), rtol=1e-9)


def test_a_constant_error_is_a_bias_of_the_filter(plain: Recording) -> None:
    """A drift that lasts for ever is a constant: the innovations are those of a filter with a wider bias."""
    model = flight_model(plain)
    gps, more = model.sensors["gps"], 2.0
    wider = replace(gps, bias_std=float(np.hypot(gps.bias_std, more)))
    passes = FlightPasses(plain, model)
    nodes = np.linspace(passes.start, passes.end, 5)
    journal, at_nodes = passes.run([error_at_nodes(nodes)], passes.plain)
    drift = GpsDrift.of(Law(nodes, np.inf, more), journal, at_nodes)
    taken_off, _ = drift.taken_off(journal, at_nodes)
    known = FlightPasses(plain, model.replace(sensors={**model.sensors, "gps": wider}))
    asked, _ = known.run([], known.along([], [], passes.plain_motion))
    assert passes.deviance(taken_off, "all") == pytest.approx(passes.deviance(asked, "all"), abs=0.05)
    assert abs(passes.deviance(journal, "all") - passes.deviance(asked, "all")) > 1.0
    used = rows_of(journal)
    np.testing.assert_allclose(taken_off.white[used] ** 2, asked.white[used] ** 2, atol=0.02)


def test_a_slow_error_is_found_with_its_size(plain: Recording) -> None:
    law = source(drifting(plain, 2)).slow_error
    assert law is not None
    assert TAU / 2.5 < law.tau < 2.5 * TAU
    assert law.sigma == pytest.approx(SHARE * plain.spec("gps").noise_std, rel=0.35)


@pytest.mark.parametrize(
    "effects", [(), ("gps.step=3,-2,2@60",), ("gps.transient=4,0,-4@40:50",), ("gps.latency=0.2",)]
)
def test_what_is_no_slow_error_is_not_taken_for_one(effects: tuple[str, ...]) -> None:
    assert source(flown("figure_eight", 32, *effects)).slow_error is None


def test_what_comes_and_goes_has_no_law(plain: Recording) -> None:
    """A reflection: metres along one direction, two seconds at a time, where the receiver comes by."""
    gps = plain.streams["gps"]
    error = 3.0 * sum(np.exp(-0.5 * (gps.t - t) ** 2) for t in (20.0, 45.0, 70.0))
    columns = {**gps.columns, POSITION[0]: gps.columns[POSITION[0]] + error}
    reflected = plain.replace(streams={**plain.streams, "gps": replace(gps, columns=columns)})
    assert source(reflected).slow_error is None


def test_beside_a_slow_error_the_residual_is_white_and_no_effect_named(plain: Recording) -> None:
    coloured = source(drifting(plain, 3))
    fit = coloured.fit(())
    gps = next(r for r in coloured.residuals(fit) if r.stream == "gps")
    assert _neighbours(gps.whitened[:, :3]) < 0.1
    assert _neighbours(gps.residual[:, :3]) > 0.15
    assert select(coloured).names == ()


def test_the_right_effect_beside_a_slow_error() -> None:
    present = parse_effect("gyro.scale=0.012,-0.01,0.015")
    selection = select(source(drifting(flown("figure_eight", 33, "gyro.scale=0.012,-0.01,0.015"), 4)))
    assert selection.names == (present.effect.name,)
    finding = selection.findings[0]
    assert np.all(np.abs(finding.beta - present.beta) < 4.0 * finding.std)


def test_a_disturbance_that_passed_for_a_slow_error_is_none() -> None:
    recording = flown("figure_eight", 12, "gps.transient=1.26,-0.88,1.01@20:33")
    streams = {name: stream.rows(stream.t <= 50.0) for name, stream in recording.streams.items()}
    disturbed = source(recording.replace(streams=streams))
    assert disturbed.slow_error is not None
    assert _notes(disturbed) == 1
    assert select(disturbed).names == ("gps.transient",)
    assert disturbed.slow_error is None
    assert _notes(disturbed) == 0


def test_laws_are_alike_where_what_they_add_to_the_noise_is() -> None:
    law = Law(np.zeros(0), tau=16.0, sigma=1.0, noise=1.0)
    assert law.is_like(replace(law, tau=40.0, sigma=1.3))  # neighbours of those that are tried
    assert law.is_like(replace(law, sigma=2.0, noise=4.0))
    assert not law.is_like(replace(law, noise=5.0))
    assert not law.is_like(replace(law, tau=1.5))


def test_another_law_is_in_the_passes_over_readings_that_were_seen_before(plain: Recording) -> None:
    passes = FlightPasses(plain, flight_model(plain))
    nodes = nodes_for(passes.start, passes.end, 1)
    deviance = {}
    for sigma in (0.5, 2.0, 0.5):
        passes.slow_error = Law(nodes, 10.0, sigma)
        found = passes.deviance(passes.run([], passes.plain)[0], "all")
        assert deviance.setdefault(sigma, found) == found
    assert abs(deviance[0.5] - deviance[2.0]) > 1.0


def test_few_readings_have_no_nodes() -> None:
    assert not len(nodes_for(0.0, 5.0, 1000))
    assert not len(nodes_for(0.0, 1e4, 10**7))
    assert len(nodes_for(0.0, 100.0, 10**4)) == 100


def _notes(source: FlightSource) -> int:
    """Lines that tell of a slow error."""
    return sum("errs slowly" in str(note) for note in source.recording.notes)


def _neighbours(z: FloatArray) -> float:
    """Correlation of neighbouring rows."""
    return float(np.sum(z[1:] * z[:-1]) / np.sum(z**2))
