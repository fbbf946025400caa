"""A slow error of the GPS that nobody declared: a state whose size the log tells; and effects seen besides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.calibration.levels.preparation import as_declared
from sinan.experiments.residual_loop.open_flight import flight_source
from sinan.experiments.residual_loop.select import select
from sinan.experiments.scenarios import parse_effect
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import POSITION, Recording
from sinan.sensors.simulate import simulate
from sinan.sensors.window import between
from tests.flights import scenario_at

TAU, SHARE = 4.0, 0.8


def flown(scenario: str, seed: int, *effects: str) -> Recording:
    return simulate(scenario_at(100.0, scenario), np.random.default_rng(seed), [parse_effect(e) for e in effects])[0]


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


@pytest.fixture(scope="module")
def plain() -> Recording:
    return flown("figure_eight", 31)


def test_a_slow_error_is_found_with_its_size(plain: Recording) -> None:
    spec = as_declared(drifting(plain, 2), slow_gps=True).levels.specs["gps"]
    assert TAU / 2.5 < spec.colour_time < 2.5 * TAU  # type: ignore[operator]
    assert spec.colour_std == pytest.approx(SHARE * plain.spec("gps").noise_std, rel=0.35)  # type: ignore[operator]


def test_a_fast_one_too(plain: Recording) -> None:
    """Half a second, five fixes of the receiver at most; no bound says where slow begins."""
    spec = as_declared(drifting(plain, 2, tau=0.5, share=2.0), slow_gps=True).levels.specs["gps"]
    assert 0.2 < spec.colour_time < 1.25  # type: ignore[operator]


@pytest.mark.parametrize("larger", [1.3, 2.0])
def test_white_noise_larger_than_declared_is_none(plain: Recording, larger: float) -> None:
    rng, gps = np.random.default_rng(5), plain.streams["gps"]
    more = np.sqrt(larger**2 - 1.0) * plain.spec("gps").noise_std * rng.standard_normal((len(gps.t), 3))
    columns = {**gps.columns, **{c: gps.columns[c] + more[:, i] for i, c in enumerate(POSITION)}}
    noisy = plain.replace(streams={**plain.streams, "gps": replace(gps, columns=columns)})
    spec = as_declared(noisy, slow_gps=True).levels.specs["gps"]
    assert spec.colour_std is None
    assert spec.noise_std == pytest.approx(larger * plain.spec("gps").noise_std, rel=0.1)  # type: ignore[operator]


def test_where_there_is_none_the_model_has_none(plain: Recording) -> None:
    assert as_declared(plain, slow_gps=True).levels.specs["gps"] == plain.spec("gps")


@pytest.mark.parametrize("text", ["gps.step=3,-2,2@30", "gps.transient=4,0,-4@25:35", "gps.latency=0.2"])
def test_what_is_no_slow_error_is_not_taken_for_one(text: str) -> None:
    """The size of the slow error is sought without the effect in the model; the effect is found nevertheless."""
    recording = between(flown("figure_eight", 32, text), 0.0, 50.0)
    assert select(flight_source(recording)).names == (parse_effect(text).effect.name,)


def test_beside_a_slow_error_the_residual_is_white_and_no_effect_named(plain: Recording) -> None:
    coloured = flight_source(drifting(plain, 3))
    gps = next(r for r in coloured.residuals(coloured.fit(())) if r.stream == "gps")
    assert _neighbours(gps.whitened[:, :3]) < 0.1
    assert select(coloured).names == ()


def test_the_right_effect_beside_a_slow_error() -> None:
    present = parse_effect("gyro.scale=0.012,-0.01,0.015")
    selection = select(flight_source(drifting(flown("figure_eight", 33, "gyro.scale=0.012,-0.01,0.015"), 4)))
    assert selection.names == (present.effect.name,)
    finding = selection.findings[0]
    assert np.all(np.abs(finding.beta - present.beta) < 4.0 * finding.std)


def test_a_disturbance_that_might_pass_for_a_slow_error_is_none() -> None:
    recording = flown("figure_eight", 12, "gps.transient=1.26,-0.88,1.01@20:33")
    assert select(flight_source(between(recording, 0.0, 50.0))).names == ("gps.transient",)


def _neighbours(z: FloatArray) -> float:
    """Correlation of neighbouring rows."""
    return float(np.sum(z[1:] * z[:-1]) / np.sum(z**2))
