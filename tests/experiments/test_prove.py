"""Rollback: what the held-out part may say of an effect, and what it may not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from scipy import stats

from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.evidence.score import Evidence
from sinan.estimator.evidence.source import Fit, Part, Source, StreamResidual, held_out
from sinan.estimator.evidence.term import Term
from sinan.estimator.filter.flight import Flight
from sinan.experiments.residual_loop import prove
from sinan.experiments.residual_loop.prove import rms_interval, rolled_back
from sinan.experiments.residual_loop.select import Selection, select
from sinan.experiments.scenarios import load_scenario, parse_effect
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.simulate import simulate

TERM = Term("mag.declination")


def test_a_disturbance_of_the_fitting_part_stays_in_the_model() -> None:
    """It touches no held-out reading; without it the other effect is fitted wrongly and would predict nothing."""
    effects = ("mag.temperature=0.0006,0,0.0004", "mag.transient=0.1,0.05,-0.1@2:15")
    recording, _ = simulate(load_scenario("warm_up"), np.random.default_rng(33), [parse_effect(e) for e in effects])
    source = FlightSource(Flight.of(recording))
    selection = select(source)
    assert set(selection.names) == {"mag.temperature", "mag.transient"}
    assert rolled_back(source, selection) == {}


def test_another_seed_moves_the_ends_of_an_interval_by_what_its_draws_say() -> None:
    """0.08 of the sigma of the RMS, which twenty blocks know to a fifth: at most 0.3 of 100 seeds."""
    squares = np.random.default_rng(1).standard_normal(1000) ** 2
    ends = np.array([rms_interval(squares, np.random.default_rng(seed)) for seed in range(100)])
    sigma = np.mean(np.diff(ends, axis=1)) / (2.0 * stats.norm.isf(0.025))
    assert 0.05 * sigma < np.max(np.std(ends, axis=0)) < 0.12 * sigma
    assert np.max(np.ptp(ends, axis=0)) < 0.6 * sigma


class Whitened:
    """A source with white residuals e + d without an effect and e with it."""

    name, noise_known, alike = "whitened", True, ()

    def __init__(self, e: FloatArray, d: FloatArray) -> None:
        self._with, self._without = e, e + d

    @property
    def is_predicting(self) -> bool:
        return False

    def held_out(self, fit: Fit) -> list[StreamResidual]:
        return held_out(self.residuals(fit))

    def residuals(self, fit: Fit) -> list[StreamResidual]:
        white = np.asarray((self._with if TERM in fit.terms else self._without)[:, None], dtype=np.float64)
        return [
            StreamResidual(
                "mag",
                np.arange(float(len(white))),
                white,
                white,
                np.ones(white.shape, bool),
                np.ones(len(white), bool),
                "1",
                {},
                np.arange(len(white)),
            )
        ]


class Regression(Whitened):
    """Readings y = X beta + n, n white of variance 1, beta by least squares on the first two thirds of them."""

    def __init__(self, X: FloatArray, y: FloatArray) -> None:
        self._X, self._y = X, y
        self._held_out = np.arange(len(y)) >= 2 * len(y) // 3

    def rows_of(self, part: Part) -> FloatArray:
        return np.asarray(self._held_out <= (part == "all"))

    def fit(self, terms: Sequence[Term], start: Mapping[Term, FloatArray] | None = None, part: Part = "all") -> Fit:
        rows = self.rows_of(part)
        beta = np.linalg.lstsq(self._X[rows], self._y[rows])[0] if terms else np.zeros(self._X.shape[1])
        return Fit(tuple(terms), dict.fromkeys(terms, beta), {}, 0.0, part, None)

    def evidence(self, fit: Fit, own_terms_only: bool = False) -> Evidence:
        X = self._X[self.rows_of(fit.part)]
        size = X.shape[1]
        return Evidence((TERM.key,), (size,), (X.T @ X)[None], np.zeros((1, size)), np.ones(size))

    def residuals(self, fit: Fit) -> list[StreamResidual]:
        e = (self._y - self._X @ fit.beta.get(TERM, np.zeros(self._X.shape[1])))[:, None]
        index, tells = np.arange(len(e)), np.ones(e.shape, bool)
        return [StreamResidual("mag", index.astype(float), e, e, tells, self._held_out, "1", {}, index)]


def judged(X: FloatArray, y: FloatArray) -> tuple[bool, float, float, FloatArray]:
    """Whether the held-out part bears the effect out; the gain, the change and the errors given back."""
    source = cast(Source, Regression(X, y))
    fitted, without = source.fit((TERM,), part="fitting"), source.fit((), part="fitting")
    gain, change = prove._held_out_gain(source, fitted, without, ())
    errors = prove._errors_given_back(source, fitted, TERM)
    return prove._is_borne_out(source, fitted, without, TERM, ()), gain, change, errors


RUNS = 400
N = 300  # readings
LAMBDA = (4.0, 30.0, 300.0, 3000.0)  # beta' X'X beta of all readings: from what nobody sees to what everybody sees


def regressors(rng: np.random.Generator, held_out_share: float = 1.0) -> FloatArray:
    """(n, 3) columns of norm one over all readings; the held-out ones shrunk by a factor."""
    X = rng.standard_normal((N, 3))
    X[2 * N // 3 :] *= held_out_share
    return np.asarray(X / np.linalg.norm(X, axis=0))


@pytest.mark.parametrize("size", LAMBDA)
def test_a_true_effect_is_borne_out_but_for_chance(size: float) -> None:
    """Three sigma of a normal law are passed once in 741 times; 8 of 400 would be, by chance, once in 10^7."""
    rng = np.random.default_rng(3)
    dropped = 0
    for _ in range(RUNS):
        X = regressors(rng)
        beta = rng.standard_normal(3)
        y = X @ (beta * np.sqrt(size) / np.linalg.norm(X @ beta)) + rng.standard_normal(N)
        dropped += not judged(X, y)[0]
    assert dropped < 8


@pytest.mark.parametrize(
    ("size", "there", "dropped"),
    [
        (3000.0, 0.0, (0.99, 1.0)),  # at 32 sigma the last third would have shown it
        (300.0, 0.0, (0.95, 1.0)),  # at 10 sigma
        (30.0, 0.0, (0.0, 0.1)),  # at 3 sigma, and the estimate as wrong again: it may have
        (3000.0, 0.55, (0.75, 1.0)),  # a gain of 2 x 0.55 - 1 = 0.1 of the whole, five sigma below the half of it
        (3000.0, 0.9, (0.0, 0.01)),  # 0.8 of it
        (300.0, 0.45, (0.55, 0.8)),  # none where it should be 4 sigma: by chance a little one in a third of the runs
    ],
)
def test_what_the_held_out_part_has_a_share_of(size: float, there: float, dropped: tuple[float, float]) -> None:
    """Something of the effect's shape in the first two thirds, and `there` of it in the last one."""
    rng = np.random.default_rng(4)
    count = 0
    for _ in range(RUNS):
        X = regressors(rng)
        beta = rng.standard_normal(3)
        mean = X @ (beta * np.sqrt(size) / np.linalg.norm(X @ beta))
        mean[2 * N // 3 :] *= there
        count += not judged(X, mean + rng.standard_normal(N))[0]
    assert dropped[0] <= count / RUNS <= dropped[1]


def test_where_the_held_out_part_cannot_see_the_effect_it_has_no_say() -> None:
    rng = np.random.default_rng(5)
    for _ in range(RUNS):
        X = regressors(rng, held_out_share=1e-3)
        assert judged(X, X @ np.array([20.0, -10.0, 5.0]) + rng.standard_normal(N))[0]


def test_the_gain_has_the_moments_that_the_rule_counts_with() -> None:
    """Of a true effect: mean d'd - 2 tr(L_h L_f^-1), variance of at most 4 d'd (1 + m), by simulation."""
    rng = np.random.default_rng(6)
    X = regressors(rng)
    mean = X @ np.array([12.0, -7.0, 9.0])
    runs = [judged(X, mean + rng.standard_normal(N))[1:] for _ in range(RUNS)]
    gain, change = (np.array([run[k] for run in runs]) for k in (0, 1))
    errors = runs[0][2]
    off = gain - (change - 2.0 * np.sum(errors))
    assert abs(np.mean(off)) < 3.3 * np.std(off) / np.sqrt(RUNS)
    variance = np.mean(4.0 * change * (1.0 + np.max(errors)))
    assert 0.5 * variance < np.var(off) < variance * (1.0 + 3.3 * np.sqrt(2.0 / RUNS))


def test_slow_noise_asks_for_a_gain(monkeypatch: pytest.MonkeyPatch) -> None:
    """White noise cannot speak against so small an effect; slow noise, whose chances nobody knows, has to speak for it,
    unless the effect is not seen at all.
    """
    monkeypatch.setattr(prove, "_errors_given_back", lambda *_: np.array([0.1]))
    rng = np.random.default_rng(4)
    slow = np.convolve(rng.standard_normal(4100), np.ones(100), "valid")[:4000] / 10.0
    fitted, without = (Fit(terms, {}, {}, 0.0, "fitting", None) for terms in ((TERM,), ()))
    for e, size, borne_out in ((rng.standard_normal(4000), 8.0, True), (slow, 8.0, False), (slow, 0.1, True)):
        d = -np.sign(np.mean(e)) * np.full(4000, np.sqrt(size / 4000))  # taking the effect out makes the error smaller
        source = cast(Source, Whitened(np.asarray(e), np.asarray(d)))
        assert prove._held_out_gain(source, fitted, without, ())[0] < 0.0
        assert prove._is_borne_out(source, fitted, without, TERM, ()) == borne_out


class Predicted(Whitened):
    """The same; the model with the effect predicts no reading of the range sensor."""

    def residuals(self, fit: Fit) -> list[StreamResidual]:
        mag = super().residuals(fit)
        return mag if TERM in fit.terms else [*mag, replace(mag[0], stream="sonar", whitened=9.0 * mag[0].whitened)]

    def fit(self, terms: Sequence[Term], start: Mapping[Term, FloatArray] | None = None, part: Part = "all") -> Fit:
        return Fit(tuple(terms), dict(start or {}), {}, 0.0, part, None)


def test_errors_are_compared_on_a_stream_that_both_models_predict() -> None:
    noise = np.random.default_rng(1).standard_normal(100)
    source = cast(Source, Predicted(noise, np.ones(100)))
    plain, final = source.fit(()), source.fit((TERM,), {TERM: np.ones(1)})
    proof = prove.prove(source, Selection(plain, final, (), (), (), (), ()), np.random.default_rng(2))
    assert proof.stream == "mag"
    assert np.isfinite(prove._held_out_gain(source, final, plain, ())[0])


def test_no_stream_that_both_models_predict_is_one_line() -> None:
    source = cast(Source, Predicted(np.ones(100), np.ones(100)))
    with pytest.raises(InputError, match="no stream with readings left"):
        prove.stream_in_question(source, Selection(source.fit(()), source.fit(()), (), (), (), (), ()), ())
