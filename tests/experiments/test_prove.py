"""Rollback: what the held-out part may say of an effect, and what it may not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from estimator.flight_model import flight_model
from experiments.residual_loop import prove
from experiments.residual_loop.flight import FlightSource
from experiments.residual_loop.prove import rolled_back
from experiments.residual_loop.select import Selection, select
from experiments.residual_loop.source import Fit, Part, Source, StreamResidual
from experiments.residual_loop.term import Term
from experiments.scenarios import load_scenario, parse_effect
from sensors.arrays import FloatArray
from sensors.effects import Effect, effect
from sensors.errors import InputError
from sensors.simulate import simulate

TERM = Term("mag.declination")


def test_a_disturbance_of_the_fitting_part_stays_in_the_model() -> None:
    """It touches no held-out reading; without it the other effect is fitted wrongly and would foretell nothing."""
    effects = ("mag.temperature=0.0006,0,0.0004", "mag.transient=0.1,0.05,-0.1@2:15")
    recording, _ = simulate(load_scenario("warm_up"), np.random.default_rng(33), [parse_effect(e) for e in effects])
    source = FlightSource(recording, flight_model(recording))
    selection = select(source)
    assert set(selection.names) == {"mag.temperature", "mag.transient"}
    assert rolled_back(source, selection) == ()


class Whitened:
    """A source with white residuals e + d without an effect and e with it."""

    name, noise_known = "whitened", True

    def __init__(self, e: FloatArray, d: FloatArray) -> None:
        self._with, self._without = e, e + d

    def effect(self, term: Term) -> Effect:
        return effect(term.name)

    def residuals(self, fit: Fit) -> list[StreamResidual]:
        white = np.asarray((self._with if TERM in fit.terms else self._without)[:, None], dtype=np.float64)
        return [
            StreamResidual(
                "mag",
                np.arange(float(len(white))),
                white,
                white,
                np.ones(len(white), bool),
                "1",
                {},
                np.arange(len(white)),
            )
        ]


@pytest.mark.parametrize(
    ("change", "gain", "errors", "borne_out"),
    [
        (1.0, -3.0, 0.003, True),  # nothing to be seen in the held-out part
        (500.0, -20.0, 1.4, False),  # it would have been seen
        (500.0, 20.0, 1.4, False),  # far less than it ought to make
        (500.0, 420.0, 1.4, True),
        (300.0, -17.0, 30.0, True),  # half of what was fitted, by an estimate of three sigma: its score is 8 sigma
        (2000.0, 700.0, 100.0, True),  # the estimate errs by a fifth: not to be told from a third of the gain
    ],
)
def test_the_held_out_part_is_heard_where_it_can_tell(
    change: float, gain: float, errors: float, borne_out: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """G = d'd + 2 d'e is set through the part of e along d; `errors` is L_h / L_f."""
    monkeypatch.setattr(prove, "_errors_given_back", lambda *_: np.array([errors]))
    n = 4000
    d = np.full(n, np.sqrt(change / n))
    e = np.random.default_rng(1).standard_normal(n)
    e += d * ((gain - change) / 2.0 - d @ e) / (d @ d)
    source = cast(Source, Whitened(e, d))
    fitted, without = (Fit(terms, {}, {}, 0.0, "fitting", None) for terms in ((TERM,), ()))
    assert prove._is_borne_out(source, fitted, without, TERM, ()) == borne_out


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


class Foretold(Whitened):
    """The same; the model with the effect foretells no reading of the range sensor."""

    def residuals(self, fit: Fit) -> list[StreamResidual]:
        mag = super().residuals(fit)
        return mag if TERM in fit.terms else [*mag, replace(mag[0], stream="sonar", whitened=9.0 * mag[0].whitened)]

    def fit(self, terms: Sequence[Term], start: Mapping[Term, FloatArray] | None = None, part: Part = "all") -> Fit:
        return Fit(tuple(terms), dict(start or {}), {}, 0.0, part, None)


def test_errors_are_compared_on_a_stream_that_both_models_foretell() -> None:
    noise = np.random.default_rng(1).standard_normal(100)
    source = cast(Source, Foretold(noise, np.ones(100)))
    plain, final = source.fit(()), source.fit((TERM,), {TERM: np.ones(1)})
    proof = prove.prove(source, Selection(plain, final, (), (), (), (), ()), np.random.default_rng(2))
    assert proof.stream == "mag"
    assert np.isfinite(prove._held_out_gain(source, final, plain, ())[0])


def test_no_stream_that_both_models_foretell_is_one_line() -> None:
    source = cast(Source, Foretold(np.ones(100), np.ones(100)))
    with pytest.raises(InputError, match="no stream with readings left"):
        prove.stream_in_question(source, Selection(source.fit(()), source.fit(()), (), (), (), (), ()), ())
